"""The interface of runtime, robot and policy file: five numbers per joint, and four methods.

A joint's motor applies tau = torque + kp (position - q) + kd (velocity - dq). Joints come in the
order of `surefoot.types.JOINTS`; SI units, radians, quaternions xyzw. Read `loop` next, which
drives a robot with a policy, and `udp_robot` for a robot behind a bridge.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from surefoot.config import Gait
from surefoot.deploy.protocol import Description
from surefoot.types import JOINTS, Array, Command

Clock = Callable[[], int]
"""A clock gives the time [ns]; it never runs backwards, and its zero is arbitrary."""
wall_clock: Clock = time.monotonic_ns
"""The clock of this machine."""

NO_VALUES: Array = np.zeros(len(JOINTS))
NO_VALUES.setflags(write=False)


class RobotFault(RuntimeError):  # noqa: N818
    """The robot cannot be driven."""


class Stale(RobotFault):
    """The robot has not been heard from for too long."""


class Latched(RobotFault):
    """The robot's bridge damps the joints, whatever it receives."""


class BaseEstimate(NamedTuple):
    """What no sensor on board measures, as an estimator or motion capture gives it.

    Attributes:
        height: The height of the base above the ground [m].
        velocity: ``(3,)`` linear velocity of the base, base frame [m/s].
    """

    height: float
    velocity: Array


class Fallen(RobotFault):
    """The robot has fallen."""


class MissingBase(ValueError):  # noqa: N818
    """The height and the velocity of the base are needed, and nothing measures them."""


class Sensors(NamedTuple):
    """What the robot measured at one instant.

    Attributes:
        time_ns: The time of the measurement on the robot's clock [ns].
        sequence: The number of the measurement; it increases with each.
        joint_position: ``(12,)`` joint angles [rad].
        joint_velocity: ``(12,)`` joint rates [rad/s].
        joint_torque: ``(12,)`` joint torques [N m].
        orientation: ``(4,)`` unit quaternion xyzw, base frame to world frame.
        angular_velocity: ``(3,)`` of the base, base frame [rad/s].
        acceleration: ``(3,)`` specific force at the base, base frame [m/s^2].
        base: Height and linear velocity of the base; None if nothing measures them.
        faults: The driver's fault bits; 0 if there is no fault.
    """

    time_ns: int
    sequence: int
    joint_position: Array
    joint_velocity: Array
    joint_torque: Array
    orientation: Array
    angular_velocity: Array
    acceleration: Array
    base: BaseEstimate | None = None
    faults: int = 0


class JointCommand(NamedTuple):
    """The command to the twelve motors: tau = torque + kp (position - q) + kd (velocity - dq).

    Attributes:
        position: ``(12,)`` joint targets [rad].
        kp: ``(12,)`` stiffness [N m/rad].
        kd: ``(12,)`` damping [N m s/rad].
        velocity: ``(12,)`` target joint rates [rad/s].
        torque: ``(12,)`` feed-forward torques [N m].
    """

    position: Array
    kp: Array
    kd: Array
    velocity: Array = NO_VALUES
    torque: Array = NO_VALUES

    @property
    def is_finite(self) -> bool:
        """Whether positions, velocities and torques are finite."""
        parts = (self.position, self.velocity, self.torque)
        return all(math.isfinite(sum(values.tolist())) for values in parts)

    def torque_at(self, sensors: Sensors) -> Array:
        """The torques ``(12,)`` that this commands to the motors, before they clip them [N m].

        Args:
            sensors: What the robot measures.
        """
        # The order of the sums is that of the simulated expert, to the bit.
        stiff = self.torque + self.kp * (self.position - sensors.joint_position)
        return stiff + self.kd * (self.velocity - sensors.joint_velocity)


class RobotInterface(Protocol):
    """A robot, wherever it is.

    Attributes:
        round_trip_ns: Time from sending the newest command that the robot had received to the
            arrival of the newest measurement [ns]; 0 if that is not known.
        lockstep: Whether the robot's time stands still until a command comes; then no deadline can
            be missed.
    """

    round_trip_ns: int
    lockstep: bool

    @property
    def description(self) -> Description:
        """The joint names in order, the rate, the limits and the timeouts."""
        ...

    def read(self) -> Sensors:
        """The newest measurement.

        Raises:
            Stale: The robot has been silent for longer than it may be.
            Latched: The bridge reports that it is latched, and why.
        """
        ...

    def write(self, command: JointCommand) -> None:
        """Give the motors their command, which applies until the next one."""
        ...

    def damp(self) -> None:
        """Only damp the joints from now on; works after any error, and any number of times.

        The robot latches: no later command of this session moves a joint.
        """
        ...

    def close(self) -> None:
        """Damp the joints, and release the robot."""
        ...


class DeployedPolicy(Protocol):
    """A policy as its exported file describes it.

    Attributes:
        robot: The name of the robot.
        joints: The names of the twelve joints, in order.
        rate_hz: How often it must run [Hz].
        kp: ``(12,)`` stiffness of the joints [N m/rad].
        kd: ``(12,)`` damping of the joints [N m s/rad].
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s], yaw rate [rad/s] trained on.
        nominal: ``(12,)`` joint angles of the standing robot [rad].
        start_range: ``(2, 14)`` smallest and largest roll, pitch and joint angles of the initial
            states trained on [rad].
        needs_base: Whether it needs the height or the linear velocity of the base.
        gaits: The gaits that it walks; the gait number of a command is an index into them.
    """

    robot: str
    joints: tuple[str, ...]
    rate_hz: int
    kp: Array
    kd: Array
    command_range: Array
    nominal: Array
    start_range: Array
    needs_base: bool
    gaits: tuple[Gait, ...]

    def reset(self, sensors: Sensors) -> None:
        """Begin an episode: forget everything; the first tick will fill the history."""
        ...

    def height_by_legs(self, sensors: Sensors) -> float:
        """The height of the base above the lowest point of its feet, from the joint angles [m].

        Args:
            sensors: What the robot measures now.
        """
        ...

    def target(self, sensors: Sensors, tick: int, command: Command) -> Array:
        """The joint targets ``(12,)`` [rad].

        Args:
            sensors: What the robot measures now.
            tick: The gait clock [ms].
            command: The commanded velocity, and the gait.
        """
        ...

    def rehearse(self, sensors: Sensors, tick: int, command: Command) -> None:
        """Compute as in `target`, but return and remember nothing; it keeps later ticks fast.

        Args:
            sensors: What the robot measures now.
            tick: The gait clock [ms].
            command: The commanded velocity, and the gait.
        """
        ...

    def miss(self, ticks: int) -> None:
        """Add unseen ticks to the history, as copies of the last one that was seen.

        Args:
            ticks: How many there were between the last measurement and the next one.
        """
        ...

    def remember(self, sensors: Sensors, torque: Array) -> None:
        """Add a tick in which the policy did not drive to the history, instead of `target`.

        Args:
            sensors: What the robot measured at that tick.
            torque: ``(12,)`` the joint torques that were commanded [N m].
        """
        ...
