"""An episode on a robot as the rollout that a simulator would have given.

`EpisodeLog` keeps every tick in which the robot is driven, `rollout_of` makes arrays with a row for
each tick of the gait clock, and `result_of` what a run stores of it. What nothing measures is
filled in: the robot stays above the origin, and its feet touch the ground where no other foot is
much lower. Read `session` next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surefoot.config import Config
from surefoot.deploy.interfaces import JointCommand, Sensors
from surefoot.deploy.loop import Mode
from surefoot.deploy.recorder import Flight, FlightRecorder, TickRecord
from surefoot.learning.frames import concatenate
from surefoot.robots.geometry import state_of
from surefoot.robots.model import RobotModel, clip_torque
from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.jobs import ChunkResult, Job, expert_name
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import EpisodeInfo, summarize
from surefoot.rollouts.traces import trace_of
from surefoot.types import Array, BoolArray, to_ticks

REPEATED = 1000
"""So many measurements may fall into the same millisecond of the gait clock as the one before."""
CONTACT = 0.005
"""[m] A foot that is no higher above the lowest one touches the ground."""


class EpisodeLog:
    """Keeps the ticks of an episode in which the robot is driven; a `Listener`.

    An episode that begins anew, since the operator let the robot stand meanwhile, is kept anew;
    what the robot went through before is counted all the same.

    Args:
        robot: The name of the robot.
        proper: How many ticks the episode has before its tail.
        tail: How many ticks the expert is to drive then.

    Attributes:
        ticks: What the gait clock has reached [ms]; 0 before the first tick.
        expert_ticks: How many ticks the expert drove, before the episode began anew too.
        takeovers: How often the expert took over from the policy, then too, but for the tail.
        stood: Whether the robot stood in the last tick in which it was not damped.
    """

    def __init__(self, robot: str, proper: int, tail: int) -> None:
        self._robot = robot
        self._proper = proper
        self._total = proper + tail
        self.expert_ticks = 0
        self.takeovers = 0
        self._before = 0  # ticks driven until the episode began anew
        self._begin()

    @property
    def driven(self) -> int:
        """How many ticks the robot was driven, before the episode began anew too."""
        return self._before + self.ticks

    @property
    def whole(self) -> bool:
        """Whether the episode is over."""
        return self.ticks >= self._total

    def __call__(self, record: TickRecord, sensors: Sensors, command: JointCommand | None) -> None:
        """Keep a tick; see `FlightRecorder.add`."""
        if record.mode == Mode.STAND:
            self.stood = True
        if record.mode != Mode.DRIVE or command is None or self.whole:
            return
        if self.stood:
            self._before += self.ticks
            self._begin()
        self._recorder.add(record, sensors, command)
        if record.expert_drove:
            self.expert_ticks += record.gait_tick + 1 - self.ticks
        self.ticks = record.gait_tick + 1
        took_over = record.expert_drove and not self._expert_drove
        self.takeovers += took_over and record.gait_tick < self._proper
        self._expert_drove = record.expert_drove

    def flight(self) -> Flight:
        """What has been kept, the oldest tick first."""
        return self._recorder.flight()

    def _begin(self) -> None:
        """Keep nothing yet."""
        self._recorder = FlightRecorder(self._robot, ticks=self._total + REPEATED)
        self.ticks = 0
        self.stood = False
        self._expert_drove = False


@dataclass(frozen=True)
class RecordedEpisode:
    """An episode that a robot has walked.

    Attributes:
        log: Its ticks, those in which the robot was driven.
        outcome: How it ended.
        plans: Number of MPC solves.
        invalid_plans: Number of MPC solves that were not valid.
    """

    log: EpisodeLog
    outcome: Outcome
    plans: int
    invalid_plans: int

    @property
    def flight(self) -> Flight:
        """Its ticks as arrays, made anew: too slow for the thread that drives."""
        return self.log.flight()


def result_of(job: Job, episode: RecordedEpisode, robot: RobotModel, config: Config) -> ChunkResult:
    """What a run stores of an episode, as `rollouts.jobs.run_chunk` does of simulated ones.

    Args:
        job: The job of the episode, one of one robot.
        episode: What happened.
        robot: The robot.
        config: The configuration, with the robot's own values.
    """
    rollout, measured = rollout_of(job, episode, robot)
    recording = concatenate([])
    if job.keep is not None:
        # What happened in the ticks that nothing measured is not known.
        recording = rollout.recording(job.keep(rollout) & measured, job.episode)
    info = EpisodeInfo(
        episode=job.episode,
        query=False,
        expert=expert_name(job),
        plans=np.array([episode.plans]),
        invalid_plans=np.array([episode.invalid_plans]),
    )
    summary = summarize(rollout, recording.kept_frames, info, robot, config)
    trace = trace_of(rollout, job.episode, config) if job.trace else None
    return ChunkResult(summary, recording, trace)


def rollout_of(job: Job, episode: RecordedEpisode, robot: RobotModel) -> tuple[Rollout, BoolArray]:
    """An episode as a rollout of one robot, and ``(1, T)`` True for the ticks that were measured.

    A tick of the gait clock that the runtime has missed repeats the one before it.

    Args:
        job: The job of the episode, one of one robot.
        episode: What happened; one tick of it at least.
        robot: The robot.
    """
    flight = episode.flight
    proper = to_ticks(job.episodes.duration)
    total = proper + to_ticks(job.episodes.tail)
    clock = np.arange(total)
    row = np.maximum(np.searchsorted(flight.gait_tick, clock, side="right") - 1, 0)
    measured = flight.gait_tick[row] == clock
    q, v = _motion_of(flight)
    state = state_of(robot, q, v)
    lowest = state.feet[:, :, 2].min(axis=1, keepdims=True)
    state = replace(state, contacts=state.feet[:, :, 2] <= lowest + CONTACT)
    seen = state[row[None]]
    torque = commanded_torque(flight, robot)[row][None]
    drove = flight.expert_drove[row][None]
    # The command is the one that was asked for, within what the policy was trained on.
    starts = replace(job.starts, q=q[:1], v=v[:1], command=flight.command[:1])
    rollout = Rollout(
        q=seen.q,
        v=seen.v,
        com=seen.com,
        feet=seen.feet,
        contacts=seen.contacts,
        seen=seen,
        torque=torque,
        expert_torque=torque,
        expert_drove=drove,
        expert_asked=drove,
        body_contact=np.zeros((1, total), dtype=bool),
        starts=starts,
        length=np.array([min(int(flight.gait_tick[-1]) + 1, total)]),
        outcome=np.array([episode.outcome], dtype=np.int64),
        duration=proper,
    )
    return rollout, measured[None]


def commanded_torque(flight: Flight, robot: RobotModel) -> Array:
    """``(n, 12)`` the torques that the motors were to apply in each tick, clipped [N m].

    Args:
        flight: The ticks.
        robot: The robot, for the limits.
    """
    # The order of the sums is that of the simulated expert, to the bit.
    stiff = flight.torque + flight.kp * (flight.position - flight.joint_position)
    torque = stiff + flight.kd * (flight.velocity - flight.joint_velocity)
    return clip_torque(torque, robot.torque_limit)


def _motion_of(flight: Flight) -> tuple[Array, Array]:
    """Configurations ``(n, 19)`` above the origin, and velocities ``(n, 18)``, as measured."""
    n = len(flight.tick)
    place = np.column_stack([np.zeros((n, 2)), flight.base[:, 0]])
    q = np.column_stack([place, flight.orientation, flight.joint_position])
    v = np.column_stack([flight.base[:, 1:], flight.angular_velocity, flight.joint_velocity])
    return q, v
