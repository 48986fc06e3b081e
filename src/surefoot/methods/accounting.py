"""What collecting data cost: falls and who drove, takeovers, the expert's share, what was kept."""

from __future__ import annotations

from typing import Any

from surefoot.safety import Outcome
from surefoot.summary import Summary
from surefoot.types import TICKS_PER_SECOND


def collection_figures(summary: Summary) -> dict[str, Any]:
    """The figures of an iteration's rollouts, flat.

    ``episodes`` to ``failed_episodes`` are of the rollouts in which a policy may drive; the
    expert's rollouts from their states (LocoDAGGER) count as ``queries``, ``queries_failed``, and
    in ``expert_seconds``, ``robot_seconds``, ``plans``, ``invalid_plans`` and what is kept.
    ``falls_expert_driving`` is who drove the last tick, ``..._before`` half a second earlier;
    ``expert_share`` is over T, ``..._with_tail`` with the tail. ``recoveries_tilted`` are kept
    frames with roll or pitch beyond 10 degrees, ``recoveries_near_bounds`` those within 5 degrees
    or 1 cm of the paper's table.
    """
    queries, everything = summary[summary.query], summary
    summary = summary[~summary.query]
    fell = summary.outcome == Outcome.FELL
    diverged = summary.outcome == Outcome.DIVERGED
    tail_ticks = summary.ticks - summary.proper_ticks
    robot_ticks = int(summary.ticks.sum())
    with_tail = int(summary.expert_ticks.sum() + tail_ticks.sum())
    query_failed = (queries.outcome == Outcome.FELL) | (queries.outcome == Outcome.DIVERGED)
    return {
        "episodes": len(summary.outcome),
        "falls": int(fell.sum()),
        "falls_in_tail": int((fell & (tail_ticks > 0)).sum()),
        "falls_expert_driving": int((fell & summary.expert_drove_last).sum()),
        "falls_expert_driving_before": int((fell & summary.expert_drove_before).sum()),
        "diverged": int(diverged.sum()),
        "stalls": int((summary.outcome == Outcome.STALLED).sum()),
        "falls_per_robot_minute": float(fell.sum() / (robot_ticks / TICKS_PER_SECOND / 60)),
        "takeovers": int(summary.takeovers.sum()),
        "expert_share": float(summary.expert_ticks.sum() / summary.proper_ticks.sum()),
        "expert_share_with_tail": with_tail / robot_ticks,
        "failed_episodes": summary.episode[fell | diverged].tolist(),
        "queries": len(queries.outcome),
        "queries_failed": int(query_failed.sum()),
        "expert_seconds": float(with_tail + queries.ticks.sum()) / TICKS_PER_SECOND,
        "robot_seconds": float(everything.ticks.sum()) / TICKS_PER_SECOND,
        "plans": int(everything.plans.sum()),
        "invalid_plans": int(everything.invalid_plans.sum()),
        "frames_kept": int(everything.kept.sum()),
        "recoveries_tilted": int(everything.kept_tilted.sum()),
        "recoveries_near_bounds": int(everything.kept_near_bounds.sum()),
    }
