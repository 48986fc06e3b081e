"""Many episodes: cut into chunks, spread over processes, summed up.

A job is all that fixes its episodes: configuration, starts, ids, arbiter, policy file. Each process
builds robot and expert once. Methods and evaluation are written on `run_episodes`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config
from surefoot.dataset import Frames, concatenate
from surefoot.engine import Arbiter, Pushes, Rollout, rollout
from surefoot.files import write_atomic
from surefoot.mpc.expert import Expert, make_expert
from surefoot.policy import Policy, load
from surefoot.robot import RobotModel, solo12
from surefoot.rotations import heading, rotation, to_heading
from surefoot.safety import strictly_stepping
from surefoot.sim import make_simulator
from surefoot.starts import Starts
from surefoot.types import (
    TICKS_PER_SECOND,
    Array,
    BoolArray,
    IntArray,
    PlanFunction,
    to_ticks,
)
from surefoot.workers import Workers, map_chunks

Keep = Callable[[Rollout], BoolArray]
"""A method's rule: ``(B, T)`` True for the frames of a rollout that go into the dataset."""


@dataclass(frozen=True)
class Job:
    """Episodes to run, and all that fixes them.

    Attributes:
        config: of robot, simulator, expert, bounds.
        starts: one per episode.
        episode: ``(n,)`` ids.
        arbiter: who drives.
        duration: T [s].
        tail: [s] of expert driving at the end.
        policy: the policy or its file, where the arbiter needs one.
        keep: the frames to return; none without it.
        plan: the expert's MPC, any plain function; without it the BiConMP-style planner.
        pushes: of the episodes, if they are pushed.
    """

    config: Config
    starts: Starts
    episode: IntArray
    arbiter: Arbiter
    duration: float
    tail: float = 0.0
    policy: Path | Policy | None = None
    keep: Keep | None = None
    plan: PlanFunction | None = None
    pushes: Pushes | None = None

    def __getitem__(self, rows: slice | NDArray) -> Job:
        """Some of the episodes."""
        pushes = None if self.pushes is None else self.pushes[rows]
        return replace(self, starts=self.starts[rows], episode=self.episode[rows], pushes=pushes)


@dataclass(frozen=True)
class Summary:
    """What is left of n episodes besides their frames; first axis the episode.

    Attributes:
        episode: ``(n,)`` ids.
        start: ``(n,)`` ids of the starts.
        expert: ``(n,)`` `expert_name`.
        command: ``(n, 3)`` [m/s, m/s, rad/s].
        outcome: ``(n,)`` of `Outcome`.
        ticks: ``(n,)`` simulated [ms], tail included.
        proper_ticks: ``(n,)`` of them before the tail.
        expert_ticks: ``(n,)`` ticks before the tail that the expert drove.
        expert_drove_last: ``(n,)`` True where the expert drove the last tick.
        expert_drove_before: ``(n,)`` True where it drove 0.5 s before that.
        plans: ``(n,)`` MPC solves.
        invalid_plans: ``(n,)`` of them not valid.
        kept: ``(n,)`` frames kept.
        strict: ``(n,)`` True where every foot stepped in every 1.5 periods over 2/3 of T.
        mean_velocity: ``(n, 3)`` vx, vy, yaw rate in the heading frame [m/s, m/s, rad/s].
        mse: ``(n, 3)`` mean squared velocity error over the whole episode.
        settled_mse: ``(n, 3)`` the same from 1 s on; NaN for shorter episodes.
        max_torque: ``(n,)`` largest applied joint torque [Nm].
    """

    episode: IntArray
    start: IntArray
    expert: NDArray[np.str_]
    command: Array
    outcome: IntArray
    ticks: IntArray
    proper_ticks: IntArray
    expert_ticks: IntArray
    expert_drove_last: BoolArray
    expert_drove_before: BoolArray
    plans: IntArray
    invalid_plans: IntArray
    kept: IntArray
    strict: BoolArray
    mean_velocity: Array
    mse: Array
    settled_mse: Array
    max_torque: Array


def expert_name(job: Job) -> str:
    """Whose plans a job's expert follows: the package's planner, or a function by its name."""
    return "surefoot.mpc.planner" if job.plan is None else job.plan.__qualname__


def run_episodes(job: Job, workers: Workers, label: str) -> Summary:
    """Run all episodes of a job; the same results, bit for bit, for any number of workers."""
    results = map_chunks(run_chunk, chunks_of(job), workers, label)
    return join([summary for summary, _ in results])


def chunks_of(job: Job) -> list[Job]:
    """The job cut into what is simulated together; depends on nothing but the job.

    The policy comes with every chunk, for workers that cannot see its file.
    """
    job, size = replace(job, policy=_policy(job)), job.config.chunk
    return [job[first : first + size] for first in range(0, len(job.starts), size)]


