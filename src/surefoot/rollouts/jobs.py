"""Many episodes: cut into chunks, spread over processes, summed up.

A job is all that fixes its episodes: configuration, starts, ids, arbiter, policy file. Each process
builds robot and expert once. Methods and evaluation are written on `run_episodes`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from numpy.typing import NDArray

from surefoot.config import Config, DisturbanceConfig
from surefoot.learning.frames import Frames, concatenate
from surefoot.learning.policy import Policy, load
from surefoot.mpc.expert import Expert, make_expert
from surefoot.robots.model import RobotModel
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import Arbiter
from surefoot.rollouts.engine import Rollout, rollout
from surefoot.rollouts.summary import Summary, join, summarise
from surefoot.rollouts.traces import Trace, trace_of
from surefoot.scenarios.disturbance import Disturbance, Pushes, draw_disturbances
from surefoot.scenarios.starts import Starts
from surefoot.sim import make_simulator
from surefoot.types import BoolArray, IntArray, PlanFunction, to_ticks
from surefoot.workers import Workers, map_chunks

PLANNER = "surefoot.mpc.planner"
"""Name of the package's own expert."""
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
        disturbance: what disturbs the robots, drawn from the seed and the ids, and how far they may
            tilt then.
        pushes: of the episodes, instead of drawn ones.
        ask_always: the expert is asked at every tick, see `rollout`.
        query: these are the expert's rollouts from states of other episodes.
        then: episodes that follow from a chunk's rollout, if any.
        trace: whether to return what a history gate learns from.
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
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    pushes: Pushes | None = None
    ask_always: bool = False
    query: bool = False
    then: Callable[[Job, Rollout], Job | None] | None = None
    trace: bool = False

    def __getitem__(self, rows: slice | NDArray) -> Job:
        """Some of the episodes."""
        pushes = None if self.pushes is None else self.pushes[rows]
        return replace(self, starts=self.starts[rows], episode=self.episode[rows], pushes=pushes)


@dataclass(frozen=True)
class Result:
    """What is left of a chunk: its figures, the frames to keep, and a trace where asked."""

    summary: Summary
    frames: Frames
    trace: Trace | None


def expert_name(job: Job) -> str:
    """Whose plans a job's expert follows: the package's planner, or a function by its name."""
    return PLANNER if job.plan is None else job.plan.__qualname__


def run_episodes(job: Job, workers: Workers, label: str) -> Summary:
    """Run all episodes of a job; the same results, bit for bit, for any number of workers."""
    results = map_chunks(run_chunk, chunks_of(job), workers, label)
    return join([result.summary for result in results])


def chunks_of(job: Job) -> list[Job]:
    """The job cut into what is simulated together; depends on nothing but the job.

    The policy comes with every chunk, for workers that cannot see its file.
    """
    job, size = replace(job, policy=_policy(job)), job.config.chunk
    return [job[first : first + size] for first in range(0, len(job.starts), size)]


def run_chunk(job: Job) -> Result:
    """Run the episodes of one chunk in this process, and those that follow from them."""
    record, expert = play_out(job)
    frames = concatenate([])
    if job.keep is not None:
        frames = record.frames(job.keep(record), job.episode)
    summary = sum_up(job, record, expert, frames)
    trace = trace_of(record, job.episode, job.config) if job.trace else None
    if job.then is not None and (following := job.then(job, record)) is not None:
        more = run_chunk(following)
        summary = join([summary, more.summary])
        frames = concatenate([frames, more.frames])
    return Result(summary, frames, trace)


def sum_up(job: Job, record: Rollout, expert: Expert, frames: Frames) -> Summary:
    """The figures of a job that was played out, and of the frames kept of it."""
    robot, _ = _team(job.config, job.plan)
    return summarise(
        record,
        frames,
        episode=job.episode,
        query=job.query,
        expert=expert_name(job),
        plans=expert.plans.copy(),
        invalid_plans=expert.invalid_plans.copy(),
        foot_radius=robot.foot_radius,
        gait_period=to_ticks(job.config.gait.period),
        safety=job.config.safety,
    )


def disturbance_of(job: Job) -> Disturbance:
    """What disturbs a job's robots: drawn from its seed and ids, with the pushes it gives."""
    config = job.config
    # A query is all tail: the expert drives in order to teach.
    duration, tail = (0.0, job.duration) if job.query else (job.duration, job.tail)
    friction = config.simulation.friction
    drawn = draw_disturbances(job.disturbance, config.seed, job.episode, duration, friction, tail)
    return drawn if job.pushes is None else replace(drawn, pushes=job.pushes)


def play_out(job: Job, progress: Callable[[int], object] | None = None) -> tuple[Rollout, Expert]:
    """The rollout of a job's episodes, all in lockstep, and the expert that took part."""
    config = job.config
    robot, expert = _team(config, job.plan)
    fall_angle = max(config.safety.fall_angle, job.disturbance.fall_angle)
    simulator = make_simulator(robot, len(job.starts), config.simulation)
    record = rollout(
        simulator,
        robot,
        job.starts,
        job.duration,
        job.arbiter,
        expert,
        _policy(job),
        job.tail,
        replace(config.safety, fall_angle=fall_angle),
        disturbance_of(job),
        job.episode,
        job.ask_always,
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
