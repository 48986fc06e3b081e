"""Evaluation as in the paper (IV-F): robustness from perturbed initial states, velocity tracking.

A rollout succeeds if the robot does not fall and keeps stepping for two thirds of it. Every policy
and the expert are run from the same stored initial states, and the outcome of each episode is kept,
so that comparisons are paired. Next: `push`, the impulses that a controller withstands;
`statistics`, the intervals.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from surefoot.config import Config
from surefoot.errors import shown
from surefoot.evaluation.digits import as_digits, from_digits
from surefoot.evaluation.gaits import GaitResult, results_by_gait
from surefoot.evaluation.ids import count_ids, ids_as_text, ids_from_text
from surefoot.evaluation.latching import Latching, latching_of
from surefoot.evaluation.statistics import (
    Interval,
    PairedDifference,
    check_paired,
    paired_difference,
    wilson,
)
from surefoot.robots.load import load_robot
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import NOT_RECORDED, Summary, covered
from surefoot.scenarios.disturbance import warn_of_pushes
from surefoot.scenarios.gaits import AllStarts, all_starts_of
from surefoot.scenarios.starts import StartSet
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray, PlanFunction
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
        stalls: Number of robots that stayed up but stopped stepping.
        diverged: Number of robots for which the expert no longer found a valid plan.
        strict_successes: Number of successes in which every foot also stepped in every window of
            1.5 gait periods.
        mse: Mean squared velocity error over the full length of successful episodes (paper).
        settled_mse: Mean squared velocity error from 1 s on, over all episodes that lasted that
            long, each with the same weight.
        max_torque: Largest joint torque commanded [N m].
        robot_seconds: Simulated time of all robots together [s].
        plans: Number of MPC solves.
        invalid_plans: Number of these that gave no valid plan.
        body_contacts: Number of robots that touched the ground with something other than a foot;
            None if that was not recorded.
        body_contact_successes: Number of these among the successes.
        covered: Number of successes in which the robot covered 70 % of the commanded distance: on
            uneven ground a robot may stay up and get nowhere. None in files of earlier versions.
        initial_states: Ids of the initial states in the order of the episodes, as text such as
            ``700-798,850`` (`ids` has them); empty in files of earlier versions, as are the
            next four.
        outcomes: One digit for each episode, its `Outcome`.
        strict: One digit for each episode: 1 if every foot stepped in every window of 1.5 gait
            periods.
        touched: One digit for each episode: 1 if something other than a foot touched the ground;
            empty if that was not recorded.
        lost_at: When the robot fell or the expert gave up on it [s], for each episode with one of
            these two outcomes, in the order of the episodes.
        latching: Which robots would have switched themselves off; None without a hardware profile.
        gaits: The figures gait by gait if there are several gaits; None for one.
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
    body_contacts: int | None = field(default=None, kw_only=True)
    body_contact_successes: int | None = field(default=None, kw_only=True)
    covered: int | None = field(default=None, kw_only=True)
    initial_states: str = field(default="", kw_only=True)
    outcomes: str = field(default="", kw_only=True)
    strict: str = field(default="", kw_only=True)
    touched: str = field(default="", kw_only=True)
    lost_at: tuple[float, ...] = field(default=(), kw_only=True)
    latching: Latching | None = field(default=None, kw_only=True)
    gaits: tuple[GaitResult, ...] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        """Check that each episode has one outcome, and one initial state if those were kept.

        Raises:
            ValueError: A string of digits has another length or other characters, or there are
                fewer or more initial states.
        """
        kinds = "".join(str(int(outcome)) for outcome in Outcome)
        for name, digits, allowed in (
            ("outcomes", self.outcomes, kinds),
            ("strict", self.strict, "01"),
            ("touched", self.touched, "01"),
        ):
            if digits and (len(digits) != self.episodes or not set(digits) <= set(allowed)):
                raise ValueError(
                    f"{name} must be {self.episodes} digits out of {allowed}, one for each "
                    f"episode; there are {len(digits)} characters"
                )
        if not self.initial_states:
            return
        count = count_ids(self.initial_states)
        if not count == self.episodes == len(self.outcomes):
            raise ValueError(
                f"initial_states must name one state for each of {self.episodes} episodes, and "
                f"outcomes have one digit for each; {shown(self.initial_states)} names {count}, "
                f"and there are {len(self.outcomes)} digits"
            )

    @property
    def ids(self) -> IntArray:
        """``(n,)`` ids of the initial states, in the order of the episodes; none if not kept."""
        return ids_from_text(self.initial_states)

    @property
    def succeeded(self) -> BoolArray:
        """``(n,)`` True for each episode that ended in success; none if that was not kept."""
        return from_digits(self.outcomes) == Outcome.SUCCESS


def success_difference(a: Robustness, b: Robustness) -> PairedDifference | None:
    """Success rate of one controller minus that of another, from the same initial states.

    Args:
        a: The robustness of one controller.
        b: The robustness of the other, which is subtracted.

    Returns:
        The difference with Newcombe's interval; None if one of them is from an earlier version,
        which did not keep the outcomes.

    Raises:
        ValueError: The two differ in their initial states.
    """
    check_paired(a, b, ("starts_hash", "split", "episodes"))
    if not a.outcomes or not b.outcomes:
        return None
    check_paired(a, b, ("initial_states",))
    return paired_difference(a.succeeded, b.succeeded)


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
        plan: The expert's MPC; None for the BiConMP-style planner.
        stored: The set of initial states, of one gait; None for those of the configuration.

    Returns:
        The figures, and the summary of the episodes that they are computed from.

    Raises:
        FileNotFoundError: There is no such policy.
        KeyError: There is no such split.
        ValueError: The split has fewer initial states than the requested episodes, or one set is
            given for several gaits.
    """
    if stored is not None and config.other_gaits:
        raise ValueError(
            "one set of initial states, but several gaits; leave it out for those of all gaits, or "
            "evaluate each gait alone"
        )
    all_stored = all_starts_of(config) if stored is None else AllStarts((stored,))
    warn_of_pushes("disturbance", config.evaluation.disturbance, load_robot(config.robot))
    job = evaluation_job(config, policy, split, all_stored, plan)
    title = f"{controller_title(config, policy)}: {split} starts"
    summary = run_episodes(job, workers, title)
    robustness = robustness_of(summary, all_stored, split, config.robot.profile)
    if config.other_gaits:
        robustness = replace(robustness, gaits=results_by_gait(summary, config))
    return robustness, summary


