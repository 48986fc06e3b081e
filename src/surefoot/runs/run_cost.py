"""The cost of a whole run over its iterations: the columns of the paper's comparison (IV-F).

`collection_cost` counts what one iteration cost, and `runs.metrics` has the records of all stages.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from surefoot.runs.collection_cost import CollectionCost
from surefoot.runs.metrics import StageRecord


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
        seconds=_stage_seconds(metrics),
    )


def _stage_seconds(metrics: Sequence[StageRecord]) -> StageSeconds:
    """Wall time of a run's stages.

    In an iterative method, each policy continues from the previous one. Otherwise (a series of
    behavior cloning) only the last policy counts in training and validation.
    """
    iterative = any(r.stage == "collect" and r.iteration > 0 for r in metrics)
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
