"""The cost of one iteration's data: falls, who drove, takeovers, and kept frames.

Read `rollouts.summary` for the summary of each episode, `runs.metrics` for the records that a run
keeps, and `run_cost` for the cost of a whole run.
"""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.types import TICKS_PER_SECOND


@dataclass(frozen=True)
class CollectionCost:
    """The cost of an iteration's rollouts.

    The fields from ``episodes`` to ``failed_episodes`` count all rollouts except LocoDAGGER's
    queries, the expert's rollouts from states of other rollouts. These are counted as ``queries``,
    and in ``expert_seconds``, ``robot_seconds``, ``plans``, ``invalid_plans`` and the kept frames.

    Attributes:
        episodes: Number of rollouts.
        falls: Number of rollouts that ended in a fall.
        falls_in_tail: Number of falls in the expert's tail.
        falls_expert_driving: Number of falls in which the expert drove at the last tick.
        falls_expert_driving_before: Number of falls in which the expert drove half a second before.
        near_falls: Number of rollouts that tilted beyond ``safety.fall_angle`` but did not fall,
            which is possible if ``collection.fall_angle`` is larger.
        near_falls_in_tail: Number of rollouts that did so in the tail.
        diverged: Number of rollouts that the expert gave up on.
        stalls: Number of rollouts that ended upright without stepping.
        falls_per_robot_minute: Falls per minute of rollouts, tails included [1/min].
        takeovers: Number of times that the expert took over from the policy, before the tails.
        expert_share: Share of the time before the tails that the expert drove.
        expert_share_with_tail: Share of the whole time that the expert drove.
        failed_episodes: Ids of the rollouts that fell or diverged.
        queries: Number of the expert's rollouts from states of other rollouts (LocoDAGGER).
        queries_failed: Number of queries that fell or diverged.
        expert_seconds: Time that the expert drove [s]. Time in which the expert is queried but does
            not drive (DAGGER) only counts in ``plans``.
        robot_seconds: Simulated time of all rollouts and queries [s].
        plans: Number of MPC solves.
        invalid_plans: Number of MPC solves whose plan was not valid.
        frames_kept: Number of frames that enter the dataset.
        recoveries_tilted: Number of kept frames with a roll or pitch beyond 10 degrees.
        recoveries_near_bounds: Number of kept frames within 5 degrees or 1 cm of the bounds in the
            paper's table, or beyond them.
        rollout_seconds: Simulated time of the rollouts before their tails [s]; None in files of
            early versions.
        rollout_seconds_with_tail: Simulated time of the rollouts [s]; None in files of early
            versions.
    """

    episodes: int
    falls: int
    falls_in_tail: int
    falls_expert_driving: int
    falls_expert_driving_before: int
    near_falls: int
    near_falls_in_tail: int
    diverged: int
    stalls: int
    falls_per_robot_minute: float
    takeovers: int
    expert_share: float
    expert_share_with_tail: float
    failed_episodes: tuple[int, ...]
    queries: int
    queries_failed: int
    expert_seconds: float
    robot_seconds: float
    plans: int
    invalid_plans: int
    frames_kept: int
    recoveries_tilted: int
    recoveries_near_bounds: int
    rollout_seconds: float | None = None
    rollout_seconds_with_tail: float | None = None


def collection_cost(summary: Summary | None) -> CollectionCost:
    """The cost of an iteration's rollouts and queries, from the summary of its episodes.

    Args:
        summary: The summary; None if the budget affords no rollout, so that the cost is zero.
    """
    if summary is None:
        return _NOTHING
    queries = summary[summary.query]
    rollouts = summary[~summary.query]
    fell = rollouts.outcome == Outcome.FELL
    tail_ticks = rollouts.ticks - rollouts.proper_ticks
    robot_ticks = int(rollouts.ticks.sum())
    with_tail = int(rollouts.expert_ticks.sum() + tail_ticks.sum())
    return CollectionCost(
        episodes=len(rollouts.outcome),
        falls=int(fell.sum()),
        falls_in_tail=int((fell & (tail_ticks > 0)).sum()),
        falls_expert_driving=int((fell & rollouts.expert_drove_last).sum()),
        falls_expert_driving_before=int((fell & rollouts.expert_drove_before).sum()),
        near_falls=int((rollouts.tilted_far.any(axis=1) & ~rollouts.failed).sum()),
        near_falls_in_tail=int((rollouts.tilted_far[:, 1] & ~rollouts.failed).sum()),
        diverged=int((rollouts.outcome == Outcome.DIVERGED).sum()),
        stalls=int((rollouts.outcome == Outcome.STALLED).sum()),
        falls_per_robot_minute=float(fell.sum() / (robot_ticks / TICKS_PER_SECOND / 60)),
        takeovers=int(rollouts.takeovers.sum()),
        expert_share=float(rollouts.expert_ticks.sum() / rollouts.proper_ticks.sum()),
        expert_share_with_tail=with_tail / robot_ticks,
        failed_episodes=tuple(rollouts.episode[rollouts.failed].tolist()),
        queries=len(queries.outcome),
        queries_failed=int(queries.failed.sum()),
        expert_seconds=float(with_tail + queries.ticks.sum()) / TICKS_PER_SECOND,
        robot_seconds=float(summary.ticks.sum()) / TICKS_PER_SECOND,
        plans=int(summary.plans.sum()),
        invalid_plans=int(summary.invalid_plans.sum()),
        frames_kept=int(summary.kept.sum()),
        recoveries_tilted=int(summary.kept_tilted.sum()),
        recoveries_near_bounds=int(summary.kept_near_bounds.sum()),
        rollout_seconds=float(rollouts.proper_ticks.sum()) / TICKS_PER_SECOND,
        rollout_seconds_with_tail=robot_ticks / TICKS_PER_SECOND,
    )


_NOTHING = CollectionCost(
    episodes=0,
    falls=0,
    falls_in_tail=0,
    falls_expert_driving=0,
    falls_expert_driving_before=0,
    near_falls=0,
    near_falls_in_tail=0,
    diverged=0,
    stalls=0,
    falls_per_robot_minute=0.0,
    takeovers=0,
    expert_share=0.0,
    expert_share_with_tail=0.0,
    failed_episodes=(),
    queries=0,
    queries_failed=0,
    expert_seconds=0.0,
    robot_seconds=0.0,
    plans=0,
    invalid_plans=0,
    frames_kept=0,
    recoveries_tilted=0,
    recoveries_near_bounds=0,
    rollout_seconds=0.0,
    rollout_seconds_with_tail=0.0,
)
