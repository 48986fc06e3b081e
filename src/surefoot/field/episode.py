"""An episode on a robot, in the form of a simulated rollout.

`EpisodeLog` keeps every tick in which the robot is driven, `rollout_of` makes arrays with a row for
each tick of the gait clock, and `result_of` makes the result that a run stores. Values that are not
measured are filled in: the robot stays above the origin, and a foot touches the ground if no other
foot is much lower. Read `session` next.
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
"""Room for measurements that repeat a millisecond of the gait clock, in ticks."""
CONTACT = 0.005
"""[m] A foot that is at most this much higher than the lowest one touches the ground."""


class EpisodeLog:
    """Keeps the ticks of an episode in which the robot is driven; a `Listener`.

    If the episode starts over, because the operator let the robot stand in between, only the ticks
    after that are kept, but the counts include those before.

    Args:
        robot: The name of the robot.
        proper: Number of ticks in the episode before its tail.
        tail: Number of ticks in the tail, in which the expert drives.

    Attributes:
        ticks: Time on the gait clock so far [ms]; 0 before the first tick.
        expert_ticks: Number of ticks that the expert drove, including those before starting over.
        takeovers: Number of times that the expert took over from the policy, including those before
            starting over, but not in the tail.
        stood: Whether the robot stood in the last tick in which it was not damped.
    """

    def __init__(self, robot: str, proper: int, tail: int) -> None:
        self._robot = robot
        self._proper = proper
        self._total = proper + tail
        self.expert_ticks = 0
        self.takeovers = 0
        self._before = 0  # ticks driven before the episode started over
        self._begin()

    @property
    def driven(self) -> int:
        """Number of ticks that the robot was driven, including those before starting over."""
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
        """The kept ticks, the oldest first."""
        return self._recorder.flight()

    def _begin(self) -> None:
        """Start over with no ticks."""
        self._recorder = FlightRecorder(self._robot, ticks=self._total + REPEATED)
        self.ticks = 0
        self.stood = False
        self._expert_drove = False


@dataclass(frozen=True)
class RecordedEpisode:
    """An episode that a robot has walked.

    Attributes:
        log: The ticks in which the robot was driven.
        outcome: How it ended.
        plans: Number of MPC solves.
        invalid_plans: Number of MPC solves whose plan was not valid.
    """

    log: EpisodeLog
    outcome: Outcome
    plans: int
    invalid_plans: int

    @property
    def flight(self) -> Flight:
        """The ticks as arrays, made in each call: too slow for the thread that drives."""
        return self.log.flight()


def result_of(job: Job, episode: RecordedEpisode, robot: RobotModel, config: Config) -> ChunkResult:
    """The result of an episode that a run stores, like that of `rollouts.jobs.run_chunk`.

    Args:
        job: The job with this one episode of one robot.
        episode: The recorded episode.
        robot: The robot.
        config: The configuration, with the robot's own values.
    """
    rollout, measured = rollout_of(job, episode, robot)
    recording = concatenate([])
    if job.keep is not None:
        # Ticks without a measurement are not kept, because their states are unknown.
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

    A tick of the gait clock that the runtime missed repeats the previous one.

    Args:
        job: The job with this one episode of one robot.
        episode: The recorded episode, with at least one tick.
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
    # The command as it was given to the policy, limited to the range that it was trained on.
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
    """``(n, 12)`` the torques that were commanded to the motors in each tick, clipped [N m].

    Args:
        flight: The ticks.
        robot: The robot, for the limits.
    """
    # The terms are added in the same order as in the simulated expert, for the same bits.
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
