"""What is computed from the episodes of a cell of the survey of robots.

Each process plays a chunk of the episodes, and keeps what `MeasuredEpisodes` says. Next:
`robot_survey`, which measures the cells, and `robot_cells`, their records.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from surefoot.learning.frames import concatenate
from surefoot.robots.load import load_robot
from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.jobs import Job, play_out, summarize_job
from surefoot.rollouts.summary import Summary, join_summaries, settled_part, velocities
from surefoot.scenarios.preparation import Triple
from surefoot.study.robot_cells import Tracking, Use
from surefoot.types import Array, to_ticks


@dataclass(frozen=True)
class MeasuredEpisodes:
    """What is kept of n episodes; the first axis is the episode.

    Attributes:
        summary: How they ended.
        error: ``(n, 3)`` absolute error of the mean vx, vy [m/s] and yaw rate [rad/s] from 1 s on,
            over whole gait periods.
        torque: ``(n, 3)`` largest share of the torque limits from 1 s on, largest share overall,
            and share of the time from 1 s on at a limit.
        speed: ``(n, 3)`` the same for the speed limits; zero for joints without one.
    """

    summary: Summary
    error: Array
    torque: Array
    speed: Array


def measure_episodes(job: Job) -> MeasuredEpisodes:
    """Run the episodes of one chunk in this process.

    Args:
        job: The chunk.
    """
    rollouts, expert = play_out(job)
    robot = load_robot(job.config.robot)
    T = rollouts.duration
    settled = settled_part(T)
    share = partial(used, settled=settled)
    return MeasuredEpisodes(
        summary=summarize_job(job, rollouts, expert, concatenate([]).kept_frames),
        error=tracking_error(rollouts, to_ticks(job.config.gait.period)),
        torque=share(np.abs(rollouts.torque[:, :T]) / robot.torque_limit),
        speed=share(np.abs(rollouts.v[:, :T, 6:]) / robot.speed_limit),
    )


def tracking_error(rollouts: Rollout, period: int) -> Array:
    """``(n, 3)`` absolute error of the mean velocity from 1 s on, over whole gait periods.

    Args:
        rollouts: The n episodes; the errors of those that ended early mean nothing.
        period: The gait period [ms].
    """
    T = rollouts.duration
    settled = settled_part(T)
    ticks = T - settled.start
    ticks = ticks // period * period or ticks  # so that a gait's sway cancels
    reached = velocities(rollouts)[:, T - ticks : T].mean(axis=1)
    return np.abs(reached - rollouts.starts.command)


def used(share: Array, settled: slice) -> Array:
    """``(n, 3)`` largest share when settled, largest overall, share of settled time at a limit.

    Args:
        share: ``(n, T, 12)`` shares of the limits.
        settled: The ticks of the settled part.
    """
    largest = share.max(axis=2)
    return np.stack(
        [
            largest[:, settled].max(axis=1),
            largest.max(axis=1),
            (largest[:, settled] >= 1.0).mean(axis=1),
        ],
        axis=1,
    )


def join_episodes(parts: Sequence[MeasuredEpisodes]) -> MeasuredEpisodes:
    """The episodes of several chunks, one after another."""
    return MeasuredEpisodes(
        join_summaries([part.summary for part in parts]),
        np.concatenate([part.error for part in parts]),
        np.concatenate([part.torque for part in parts]),
        np.concatenate([part.speed for part in parts]),
    )


def tracking_of(error: Array) -> Tracking | None:
    """The mean and the largest of ``(n, 3)`` errors; None without any."""
    if not len(error):
        return None
    return Tracking(_triple(error.mean(axis=0)), _triple(error.max(axis=0)))


def use_of(share: Array) -> Use | None:
    """The use of the limits in n episodes, from the ``(n, 3)`` of `used`; None without any."""
    if not len(share):
        return None
    settled, peak, _ = share.max(axis=0).tolist()
    return Use(settled, peak, float(share[:, 2].mean()))


def _triple(values: Array) -> Triple:
    """Three numbers as a tuple, for a record."""
    x, y, z = values.tolist()
    return x, y, z
