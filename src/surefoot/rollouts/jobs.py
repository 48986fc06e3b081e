"""Runs many episodes: cuts them into chunks, spreads these over processes, and summarizes them.

A job is everything that determines its episodes: configuration, initial states, ids, arbiter,
policy file. A chunk is simulated in lockstep by one process (`run_chunk`), which returns a
`Summary`, the frames that the method keeps, and a `Trace` if the job asks for one. Methods and
evaluation build on `run_episodes`, `chunks_of` and `play_out`. Read `engine` next for what one
rollout does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from numpy.typing import NDArray

from surefoot.config import Config, DisturbanceConfig, RobotConfig
from surefoot.learning.frames import Frames, concatenate
from surefoot.learning.policy import Policy, load
from surefoot.mpc.expert import Expert, make_expert, make_plan
from surefoot.mpc.identity import plan_names
from surefoot.robots.identity import content_hash
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import own_pushes, with_own_values
from surefoot.rollouts.arbiters import Arbiter
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.summary import EpisodeInfo, Summary, join_summaries, summarize
from surefoot.rollouts.traces import Trace, trace_of
from surefoot.scenarios.disturbance import Disturbance, draw_disturbances
from surefoot.scenarios.ground import draw_ground
from surefoot.scenarios.starts import Starts
from surefoot.sim import make_simulator
from surefoot.sim.terrain import Ground
from surefoot.types import BoolArray, IntArray, PlanFunction
from surefoot.workers import Workers, map_chunks

PLANNER = "surefoot.mpc.planner"
"""Name of the package's own expert. Summaries of runs contain it, so it stays the same even if the
module is renamed."""
Keep = Callable[[Rollout], BoolArray]
"""The rule of a method for its dataset: ``(B, T)`` True for the frames of a rollout to keep. It may
be asked about any part of a job, so it must judge each episode by that episode alone."""
FollowUp = Callable[["Job", Rollout], "Job | None"]
"""The rule for episodes that follow from a chunk: given the chunk's job and rollout, it returns the
job of further episodes, or None. These run in the same process right after the chunk, and their
summary and frames are appended to the chunk's. It must judge each episode by that episode alone."""


@dataclass(frozen=True)
class Job:
    """Episodes to run, everything that determines them, and what to return.

    Attributes:
        config: The configuration: robot, simulator, expert, fall bounds, root seed, chunk size.
        episodes: Where the episodes begin, how long they last, and their ids. Their disturbance, if
            there is one, takes the place of the drawn one.
        arbiter: Decides at every tick who drives.
        policy: The policy or its file, if the arbiter needs one.
        plan: The expert's MPC: a function, or any other object that can be called like one. None
            is the BiConMP-style planner.
        disturbance: What disturbs the robots, drawn from the root seed and the ids, and how far the
            robots may tilt under it.
        ask_always: Whether the expert is asked at every tick, see `rollout`.
        query: Whether these are the expert's rollouts from states of other episodes (LocoDAGGER).
        keep: The rule that says which frames to return; None returns none.
        then: The rule for episodes that follow from a chunk's rollout; None if none follow.
        trace: Whether to return what a history gate learns from.
        privileged: Whether the expert and the arbiter see the states without the drawn noise; False
            in an evaluation, which may be judging the expert.
    """

    config: Config
    episodes: Episodes
    arbiter: Arbiter
    policy: Path | Policy | None = None
    plan: PlanFunction | None = None
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    ask_always: bool = False
    query: bool = False
    keep: Keep | None = None
    then: FollowUp | None = None
    trace: bool = False
    privileged: bool = True

    def __getitem__(self, rows: slice | NDArray) -> Job:
        """The same job with some of its episodes."""
        return replace(self, episodes=self.episodes[rows])

    @property
    def starts(self) -> Starts:
        """The initial states of the episodes."""
        return self.episodes.starts

    @property
    def episode(self) -> IntArray:
        """``(n,)`` ids of the episodes."""
        return self.episodes.ids


@dataclass(frozen=True)
class ChunkResult:
    """What is kept of a chunk of episodes.

    Attributes:
        summary: How its episodes ended, and what they cost.
        recording: The frames that the job's rule keeps, with the ticks that policies remember
            there.
        trace: What a history gate learns from, if the job asks for it.
    """

    summary: Summary
    recording: Frames
    trace: Trace | None

    @property
    def frames(self) -> Frames:
        """The frames that the job's rule keeps."""
        return self.recording.kept_frames


def expert_name(job: Job) -> str:
    """The short name of a job's expert: the package's planner, or the plan function's own name.

    It does not tell two lambdas apart; `surefoot.mpc.identity` does.
    """
    if job.plan is None:
        return PLANNER
    _, name = plan_names(job.plan)
    return name


def run_episodes(job: Job, workers: Workers, title: str) -> Summary:
    """Run all episodes of a job; the same results, bit for bit, for any number of workers.

    Args:
        job: The episodes.
        workers: The processes that run them.
        title: Text of the progress bar.
    """
    results = map_chunks(run_chunk, chunks_of(job), workers, title)
    return join_summaries([result.summary for result in results])


