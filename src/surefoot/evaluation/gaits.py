"""Evaluation of several gaits: each gait alone, and robots that change their gait.

`results_by_gait` splits an evaluation by the gait in which robots began and stayed. In
`evaluate_switching` each robot is told to change its gait six times in twenty seconds, and has to
stay up, keep stepping, and follow its command in each gait. Next: `robustness`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surefoot.config import Config
from surefoot.config.gait_table import gait_name, gait_names
from surefoot.evaluation.digits import as_digits
from surefoot.evaluation.statistics import Interval, wilson
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.jobs import Job, chunks_of, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, commands_to_follow, velocities
from surefoot.scenarios.gait_switches import draw_switches
from surefoot.scenarios.gaits import all_starts_of, gait_of
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray, PlanFunction, to_ticks
from surefoot.workers import Workers, map_chunks

CLOSE = 0.03
"""[m/s] A mean velocity follows its command if it differs by at most this."""
CLOSE_SHARE = 0.2
"""It also does if it differs by at most this share of the commanded speed."""
DURATION = 20.0
"""[s] Duration of the episodes in which robots change their gait."""
SWITCHES = 6
"""Number of changes of gait in each of these episodes."""

Errors = tuple[float | None, float | None, float | None]
"""The mean absolute error of vx, vy [m/s] and yaw rate [rad/s]; None without any robot."""


@dataclass(frozen=True)
class GaitSpeed:
    """How robots followed their commands in one gait.

    Attributes:
        gait: The name of the gait.
        robots: The number of robots.
        on_speed: The number of robots whose mean velocity was within `CLOSE` or `CLOSE_SHARE` of
            the command.
        error: The mean over the robots of the absolute error of their mean velocity.
    """

    gait: str
    robots: int
    on_speed: int
    error: Errors


@dataclass(frozen=True)
class GaitResult:
    """The results of robots that stayed in one gait.

    Attributes:
        episodes: The number of episodes.
        successes: The number of robots that did not fall, stall or diverge.
        success_interval: Wilson's 95 % interval of the share of successes.
        falls: The number of robots that fell.
        stalls: The number of robots that stayed up but stopped stepping.
        diverged: The number of robots for which the expert no longer found a valid plan.
        speed: How the successful robots followed their commands, over whole episodes.
    """

    episodes: int
    successes: int
    success_interval: Interval
    falls: int
    stalls: int
    diverged: int
    speed: GaitSpeed


@dataclass(frozen=True)
class Switching:
    """The results of robots that changed their gait by command.

    Attributes:
        seconds: The duration of an episode [s].
        switches: How often each robot changed its gait.
        episodes: The number of episodes; equally many begin in each gait.
        successes: The number of robots that stayed up and kept stepping.
        success_interval: Wilson's 95 % interval of the share of successes.
        falls: The number of robots that fell.
        outcomes: One digit for each episode, its `Outcome`.
        lost_at: When each robot that was lost fell, or the expert gave up on it [s].
        speeds: How robots followed their commands in each gait, from 1 s after each switch on.
    """

    seconds: float
    switches: int
    episodes: int
    successes: int
    success_interval: Interval
    falls: int
    outcomes: str
    lost_at: tuple[float, ...]
    speeds: tuple[GaitSpeed, ...]


@dataclass(frozen=True)
class _Walked:
    """The results of B episodes in which robots changed their gait.

    Attributes:
        outcome: ``(B,)`` values of `Outcome`.
        length: ``(B,)`` the number of ticks simulated.
        velocity: ``(B, gaits, 3)`` the mean velocity in each gait; NaN where it was not walked.
    """

    outcome: IntArray
    length: IntArray
    velocity: Array


def results_by_gait(summary: Summary, config: Config) -> tuple[GaitResult, ...]:
    """The results of an evaluation, gait by gait.

    Args:
        summary: The summary of the evaluation, with initial states of all gaits.
        config: The gaits.
    """
    gait = gait_of(summary.start)
    results = []
    for number, name in enumerate(gait_names(config.gaits)):
        mine = summary[gait == number]
        success = mine.outcome == Outcome.SUCCESS
        n = len(mine.outcome)
        count = int(success.sum())
        results.append(
            GaitResult(
                episodes=n,
                successes=count,
                success_interval=wilson(count, n),
                falls=int((mine.outcome == Outcome.FELL).sum()),
                stalls=int((mine.outcome == Outcome.STALLED).sum()),
                diverged=int((mine.outcome == Outcome.DIVERGED).sum()),
                speed=_speed(name, mine.mean_velocity[success], mine.command[success]),
            )
        )
    return tuple(results)


def follows(velocity: Array, command: Array) -> BoolArray:
    """``(n,)`` True where a mean velocity follows its command, by the tolerances above.

    Args:
        velocity: ``(n, 3)`` mean vx, vy [m/s] and yaw rate [rad/s].
        command: ``(n, 3)`` the commands.
    """
    away = np.linalg.norm(velocity[:, :2] - command[:, :2], axis=1)
    allowed = np.maximum(CLOSE, CLOSE_SHARE * np.linalg.norm(command[:, :2], axis=1))
    return np.asarray(away <= allowed)


def _speed(name: str, velocity: Array, command: Array) -> GaitSpeed:
    """How robots followed their commands; robots that did not walk in the gait are left out."""
    walked = np.isfinite(velocity).all(axis=1)
    velocity = velocity[walked]
    command = command[walked]
    error: Errors = (None, None, None)
    if len(velocity):
        vx, vy, yaw_rate = np.abs(velocity - command).mean(axis=0).tolist()
        error = (vx, vy, yaw_rate)
    return GaitSpeed(name, len(velocity), int(follows(velocity, command).sum()), error)


def evaluate_switching(
    config: Config,
    policy: Path | None,
    split: str,
    workers: Workers,
    plan: PlanFunction | None = None,
) -> Switching:
    """Let robots change gaits by command, from equally many stored initial states of each gait.

    Args:
        config: The robot, its gaits, the simulator and the expert; the number of the episodes.
        policy: File of the policy; None evaluates the expert.
        split: `select` or `test`.
        workers: Processes that run the episodes.
        plan: The expert's MPC; None for the BiConMP-style planner.

    Raises:
        ValueError: The configuration has only one gait, or a split has too few initial states.
    """
    job = switching_job(config, policy, split, plan)
    controller = "expert" if policy is None else f"policy {policy.stem}"
    parts = map_chunks(_walk, chunks_of(job), workers, f"{controller}: changes of gait")
    return switching_of(job, parts)


def switching_job(
    config: Config, policy: Path | None, split: str, plan: PlanFunction | None = None
) -> Job:
    """The episodes of `evaluate_switching`, with the same arguments."""
    if not config.other_gaits:
        raise ValueError(
            f"robots of one gait, {gait_name(config.gait)}, have none to change to: train a policy "
            "of several, with --gaits"
        )
    stored = all_starts_of(config)
    of_each = -(-config.evaluation.episodes // len(config.gaits))
    starts = stored.first(split, of_each)
    config = replace(config, seed=stored.seed, switches=SWITCHES)
    switches = draw_switches(config, starts, DURATION, starts.id)
    return Job(
        config,
        Episodes(starts, DURATION, id=starts.id, switches=switches),
        ExpertOnly() if policy is None else PolicyOnly(),
        policy=policy,
        plan=plan,
        disturbance=config.evaluation.disturbance,
        privileged=False,
    )


def switching_of(job: Job, parts: Sequence[_Walked]) -> Switching:
    """The figures of episodes in which robots changed their gait.

    Args:
        job: The job.
        parts: The results of each of its chunks.
    """
    outcome = np.concatenate([part.outcome for part in parts])
    length = np.concatenate([part.length for part in parts])
    velocity = np.concatenate([part.velocity for part in parts])
    success = outcome == Outcome.SUCCESS
    lost = (outcome == Outcome.FELL) | (outcome == Outcome.DIVERGED)
    names = gait_names(job.config.gaits)
    told = [
        commands_to_follow(job.starts.command, np.array(number), job.config.gaits)
        for number in range(len(names))
    ]
    return Switching(
        seconds=job.episodes.duration,
        switches=job.config.switches,
        episodes=len(outcome),
        successes=int(success.sum()),
        success_interval=wilson(int(success.sum()), len(outcome)),
        falls=int((outcome == Outcome.FELL).sum()),
        outcomes=as_digits(outcome),
        lost_at=tuple((length[lost] / TICKS_PER_SECOND).tolist()),
        speeds=tuple(
            _speed(name, velocity[:, number], told[number]) for number, name in enumerate(names)
        ),
    )


def _walk(job: Job) -> _Walked:
    """Run the episodes of one chunk."""
    rollouts, _ = play_out(job)
    return _Walked(rollouts.outcome, rollouts.length, mean_by_gait(rollouts, len(job.config.gaits)))


def mean_by_gait(rollouts: Rollout, gaits: int) -> Array:
    """``(B, gaits, 3)`` mean velocity of each robot in each gait, once settled; NaN without any.

    Args:
        rollouts: What happened in B episodes.
        gaits: The number of gaits.
    """
    gait = rollouts.gait
    velocity = velocities(rollouts)
    settled = rollouts.happened & _since_switch(gait)
    means = np.full((len(gait), gaits, 3), np.nan)
    for robot, number in np.ndindex(len(gait), gaits):
        ticks = settled[robot] & (gait[robot] == number)
        # The last half second before a fall does not count as walking.
        if rollouts.failed[robot]:
            ticks[max(rollouts.length[robot] - to_ticks(0.5), 0) :] = False
        if ticks.any():
            means[robot, number] = velocity[robot, ticks].mean(axis=0)
    return means


def _since_switch(gait: IntArray) -> BoolArray:
    """``(B, T)`` True where a robot has walked its gait for a second or longer."""
    ticks = np.arange(gait.shape[1])
    changed = np.zeros(gait.shape, dtype=np.int64)
    changed[:, 1:] = np.where(np.diff(gait, axis=1) != 0, ticks[1:], 0)
    began = np.maximum.accumulate(changed, axis=1)
    return np.asarray(ticks - began >= TICKS_PER_SECOND)
