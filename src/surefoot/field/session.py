"""A session with a robot: from connecting to its bridge until its joints are damped.

A session runs episodes one after another, and the robot stands in between. A fault, the operator or
the end of an iteration ends it; the next session connects again. Read `deploy.loop` for what
happens in a tick, and `collection` next.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from surefoot.config import Config
from surefoot.config.checked import known
from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.drive import LAST_WORDS
from surefoot.deploy.faults import Fault
from surefoot.deploy.fit import check_joints_and_rate
from surefoot.deploy.handover import PLANNER_ENDED, PlanFollower, PlanLink, Safeguard
from surefoot.deploy.interfaces import Clock, Sensors, Stale, wall_clock
from surefoot.deploy.loop import Mode, Runtime
from surefoot.deploy.operator import Operator, Wish
from surefoot.deploy.policy import OnnxPolicy
from surefoot.deploy.protocol import check_description
from surefoot.deploy.recorder import Flight
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.field.attempts import FALLS, Attempt, End
from surefoot.field.episode import EpisodeLog, RecordedEpisode
from surefoot.field.switch import EpisodeSwitch
from surefoot.interop.onnx.file import describe
from surefoot.learning.network import MINIMUM_ROWS
from surefoot.learning.observation import Float32Array
from surefoot.learning.policy import load
from surefoot.robots.model import RobotModel
from surefoot.rollouts.jobs import Job
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.episode_ids import EpisodeId
from surefoot.scenarios.gaits import all_starts_of
from surefoot.types import JOINTS, TICKS_PER_SECOND, Command, to_ticks

logger = logging.getLogger(__name__)

LOST = ("joint limit", "joint speed", "saturated torque")
"""Faults of a robot that might have damaged itself; they count as a fall of its policy."""
BASE_PATIENCE = 10.0
"""[s] How long a session waits for a measurement of the base before it stops the learning."""
PATIENCE = 60.0
"""[s] How long a bridge that does not answer is tried again: it may have to be restarted."""


class Person(Operator, Protocol):
    """An operator who can be asked for another start; `deploy.operator.Terminal` is one."""

    def halt(self) -> None:
        """Forget the start and all input since then: a damped robot waits for another start."""
        ...


class Unattended:
    """Starts at once, every time: for a simulated twin, which is set up again after a fall."""

    def wish(self) -> Wish:
        """See `deploy.operator.Operator`."""
        return Wish(True, Command())

    def halt(self) -> None:
        """Do nothing, because there is no input to forget."""


class EpisodeOperator:
    """The person's wishes, with the command of the episode; between episodes the robot rests.

    Args:
        person: Who starts and stops the robot.

    Attributes:
        command: The velocity of the episode.
        rest: Whether the robot is to stand.
        lost: Why the person is no longer there; empty as long as there is one.
    """

    def __init__(self, person: Person) -> None:
        self.command = Command()
        self.rest = True
        self.lost = ""
        self._person = person

    def wish(self) -> Wish:
        """See `deploy.operator.Operator`."""
        wish = self._person.wish()
        self.lost = wish.lost
        return wish._replace(command=self.command, rest=self.rest or wish.rest)


@dataclass(frozen=True)
class Crew:
    """Everything that all sessions share.

    Attributes:
        robot: The robot's model.
        config: The run's configuration, with the robot's own values.
        runtime: How the robot stands up, and the limits of the faults.
        planner: The link to the expert's planner.
        person: Who starts and stops the robot.
        connection: Makes a robot that is not connected yet.
        clock: Returns the time [ns].
    """

    robot: RobotModel
    config: Config
    runtime: RuntimeConfig
    planner: PlanLink
    person: Person
    connection: Callable[[], UdpRobot]
    clock: Clock = wall_clock


@dataclass(frozen=True)
class Report:
    """The result of an attempt at an episode.

    Attributes:
        attempt: The record of the attempt.
        episode: The recorded episode; None if it is to be tried again.
        last_seconds: The last ten seconds before a fault; None without one.
    """

    attempt: Attempt
    episode: RecordedEpisode | None
    last_seconds: Flight | None


class Session:
    """A connected robot, and the loop that drives it with one policy.

    Args:
        crew: Everything that all sessions share.
        policy: The policy.
        stopped: Called before every tick; True ends the episode.

    Raises:
        Stale: No bridge answers.
    """

    def __init__(self, crew: Crew, policy: OnnxPolicy, stopped: Callable[[], bool]) -> None:
        self._crew = crew
        self._policy = policy
        self._stopped = stopped
        crew.planner.forget()
        self._robot = _connected(crew.connection, stopped)
        expert = crew.config.expert
        lockstep = self._robot.lockstep
        self._expert = PlanFollower(
            crew.planner,
            known(expert.kp, "expert.kp"),
            known(expert.kd, "expert.kd"),
            0 if lockstep else crew.runtime.plan_latency,
            crew.runtime.plan_patience,
            lockstep,
        )
        self._switch: EpisodeSwitch | None = None
        self._operator = EpisodeOperator(crew.person)
        self._runtime: Runtime | None = None
        self._passed = 0  # ticks of the robot up to the end of the last episode
        self._missed = 0

    @property
    def over(self) -> bool:
        """Whether the robot is damped for good."""
        return self._runtime is not None and self._runtime.over

    @property
    def lost(self) -> str:
        """Why nobody is watching over the robot any more; empty as long as somebody is."""
        return self._operator.lost

    def run_episode(self, job: Job) -> Report:
        """Stand the robot up if it lies, drive it for an episode, and let it stand again.

        Args:
            job: A job with one episode of one robot.

        Raises:
            WrongRobotError: The policy is for another robot than the bridge serves.
            ValueError: The height and the velocity of the base are not measured.
        """
        crew = self._crew
        runtime = self._runtime or self._begin(job)
        driven = runtime.drivers.driven
        proper = to_ticks(job.episodes.duration)
        log = EpisodeLog(crew.robot.name, proper, to_ticks(job.episodes.tail))
        runtime.listeners[:] = [log]
        if self._switch is not None:
            self._switch.begin(job)
        self._operator.command = Command(*job.starts.command[0].tolist())
        self._operator.rest = False
        plans = self._expert.plans
        invalid = self._expert.invalid
        while not (runtime.over or log.whole or self._stopped()):
            runtime.tick()
        self._operator.rest = True
        while runtime.mode == Mode.DRIVE and log.whole and not runtime.over:
            runtime.tick()  # until the next measurement, after which the robot stands
        lay = runtime.deadlines.passed - self._passed - (runtime.drivers.driven - driven)
        outcome = outcome_of(log, runtime.fault)
        attempt = Attempt(
            iteration=EpisodeId.from_number(int(job.episode[0])).iteration,
            episode=int(job.episode[0]),
            end=_END_OF[outcome],
            fault="" if runtime.fault is None else runtime.fault.kind,
            detail="" if runtime.fault is None else runtime.fault.detail,
            seconds=log.driven / TICKS_PER_SECOND,
            expert_seconds=log.expert_ticks / TICKS_PER_SECOND,
            takeovers=log.takeovers,
            other_seconds=lay / TICKS_PER_SECOND,
            missed=runtime.deadlines.missed - self._missed,
        )
        self._passed = runtime.deadlines.passed
        self._missed = runtime.deadlines.missed
        episode = None
        if outcome is not None:
            counts = (self._expert.plans - plans, self._expert.invalid - invalid)
            episode = RecordedEpisode(log, outcome, *counts)
        last = None
        if runtime.fault is not None:
            last = runtime.recorder.flight(attempt.fault, attempt.detail)
        return Report(attempt, episode, last)

    def close(self) -> None:
        """Damp the robot and release it."""
        for _ in range(LAST_WORDS):
            self._robot.damp()
        self._robot.close()

    def _begin(self, job: Job) -> Runtime:
        """Make the loop, once the robot measures its base."""
        crew = self._crew
        self._wait_for_base()
        fall_angle = max(crew.config.safety.fall_angle, job.disturbance.fall_angle)
        safety = replace(crew.config.safety, fall_angle=fall_angle)
        self._switch = EpisodeSwitch(self._policy, safety, job)
        self._runtime = Runtime(
            self._robot,
            self._policy,
            self._operator,
            crew.runtime,
            crew.clock,
            safeguard=Safeguard(self._switch, self._expert),
        )
        return self._runtime

    def _wait_for_base(self) -> None:
        """Wait until the base is measured: motion capture may lose a robot that lies on its side.

        Raises:
            ValueError: The base has not been measured for `BASE_PATIENCE`.
        """
        clock = self._crew.clock
        latest = clock() + round(1e9 * BASE_PATIENCE)
        sensors = self._robot.read()
        while sensors.base is None and clock() < latest:
            sensors = self._robot.read()
        check_base(sensors)


_END_OF: Mapping[Outcome | None, End] = {
    Outcome.SUCCESS: "whole",
    Outcome.FELL: "fell",
    Outcome.DIVERGED: "diverged",
    None: "dropped",
}


def outcome_of(log: EpisodeLog, fault: Fault | None) -> Outcome | None:
    """The outcome of an episode; None if it ended for a reason unrelated to the policy.

    A robot that stayed up counts as a success even if it stopped stepping.

    Args:
        log: The log of the episode.
        fault: The fault that damped the robot; None if there was none.
    """
    if log.whole:
        return Outcome.SUCCESS
    if fault is None or log.ticks == 0 or fault.detail == PLANNER_ENDED:
        return None
    if log.stood:  # the operator made it stand, so nobody was driving
        return None
    if fault.kind in FALLS or fault.kind in LOST:
        return Outcome.FELL
    return Outcome.DIVERGED if fault.kind == "expert" else None


def deployed_policy(path: Path, robot: RobotModel, config: Config) -> OnnxPolicy:
    """A run's policy for the loop on the robot, with the same bits as in simulation.

    Args:
        path: The policy's file.
        robot: The robot's model.
        config: The run's configuration.
    """
    policy = load(path, robot.name)
    description = describe(policy, path, robot, config, all_starts_of(config).sets)
    # The network's bits depend on the number of rows, as in simulation.
    inputs = np.zeros((MINIMUM_ROWS, policy.spec.observation.input_size), np.float32)

    def forward(row: Float32Array) -> Float32Array:
        inputs[: len(row)] = row
        return policy.forward(inputs)[: len(row)]

    return OnnxPolicy(description, forward)


def check_bridge(connection: Callable[[], UdpRobot], model: RobotModel) -> None:
    """Check, before any work, that a bridge serves a robot that the expert can drive.

    Args:
        connection: Makes a robot that is not connected yet.
        model: The robot's model.

    Raises:
        Stale: No bridge answers.
        ValueError: The bridge serves another robot, joint order or rate, its limits or times keep
            no robot safe, or the height and the velocity of the base are not measured.
    """
    robot = _connected(connection, lambda: False)
    try:
        check_description(robot.description)
        served = robot.description.robot
        if served != model.name:
            raise ValueError(
                f"the bridge serves the robot {served}, and the configuration has {model.name}; "
                f"use --config.robot.model {served}, or a file with that robot"
            )
        check_joints_and_rate(JOINTS, TICKS_PER_SECOND, robot.description)
        check_base(robot.read())
    finally:
        robot.close()


def check_base(sensors: Sensors) -> None:
    """Check that the expert can plan for a robot.

    Args:
        sensors: The robot's measurements.

    Raises:
        ValueError: The height and the velocity of the base are not measured.
    """
    if sensors.base is None:
        raise ValueError(
            "the robot measures neither height nor linear velocity of its base, without which the "
            "expert cannot plan: add motion capture or an estimator while it learns; the policy "
            "needs neither with --config.policy.layout proprioceptive"
        )


def _connected(connection: Callable[[], UdpRobot], stopped: Callable[[], bool]) -> UdpRobot:
    """Connect to a robot's bridge, and try again until it answers.

    Raises:
        Stale: The bridge has not answered for `PATIENCE`, or `stopped` returned True.
    """
    begun = time.monotonic()
    warned = False
    while True:
        robot = connection()
        try:
            robot.connect()
            return robot
        except Stale as error:
            robot.close()
            if stopped() or time.monotonic() - begun > PATIENCE:
                raise
            if not warned:
                logger.warning("%s; asking again for %g s", error, PATIENCE)
            warned = True
        except BaseException:
            robot.close()
            raise