def chunks_of(job: Job) -> list[Job]:
    """The job cut into chunks that are simulated together; the cuts depend on the job alone.

    Every chunk carries the policy itself, for workers that cannot see its file.
    """
    job = replace(job, policy=_policy_of(job))
    size = job.config.chunk
    return [job[first : first + size] for first in range(0, len(job.episodes), size)]


def run_chunk(job: Job) -> ChunkResult:
    """Run the episodes of one chunk in this process, and those that follow from them."""
    rollouts, expert = play_out(job)
    recording = concatenate([])
    if job.keep is not None:
        recording = rollouts.recording(job.keep(rollouts), job.episode)
    summary = summarize_job(job, rollouts, expert, recording.kept_frames)
    trace = trace_of(rollouts, job.episode, _own(job.config)) if job.trace else None
    following = None if job.then is None else job.then(job, rollouts)
    if following is not None:
        more = run_chunk(following)
        summary = join_summaries([summary, more.summary])
        recording = concatenate([recording, more.recording])
    return ChunkResult(summary, recording, trace)


def summarize_job(job: Job, rollouts: Rollout, expert: Expert, frames: Frames) -> Summary:
    """The summary of a job's episodes.

    Args:
        job: The job.
        rollouts: What happened, from `play_out`.
        expert: The expert that took part, from `play_out`.
        frames: The frames that are kept.
    """
    config = _own(job.config)
    info = EpisodeInfo(
        episode=job.episode,
        query=job.query,
        expert=expert_name(job),
        plans=expert.plans,
        invalid_plans=expert.invalid_plans,
    )
    return summarize(rollouts, frames, info, _robot(config.robot), config)


def disturbance_of(job: Job) -> Disturbance:
    """What disturbs a job's robots: the disturbance of its episodes, or else one that is drawn."""
    if job.episodes.disturbance is not None:
        return job.episodes.disturbance
    config = job.config
    duration = job.episodes.duration
    tail = job.episodes.tail
    if job.query:  # all of it counts as tail: the expert drives in order to teach
        tail = duration
        duration = 0.0
    friction = config.simulation.friction
    pushes = own_pushes(job.disturbance, _robot(config.robot))
    drawn = draw_disturbances(pushes, config.seed, job.episode, duration, friction, tail)
    return replace(drawn, privileged=job.privileged)


def ground_of(job: Job) -> Ground | None:
    """The ground of a job's robots: that of its episodes, or else one that is drawn."""
    ground = job.episodes.ground
    if ground is not None:
        return ground
    terrains = job.config.simulation.terrains
    if not terrains:
        return None
    robot = _robot(job.config.robot)
    return draw_ground(terrains, job.config.seed, job.episode, robot, job.starts.q)


def play_out(job: Job, progress: Callable[[int], object] | None = None) -> tuple[Rollout, Expert]:
    """Run all episodes of a job in lockstep, in this process.

    Args:
        job: The episodes.
        progress: Called with the number of ticks done since its last call.

    Returns:
        What happened, and the expert that took part. It is made for this rollout alone, so its
        ``plans`` and ``invalid_plans`` count the plans of these episodes.
    """
    config = _own(job.config)
    robot = _robot(config.robot)
    ground = ground_of(job)
    # A plan function may be an object that counts as false, such as a list that can be called.
    expert = make_expert(robot, config, _plan(config) if job.plan is None else job.plan)
    fall_angle = max(config.safety.fall_angle, job.disturbance.fall_angle)
    rollouts = rollout(
        make_simulator(robot, len(job.episodes), config.simulation, ground),
        replace(job.episodes, disturbance=disturbance_of(job), ground=ground),
        job.arbiter,
        expert,
        _policy_of(job),
        replace(config.safety, fall_angle=fall_angle),
        job.ask_always,
        progress,
    )
    return rollouts, expert


def _policy_of(job: Job) -> Policy | None:
    """The job's policy, read if it is a file."""
    if isinstance(job.policy, Path):
        return load(job.policy, _robot(job.config.robot).name)
    return job.policy


def _robot(config: RobotConfig) -> RobotModel:
    """The robot of a configuration, as its files are now; built once per process."""
    return _robot_of(config, content_hash(config))


def _own(config: Config) -> Config:
    """The configuration with the robot's own values in place of None."""
    return _own_of(config, content_hash(config.robot))


def _plan(config: Config) -> PlanFunction:
    """The planner of a configuration; planning does not change it."""
    return _plan_of(config, content_hash(config.robot))


# The cache keys contain the content of a robot's files; the configuration has only their names.


@lru_cache(maxsize=4)
def _robot_of(config: RobotConfig, content: str) -> RobotModel:
    return load_robot(config)


@lru_cache(maxsize=4)
def _own_of(config: Config, content: str) -> Config:
    return with_own_values(config, _robot_of(config.robot, content))


@lru_cache(maxsize=4)
def _plan_of(config: Config, content: str) -> PlanFunction:
    return make_plan(_robot_of(config.robot, content), config)