def evaluation_job(
    config: Config,
    policy: Path | None,
    split: str,
    stored: StartSet | AllStarts,
    plan: PlanFunction | None = None,
) -> Job:
    """The episodes of an evaluation; the arguments are those of `evaluate`.

    Raises:
        KeyError: There is no such split.
        ValueError: The split has fewer initial states than the requested episodes.
    """
    starts = stored.first(split, config.evaluation.episodes)
    return Job(
        replace(config, seed=stored.seed),
        Episodes(starts, config.evaluation.duration, id=starts.id),
        ExpertOnly() if policy is None else PolicyOnly(),
        policy=policy,
        plan=plan,
        disturbance=config.evaluation.disturbance,
        privileged=False,
    )


def controller_title(config: Config, policy: Path | None) -> str:
    """The name of a policy or the expert, with its simulator, in progress bars."""
    controller = "expert" if policy is None else f"policy {policy.stem}"
    return f"{config.simulation.backend}, {controller}"


def robustness_of(
    summary: Summary, stored: StartSet | AllStarts, split: str, profile: str | None = None
) -> Robustness:
    """The paper's figures of n episodes.

    Args:
        summary: The n episodes.
        stored: The set of initial states from which they began.
        split: The split of that set.
        profile: The robot's hardware profile in these episodes; None if it had none.
    """
    n = len(summary.outcome)
    success = summary.outcome == Outcome.SUCCESS
    successes = int(success.sum())
    lost = summary.failed
    recorded = bool((summary.contact_ticks != NOT_RECORDED).all())
    touched = summary.contact_ticks > 0
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
        body_contacts=int(touched.sum()) if recorded else None,
        body_contact_successes=int((touched & success).sum()) if recorded else None,
        covered=int((success & covered(summary)).sum()),
        initial_states=ids_as_text(summary.start),
        outcomes=as_digits(summary.outcome),
        strict=as_digits(summary.strict),
        touched=as_digits(touched) if recorded else "",
        lost_at=tuple((summary.ticks[lost] / TICKS_PER_SECOND).tolist()),
        latching=None if profile is None else latching_of(summary, profile),
    )


def mean_error(errors: Array) -> VelocityError:
    """Mean of the errors of n episodes; numbers that are not finite are left out.

    Args:
        errors: ``(n, 3)`` squared error of vx, vy [m^2/s^2] and yaw rate [rad^2/s^2].
    """
    vx, vy, yaw_rate = errors.T
    return _mean(vx), _mean(vy), _mean(yaw_rate)


def _mean(column: Array) -> float | None:
    """Mean of the finite numbers; None without any."""
    finite = np.isfinite(column)
    return float(column[finite].mean()) if finite.any() else None
