"""The cost of data: falls and who drove, takeovers, the expert's share, and what was kept.

`collection_cost` counts one iteration, `cost_of` adds up a whole run (the columns of the paper's
comparison, IV-F). Read `rollouts.summary` for what is known of each episode, and `runs.metrics` for
the records that a run keeps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.types import TICKS_PER_SECOND

if TYPE_CHECKING:
    from surefoot.runs.metrics import StageRecord

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
"""Fields of `CollectionCost` that a whole run's cost adds up, those of the pre-training too."""


@dataclass(frozen=True)
class CollectionCost:
    """The cost of an iteration's rollouts.

    The fields from ``episodes`` to ``failed_episodes`` count the rollouts in which a policy may
    drive. The expert's rollouts from their states (LocoDAGGER) count as ``queries``, and in
    ``expert_seconds``, ``robot_seconds``, ``plans``, ``invalid_plans`` and what is kept.

    Attributes:
        episodes: Number of rollouts.
        falls: Number of rollouts that ended in a fall.
        falls_in_tail: Number of falls in the expert's tail.
        falls_expert_driving: Number of falls at whose last tick the expert drove.
        falls_expert_driving_before: Number of falls that the expert drove half a second before.
        near_falls: Number of rollouts that tilted beyond ``safety.fall_angle`` and did not fall,
            where ``collection.fall_angle`` allows for it.
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
        expert_seconds: Time that the expert drove [s]. The time for which it is only asked (DAGGER)
            shows in ``plans``.
        robot_seconds: Simulated time of all rollouts and queries [s].
        plans: Number of MPC solves.
        invalid_plans: Number of MPC solves whose plan was not valid.
        frames_kept: Number of frames that enter the dataset.
        recoveries_tilted: Number of kept frames with a roll or pitch beyond 10 degrees.
        recoveries_near_bounds: Number of kept frames within 5 degrees or 1 cm of the bounds in the
            paper's table, or beyond them.
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


def collection_cost(summary: Summary) -> CollectionCost:
    """The cost of an iteration's rollouts and queries, from the summary of its episodes."""
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
    )


def cost_of(metrics: Sequence[StageRecord], T: float) -> dict[str, Any]:
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
    collected = [record for record in metrics if record.stage == "collect"]
    later = [record for record in collected if record.iteration > 0]
    cost: dict[str, Any] = {key: sum(getattr(r, key) for r in collected) for key in SUMMED}
    for key in ("episodes", "falls"):
        cost[f"pretraining_{key}"] = sum(getattr(r, key) for r in collected if r.iteration == 0)
    for key in ("episodes", "falls", "takeovers"):
        cost[key] = sum(getattr(record, key) for record in later) if later else None
    minutes = sum(rollout_seconds(r, r.expert_share_with_tail, T) for r in later) / 60
    seconds = [rollout_seconds(record, record.expert_share, T) for record in later]
    shares = [record.expert_share for record in later]
    by_expert = sum(share * time for share, time in zip(shares, seconds, strict=True))
    cost["falls_per_robot_minute"] = cost["falls"] / minutes if later else None
    cost["expert_share"] = by_expert / sum(seconds) if later else None
    last = max((r.iteration for r in metrics if r.stage == "train"), default=0)
    stages = [record for record in metrics if record.stage != "best"]
    timed = [r for r in stages if later or r.stage == "collect" or r.iteration == last]
    cost["seconds"] = {
        stage: sum(r.seconds for r in timed if r.stage.startswith(prefix))
        for stage, prefix in (
            ("collect", "collect"),
            ("train", "train"),
            ("validate", "validate"),
            ("guards", "gate_"),
        )
    }
    return cost


def rollout_seconds(cost: CollectionCost, share: float, T: float) -> float:
    """Time of an iteration's rollouts, without the expert's queries, from what is recorded.

    The policy's time is what is not the expert's, and it is 1 - share of the whole: exact. Where
    the expert drove alone (LocoDAGGER's first iteration) the falls and their rate give the time,
    or no robot fell, and each rollout lasted T.

    Args:
        cost: Cost of an iteration's rollouts.
        share: Share of the expert in the time that is asked for: over T, or with the tail.
        T: Duration of a rollout [s].
    """
    if share < 1:
        return (cost.robot_seconds - cost.expert_seconds) / (1 - share)
    if cost.falls:
        return 60 * cost.falls / cost.falls_per_robot_minute
    return cost.episodes * T if cost.queries else cost.robot_seconds