def join(parts: Sequence[Summary]) -> Summary:
    """Episodes of several summaries, one after another."""
    names = [field.name for field in fields(Summary)]
    return Summary(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def save_summary(path: Path, summary: Summary) -> None:
    """Write a summary, whole or not at all."""
    buffer = BytesIO()
    np.savez(buffer, **vars(summary))
    write_atomic(path, buffer.getvalue())


def load_summary(path: Path) -> Summary:
    """Read a summary back, to the bit.

    Raises:
        FileNotFoundError: there is none.
        ValueError: the file is damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            return Summary(**{name: stored[name] for name in stored.files})
    except FileNotFoundError:
        raise
    except Exception as error:  # whatever zip, zlib and NumPy make of a damaged file
        raise ValueError(f"{path} is damaged ({error}); delete it to collect it again") from error


def run_chunk(job: Job) -> tuple[Summary, Frames]:
    """Run the episodes of one chunk in this process."""
    record, expert = play_out(job)
    frames = concatenate([])
    if job.keep is not None:
        frames = record.frames(job.keep(record), job.episode)
    return summarise(record, job, expert, frames), frames


def play_out(job: Job, progress: Callable[[int], object] | None = None) -> tuple[Rollout, Expert]:
    """The rollout of a job's episodes, all in lockstep, and the expert that took part."""
    robot, expert = _team(job.config, job.plan)
    simulator = make_simulator(robot, len(job.starts), job.config.simulation)
    record = rollout(
        simulator,
        robot,
        job.starts,
        job.duration,
        job.arbiter,
        expert,
        _policy(job),
        job.tail,
        job.config.safety,
        job.pushes,
        progress,
    )
    return record, expert


def _policy(job: Job) -> Policy | None:
    """The job's policy, read if it is a file."""
    if isinstance(job.policy, Path):
        return load(job.policy, _team(job.config, job.plan)[0].name)
    return job.policy


@lru_cache(maxsize=4)
def _team(config: Config, plan: PlanFunction | None) -> tuple[RobotModel, Expert]:
    robot = solo12(config.robot)
    return robot, make_expert(robot, config, plan)


def velocities(record: Rollout) -> Array:
    """``(B, T, 3)`` base vx, vy [m/s] and yaw rate [rad/s] in the heading frame."""
    R = rotation(record.q[..., 3:7])
    linear = np.einsum("...ij,...j->...i", R, record.v[..., :3])
    yaw_rate = np.einsum("...j,...j->...", R[..., 2, :], record.v[..., 3:6])
    horizontal = to_heading(linear[..., :2], heading(R))
    return np.concatenate([horizontal, yaw_rate[..., None]], axis=-1)


def summarise(record: Rollout, job: Job, expert: Expert, frames: Frames) -> Summary:
    """The figures of a rollout."""
    B, T = len(record.length), record.duration
    proper, by_expert = record.happened[:, :T], record.expert_drove & record.happened
    last = np.maximum(record.length - 1, 0)
    before = np.maximum(record.length - 1 - TICKS_PER_SECOND // 2, 0)
    robots = np.arange(B)
    velocity = velocities(record)[:, :T]
    error = (velocity - record.starts.command[:, None]) ** 2
    settled = proper & (np.arange(T) >= TICKS_PER_SECOND)
    torque = np.abs(record.torque[:, :T]).max(axis=2)
    return Summary(
        episode=job.episode,
        start=record.starts.id,
        expert=np.full(B, expert_name(job)),
        command=record.starts.command,
        outcome=record.outcome,
        ticks=record.length,
        proper_ticks=proper.sum(axis=1),
        expert_ticks=by_expert[:, :T].sum(axis=1),
        expert_drove_last=by_expert[robots, last],
        expert_drove_before=by_expert[robots, before],
        plans=expert.plans.copy(),
        invalid_plans=expert.invalid_plans.copy(),
        kept=np.array([(frames.episode == episode).sum() for episode in job.episode]),
        strict=strictly_stepping(
            record.feet[:, :T, :, 2],
            record.contacts[:, :T],
            _team(job.config, job.plan)[0].foot_radius,
            to_ticks(job.config.gait.period),
        ),
        mean_velocity=_mean(velocity, proper),
        mse=_mean(error, proper),
        settled_mse=_mean(error, settled),
        max_torque=np.where(proper, torque, 0.0).max(axis=1),
    )


def _mean(values: Array, mask: BoolArray) -> Array:
    """Mean over the ticks in the mask, ``(B, T, 3) -> (B, 3)``; NaN without any."""
    total = np.where(mask[..., None], values, 0.0).sum(axis=1)
    count = mask.sum(axis=1)[:, None]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
