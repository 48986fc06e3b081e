"""Evaluation as in the paper (IV-F): robustness from perturbed initial states, velocity tracking.

A rollout succeeds if the robot does not fall and steps constantly for two thirds of it. Every
policy and the expert are run from the same stored initial states, so that comparisons are paired.
Next: `push`, the impulses that a controller withstands; `statistics`, the intervals.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surefoot.config import Config
from surefoot.evaluation.statistics import Interval, wilson
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.scenarios.starts import StartSet, load_starts
from surefoot.types import TICKS_PER_SECOND, Array, PlanFunction
from surefoot.workers import Workers

VelocityError = tuple[float | None, float | None, float | None]
"""Mean squared error of vx, vy [m^2/s^2] and yaw rate [rad^2/s^2]; None without any episode."""


@dataclass(frozen=True)
class Robustness:
    """The paper's figures of one controller in n episodes, one from each initial state.

    Attributes:
        starts: Name of the set of initial states.
        starts_hash: SHA-256 of that set.
        split: Split of the set, `select` or `test`.
        episodes: Number n of episodes.
        successes: Number of robots that did not fall, stall or diverge.
        success_rate: Successes as a share of the episodes.
        success_interval: Wilson's 95 % interval of the success rate.
        falls: Number of robots that fell.
        stalls: Number of robots that stayed up and stopped stepping.
        diverged: Number of robots for which the expert had no valid plan any more.
        strict_successes: Number of successes in which every foot also stepped in every window of
            1.5 gait periods.
        mse: Mean squared velocity error over the whole of the successful episodes (paper).
        settled_mse: Mean squared velocity error from 1 s on, over all episodes that lasted so
            long, each with the same weight.
        max_torque: Largest joint torque commanded [N m].
        robot_seconds: Simulated time of all robots together [s].
        plans: Number of MPC solves.
        invalid_plans: Number of these that gave no valid plan.
    """

    starts: str
    starts_hash: str
    split: str
    episodes: int
    successes: int
    success_rate: float
    success_interval: Interval
    falls: int
    stalls: int
    diverged: int
    strict_successes: int
    mse: VelocityError
    settled_mse: VelocityError
    max_torque: float
    robot_seconds: float
    plans: int
    invalid_plans: int


def evaluate(
    config: Config,
    policy: Path | None,
    split: str,
    workers: Workers,
    plan: PlanFunction | None = None,
    stored: StartSet | None = None,
) -> tuple[Robustness, Summary]:
    """Run a policy, or the expert, from stored initial states.

    Args:
        config: Robot, simulator and expert; duration and number of the episodes.
        policy: File of the policy; None evaluates the expert.
        split: `select` to choose a policy, `test` to report one.
        workers: Processes that run the episodes.
        plan: The expert's MPC; without it the BiConMP-style planner.
        stored: The set of initial states; without it the package's first.

    Returns:
        The figures, and the summary of the episodes that they are taken from.

    Raises:
        FileNotFoundError: There is no such policy.
        KeyError: There is no such split.
        ValueError: The split holds fewer initial states than the episodes asked for.
    """
    stored = stored or load_starts()
    starts = stored.first(split, config.evaluation.episodes)
    job = Job(
        replace(config, seed=stored.seed),
        Episodes(starts, config.evaluation.duration, id=starts.id),
        ExpertOnly() if policy is None else PolicyOnly(),
        policy=policy,
        plan=plan,
        disturbance=config.evaluation.disturbance,
    )
    title = f"{controller_title(config, policy)}: {split} starts"
    summary = run_episodes(job, workers, title)
    return robustness_of(summary, stored, split), summary


def controller_title(config: Config, policy: Path | None) -> str:
    """What a progress bar calls a policy, or the expert, in its simulator."""
    controller = "expert" if policy is None else f"policy {policy.stem}"
    return f"{config.simulation.backend}, {controller}"


def robustness_of(summary: Summary, stored: StartSet, split: str) -> Robustness:
    """The paper's figures of n episodes.

    Args:
        summary: The n episodes.
        stored: The set of initial states from which they began.
        split: The split of that set.
    """
    n = len(summary.outcome)
    success = summary.outcome == Outcome.SUCCESS
    successes = int(success.sum())
    return Robustness(
        starts=stored.name,
        starts_hash=stored.hash,
        split=split,
        episodes=n,
        successes=successes,
        success_rate=successes / n,
        success_interval=wilson(successes, n),
        falls=int((summary.outcome == Outcome.FELL).sum()),
        stalls=int((summary.outcome == Outcome.STALLED).sum()),
        diverged=int((summary.outcome == Outcome.DIVERGED).sum()),
        strict_successes=int((success & summary.strict).sum()),
        mse=mean_error(summary.mse[success]),
        settled_mse=mean_error(summary.settled_mse),
        max_torque=float(summary.max_torque.max()),
        robot_seconds=float(summary.ticks.sum() / TICKS_PER_SECOND),
        plans=int(summary.plans.sum()),
        invalid_plans=int(summary.invalid_plans.sum()),
    )


def mean_error(errors: Array) -> VelocityError:
    """Mean of the errors of n episodes; numbers that are not finite are left out.

    Args:
        errors: ``(n, 3)`` squared error of vx, vy [m^2/s^2] and yaw rate [rad^2/s^2].
    """
    vx, vy, yaw_rate = errors.T
    return _mean(vx), _mean(vy), _mean(yaw_rate)


def _mean(column: Array) -> float | None:
    """Mean of the finite numbers, None without any."""
    finite = np.isfinite(column)
    return float(column[finite].mean()) if finite.any() else None
