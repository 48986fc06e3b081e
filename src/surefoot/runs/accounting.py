"""The cost of data: falls and who drove, takeovers, the expert's share, and kept frames.

`collection_cost` counts one iteration, and `run_cost` adds up a whole run (the columns of the
paper's comparison, IV-F). Read `rollouts.summary` for the summary of each episode, and
`runs.metrics` for the records that a run keeps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.types import TICKS_PER_SECOND

if TYPE_CHECKING:
    from surefoot.runs.metrics import StageRecord


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


@dataclass(frozen=True)
class StageSeconds:
    """Wall time of a run's stages, added up over its iterations.

    In a series of dataset sizes (behavior cloning), only the policy of the last size counts.

    Attributes:
        collect: Wall time of collecting data [s].
        train: Wall time of training policies [s].
        validate: Wall time of choosing among policies [s].
        gates: Wall time of training gates [s].
    """

    renamed: ClassVar[Mapping[str, str]] = {"guards": "gates"}
    collect: float
    train: float
    validate: float
    gates: float


@dataclass(frozen=True)
class RunCost:
    """The cost of a whole run; in iteration 0, the pre-training, the expert drives alone.

    The fields from ``episodes`` to ``expert_share`` are about the later iterations, and None in a
    run without any (behavior cloning).

    Attributes:
        expert_seconds: Time that the expert drove [s]. Time in which the expert is queried but does
            not drive (DAGGER) only counts in ``plans``.
        plans: Number of MPC solves.
        diverged: Number of rollouts that ended because the expert had no valid plan.
        queries: Number of the expert's rollouts from visited states (LocoDAGGER).
        queries_failed: Number of these that fell or diverged.
        near_falls: Number of rollouts that tilted beyond ``safety.fall_angle`` but did not fall.
        near_falls_in_tail: Number of these that tilted that far in the tail.
        frames_kept: Number of frames kept.
        recoveries_tilted: Number of kept frames that are tilted (`surefoot.rollouts.summary`).
        recoveries_near_bounds: Number of kept frames near the bounds.
        pretraining_episodes: Number of rollouts of the pre-training.
        pretraining_falls: Number of these that fell.
        episodes: Number of rollouts of the later iterations.
        falls: Number of these that fell.
        takeovers: Number of times that the expert took over in the later iterations.
        falls_per_robot_minute: Falls per minute of the later iterations' rollouts, tail included.
        expert_share: Share of T that the expert drove, pooled over the later iterations.
        seconds: Wall time of the stages.
    """

    expert_seconds: float
    plans: int
    diverged: int
    queries: int
    queries_failed: int
    near_falls: int
    near_falls_in_tail: int
    frames_kept: int
    recoveries_tilted: int
    recoveries_near_bounds: int
    pretraining_episodes: int
    pretraining_falls: int
    episodes: int | None
    falls: int | None
    takeovers: int | None
    falls_per_robot_minute: float | None
    expert_share: float | None
    seconds: StageSeconds


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


def run_cost(metrics: Sequence[StageRecord], T: float) -> RunCost:
    """Add up the cost of a whole run; iteration 0 is the pre-training.

    Args:
        metrics: The run's records (`surefoot.runs.run.Run.metrics`).
        T: Duration of a rollout of an iterative method [s], for records of early versions; any
            number for behavior cloning.
    """
    collected = [record for record in metrics if record.stage == "collect"]
    first = [record for record in collected if record.iteration == 0]
    # An iteration has no rollouts if its share of the budget does not pay for one.
    later = [record for record in collected if record.iteration > 0 and record.episodes > 0]
    minutes = sum(_seconds_with_tail(record, T) for record in later) / 60
    seconds = [_seconds_before_tail(record, T) for record in later]
    shares = [record.expert_share for record in later]
    by_expert = sum(share * time for share, time in zip(shares, seconds, strict=True))
    falls = sum(record.falls for record in later)
    return RunCost(
        expert_seconds=sum(record.expert_seconds for record in collected),
        plans=sum(record.plans for record in collected),
        diverged=sum(record.diverged for record in collected),
        queries=sum(record.queries for record in collected),
        queries_failed=sum(record.queries_failed for record in collected),
        near_falls=sum(record.near_falls for record in collected),
        near_falls_in_tail=sum(record.near_falls_in_tail for record in collected),
        frames_kept=sum(record.frames_kept for record in collected),
        recoveries_tilted=sum(record.recoveries_tilted for record in collected),
        recoveries_near_bounds=sum(record.recoveries_near_bounds for record in collected),
        pretraining_episodes=sum(record.episodes for record in first),
        pretraining_falls=sum(record.falls for record in first),
        episodes=sum(record.episodes for record in later) if later else None,
        falls=falls if later else None,
        takeovers=sum(record.takeovers for record in later) if later else None,
        falls_per_robot_minute=falls / minutes if later else None,
        expert_share=by_expert / sum(seconds) if later else None,
        seconds=stage_seconds(metrics, any(record.iteration > 0 for record in collected)),
    )


def stage_seconds(metrics: Sequence[StageRecord], iterative: bool) -> StageSeconds:
    """Wall time of a run's stages.

    Args:
        metrics: The run's records.
        iterative: Whether each policy continues from the previous one; otherwise (a series of
            behavior cloning) only the last policy counts in training and validation.
    """
    last = max((r.iteration for r in metrics if r.stage == "train"), default=0)
    stages = [record for record in metrics if record.stage != "best"]
    timed = [r for r in stages if iterative or r.stage == "collect" or r.iteration == last]
    return StageSeconds(
        collect=sum(r.seconds for r in timed if r.stage == "collect"),
        train=sum(r.seconds for r in timed if r.stage == "train"),
        validate=sum(r.seconds for r in timed if r.stage == "validate"),
        gates=sum(r.seconds for r in timed if r.stage.startswith("gate_")),
    )


def _seconds_before_tail(cost: CollectionCost, T: float) -> float:
    """Time of an iteration's rollouts before their tails [s], without the expert's queries."""
    if cost.rollout_seconds is not None:
        return cost.rollout_seconds
    return _inferred_seconds(cost, cost.expert_share, T)


def _seconds_with_tail(cost: CollectionCost, T: float) -> float:
    """Time of an iteration's rollouts with their tails [s], without the expert's queries."""
    if cost.rollout_seconds_with_tail is not None:
        return cost.rollout_seconds_with_tail
    return _inferred_seconds(cost, cost.expert_share_with_tail, T)


def _inferred_seconds(cost: CollectionCost, share: float, T: float) -> float:
    """Time of an iteration's rollouts [s] in records of early versions, which lack it.

    The policy drove for robot_seconds - expert_seconds, which is 1 - share of the rollouts' time;
    this is exact. If the expert drove alone (LocoDAGGER's first iteration), the number of falls and
    their rate give the time. Without a fall, each rollout is assumed to have lasted T, which is too
    long for those that the expert gave up on.

    Args:
        cost: Cost of an iteration's rollouts.
        share: The expert's share of the wanted time, before the tails or with them.
        T: Duration of a rollout [s].
    """
    if share < 1:
        return (cost.robot_seconds - cost.expert_seconds) / (1 - share)
    if cost.falls:
        return 60 * cost.falls / cost.falls_per_robot_minute
    return cost.episodes * T if cost.queries else cost.robot_seconds
