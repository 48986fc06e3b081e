"""What collecting data cost: falls and who drove, takeovers, the expert's share, what was kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.types import TICKS_PER_SECOND

SUMMED = (
    "expert_seconds",
    "plans",
    "diverged",
    "queries",
    "queries_failed",
    "near_falls",
    "near_falls_in_tail",
    "frames_kept",
    "recoveries_tilted",
    "recoveries_near_bounds",
)
"""Figures of a collection that a whole run's cost adds up, the pre-training's too."""


def collection_figures(summary: Summary) -> dict[str, Any]:
    """The figures of an iteration's rollouts, flat.

    ``episodes`` to ``failed_episodes`` are of the rollouts in which a policy may drive; the
    expert's rollouts from their states (LocoDAGGER) count as ``queries``, ``queries_failed``, and
    in ``expert_seconds``, ``robot_seconds``, ``plans``, ``invalid_plans`` and what is kept.
    ``expert_seconds`` is the time that the expert drove; that it is only asked (DAGGER) shows in
    ``plans``.
    ``falls_expert_driving`` is who drove the last tick, ``..._before`` half a second earlier;
    ``near_falls`` are rollouts that tilted beyond ``safety.fall_angle`` and did not fall, where
    ``collection.fall_angle`` allows for it; ``near_falls_in_tail`` did so in the tail.
    ``expert_share`` is over T, ``..._with_tail`` with the tail. ``recoveries_tilted`` are kept
    frames with roll or pitch beyond 10 degrees, ``recoveries_near_bounds`` those within 5 degrees
    or 1 cm of the paper's table.
    """
    queries, rollouts = summary[summary.query], summary[~summary.query]
    fell = rollouts.outcome == Outcome.FELL
    tail_ticks = rollouts.ticks - rollouts.proper_ticks
    robot_ticks = int(rollouts.ticks.sum())
    with_tail = int(rollouts.expert_ticks.sum() + tail_ticks.sum())
    return {
        "episodes": len(rollouts.outcome),
        "falls": int(fell.sum()),
        "falls_in_tail": int((fell & (tail_ticks > 0)).sum()),
        "falls_expert_driving": int((fell & rollouts.expert_drove_last).sum()),
        "falls_expert_driving_before": int((fell & rollouts.expert_drove_before).sum()),
        "near_falls": int((rollouts.tilted_far.any(axis=1) & ~rollouts.failed).sum()),
        "near_falls_in_tail": int((rollouts.tilted_far[:, 1] & ~rollouts.failed).sum()),
        "diverged": int((rollouts.outcome == Outcome.DIVERGED).sum()),
        "stalls": int((rollouts.outcome == Outcome.STALLED).sum()),
        "falls_per_robot_minute": float(fell.sum() / (robot_ticks / TICKS_PER_SECOND / 60)),
        "takeovers": int(rollouts.takeovers.sum()),
        "expert_share": float(rollouts.expert_ticks.sum() / rollouts.proper_ticks.sum()),
        "expert_share_with_tail": with_tail / robot_ticks,
        "failed_episodes": rollouts.episode[rollouts.failed].tolist(),
        "queries": len(queries.outcome),
        "queries_failed": int(queries.failed.sum()),
        "expert_seconds": float(with_tail + queries.ticks.sum()) / TICKS_PER_SECOND,
        "robot_seconds": float(summary.ticks.sum()) / TICKS_PER_SECOND,
        "plans": int(summary.plans.sum()),
        "invalid_plans": int(summary.invalid_plans.sum()),
        "frames_kept": int(summary.kept.sum()),
        "recoveries_tilted": int(summary.kept_tilted.sum()),
        "recoveries_near_bounds": int(summary.kept_near_bounds.sum()),
    }


def cost_of(metrics: Sequence[dict[str, Any]], T: float) -> dict[str, Any]:
    """What a whole run cost; iteration 0 is the pre-training.

    Args:
        metrics: the run's records (`surefoot.runs.run.Run.metrics`).
        T: [s] of a rollout, of an iterative method.

    Returns:
        Over everything: ``expert_seconds``, ``plans`` (MPC solves), ``diverged``, ``queries`` (the
        expert's rollouts from visited states, LocoDAGGER) and ``queries_failed``, ``frames_kept``,
        ``recoveries_tilted``, ``recoveries_near_bounds``, ``near_falls``, ``near_falls_in_tail``,
        ``pretraining_episodes`` and ``pretraining_falls``; over the later iterations: ``episodes``,
        ``falls``, ``falls_per_robot_minute``, ``takeovers`` and ``expert_share``, pooled over T;
        None where there are none. ``seconds``: wall time of collect, train, validate and guards; of
        a series of behaviour cloning that of the last size, whose policy owes nothing to the
        others.
    """
    collected = [record for record in metrics if record["stage"] == "collect"]
    later = [record for record in collected if record["iteration"] > 0]
    cost: dict[str, Any] = {key: sum(record[key] for record in collected) for key in SUMMED}
    for key in ("episodes", "falls"):
        cost[f"pretraining_{key}"] = sum(r[key] for r in collected if r["iteration"] == 0)
    for key in ("episodes", "falls", "takeovers"):
        cost[key] = sum(record[key] for record in later) if later else None
    minutes = sum(rollout_seconds(r, r["expert_share_with_tail"], T) for r in later) / 60
    seconds = [rollout_seconds(record, record["expert_share"], T) for record in later]
    shares = [record["expert_share"] for record in later]
    by_expert = sum(share * time for share, time in zip(shares, seconds, strict=True))
    cost["falls_per_robot_minute"] = cost["falls"] / minutes if later else None
    cost["expert_share"] = by_expert / sum(seconds) if later else None
    last = max((r["iteration"] for r in metrics if r["stage"] == "train"), default=0)
    timed = [r for r in metrics if later or r["stage"] == "collect" or r["iteration"] == last]
    cost["seconds"] = {
        stage: sum(r["seconds"] for r in timed if r["stage"].startswith(prefix))
        for stage, prefix in (
            ("collect", "collect"),
            ("train", "train"),
            ("validate", "validate"),
            ("guards", "guard_"),
        )
    }
    return cost


def rollout_seconds(record: dict[str, Any], share: float, T: float) -> float:
    """Time of an iteration's rollouts, without the expert's queries, from what is recorded.

    The policy's time is what is not the expert's, and it is 1 - share of the whole: exact. Where
    the expert drove alone (LocoDAGGER's first iteration) the falls and their rate give the time,
    or nobody fell, and each rollout lasted T.

    Args:
        record: of an iteration's collection.
        share: the expert's, of the time that is asked for: over T, or with the tail.
        T: [s] of a rollout.
    """
    if share < 1:
        return (record["robot_seconds"] - record["expert_seconds"]) / (1 - share)
    if record["falls"]:
        return 60 * record["falls"] / record["falls_per_robot_minute"]
    return record["episodes"] * T if record["queries"] else record["robot_seconds"]
