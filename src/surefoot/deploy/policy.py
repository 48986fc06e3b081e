"""Runs an exported policy on what a robot measures: NumPy and ONNX Runtime only.

`load` reads a file and refuses what must not run (`export_file`). `OnnxPolicy` then turns
measurements into the network's input, keeps the history, and runs the network. Read `description`
for what a file contains.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from surefoot.deploy.description import ExportFileError, PolicyDescription, start_limits
from surefoot.deploy.export_file import read_export
from surefoot.deploy.interfaces import BaseEstimate, MissingBase, Sensors
from surefoot.deploy.kinematics import feet_and_com
from surefoot.deploy.observer import attitude, observed
from surefoot.learning.memory import Memory
from surefoot.learning.observation import (
    OBSERVATION,
    Float32Array,
    columns_of,
    goal,
)
from surefoot.learning.onnx_graph import runner
from surefoot.rotations import rotation
from surefoot.types import Array, Command, State

BASE_PARTS = ("base_height", "linear_velocity")
"""Parts of an observation that no sensor on board measures."""
UNKNOWN_BASE = BaseEstimate(0.0, np.zeros(3))
"""Stands for the base where nothing measures it and the layout does not need it."""


def load(path: Path | str, robot: str | None = None, layout: str | None = None) -> OnnxPolicy:
    """Read a policy that `surefoot export POLICY --onnx FILE` wrote; see `read_export`.

    Args:
        path: The file.
        robot: Name of the robot that it must be made for; None accepts any.
        layout: Name of the layout that it must have; None accepts any.

    Raises:
        FileNotFoundError: There is no such file.
        ExportFileError: It cannot be run, or must not be run on this robot.
    """
    file = read_export(path, robot, layout)
    if file.description.kind != "network":
        raise ExportFileError(
            f"{file.path} holds the whole {file.description.kind}, and this runs the network "
            "alone; give it the file of `surefoot export POLICY --onnx FILE`"
        )
    return OnnxPolicy(file.description, runner(file.content, rows=1))


class OnnxPolicy:
    """A policy of one robot, as the loop on the robot runs it.

    Args:
        description: The file's description.
        forward: The network, ``(1, inputs)`` to ``(1, 12)`` joint targets [rad].

    Attributes:
        description: The file's description.
        spec: How measurements become the network's input.
        robot: The name of the robot.
        joints: The names of the twelve joints, in order.
        rate_hz: How often it must run [Hz].
        kp: ``(12,)`` stiffness of the joints [N m/rad].
        kd: ``(12,)`` damping of the joints [N m s/rad].
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s], yaw rate [rad/s] trained on.
        nominal: ``(12,)`` joint angles of the standing robot [rad].
        start_range: ``(2, 14)`` smallest and largest roll, pitch and joint angles of the initial
            states trained on [rad]; infinite if unknown.
        needs_base: Whether it needs the height or the linear velocity of the base.
        gaits: The gaits that it walks; the gait number of a command is an index into them.
    """

    def __init__(
        self, description: PolicyDescription, forward: Callable[[Float32Array], Float32Array]
    ) -> None:
        self.description = description
        self.spec = description.spec
        self.robot = description.robot
        self.joints = description.joints
        self.rate_hz = description.rate_hz
        self.kp = np.array(description.kp)
        self.kd = np.array(description.kd)
        self.command_range = np.array(description.command_range)
        self.nominal = np.array(description.nominal)
        self.start_range = start_limits(description.start_range)
        layout = self.spec.layout
        remembered = () if layout.history is None else layout.history.parts
        self._columns = columns_of(layout.parts)
        self._sample_columns = columns_of(remembered)
        asked = {*layout.parts, *remembered}
        self._base_parts = tuple(part for part in BASE_PARTS if part in asked)
        self.needs_base = bool(self._base_parts)
        self.gaits = tuple(timing.gait for timing in self.spec.gaits)
        self._torque_limit = np.array(description.torque_limit)
        self._forward = forward
        self._memory: Memory | None = None

    def reset(self, sensors: Sensors) -> None:
        """Begin an episode: forget everything; the first tick will fill the history.

        Args:
            sensors: What the robot measures now; only checked for what the layout needs.

        Raises:
            MissingBase: The layout needs what the robot does not measure.
        """
        history = self.spec.layout.history
        self._memory = None if history is None else Memory(history, 1)
        self._base(sensors)

    def height_by_legs(self, sensors: Sensors) -> float:
        """The height of the base above the lowest point of its feet, from the joint angles [m].

        Args:
            sensors: What the robot measures now.
        """
        up, _ = attitude(sensors.orientation)
        feet, _ = feet_and_com(self.description.kinematics, sensors.joint_position)
        return self.description.kinematics.foot_radius - float((feet @ np.array(up)).min())

    def target(self, sensors: Sensors, tick: int, command: Command) -> Array:
        """The joint targets ``(12,)`` [rad]; to be called once per tick.

        Args:
            sensors: What the robot measures now.
            tick: The gait clock [ms].
            command: The commanded velocity, and the gait.

        Raises:
            MissingBase: The layout needs what the robot does not measure.
        """
        observation = self._observed(sensors)
        inputs = self._inputs(observation, tick, command)
        target = self._forward(inputs)[0].astype(float)
        if self._memory is not None:
            self._store(self._memory, observation, sensors, target)
        return target

    def miss(self, ticks: int) -> None:
        """Add unseen ticks to the history; to be called before the tick that follows them.

        Args:
            ticks: How many were unseen; the last tick that was seen stands for each.
        """
        if self._memory is not None:
            self._memory.repeat(ticks)

    def rehearse(self, sensors: Sensors, tick: int, command: Command) -> None:
        """Compute as in `target`, but return and remember nothing.

        The arguments are those of `target`.
        """
        self._forward(self._inputs(self._observed(sensors), tick, command))

    def remember(self, sensors: Sensors, torque: Array) -> None:
        """Add a tick in which the policy did not drive to the history, instead of `target`.

        Args:
            sensors: What the robot measured at that tick.
            torque: ``(12,)`` the joint torques that were commanded [N m].
        """
        if self._memory is None:
            return
        target = (torque + self.kd * sensors.joint_velocity) / self.kp + sensors.joint_position
        self._store(self._memory, self._observed(sensors), sensors, target)

    def inputs(self, sensors: Sensors, tick: int, command: Command) -> Float32Array:
        """The network's input ``(inputs,)`` at this instant; nothing is remembered.

        The arguments are those of `target`.
        """
        return self._inputs(self._observed(sensors), tick, command)[0]

    def _observed(self, sensors: Sensors) -> Float32Array:
        """``(42,)`` all parts of the observation; a layout uses some of them."""
        return observed(self.description.kinematics, sensors, self._base(sensors))

    def _inputs(self, observation: Float32Array, tick: int, command: Command) -> Float32Array:
        """``(1, inputs)`` the network's input."""
        spec = self.spec
        out = np.empty((1, spec.input_size), np.float32)
        now = len(self._columns)
        out[0, :now] = observation[self._columns]
        if spec.layout.history is not None:
            if self._memory is None:
                raise ValueError(
                    "a policy with a history: call reset(sensors) before its first tick"
                )
            self._begin(self._memory, observation)
            past = self._memory.ring[self._memory.rows()]
            out[0, now : spec.observation_size] = past.ravel()
        goal(tick, np.array(command, float), spec, out[:, spec.observation_size :], command.gait)
        return out

    def _store(
        self, memory: Memory, observation: Float32Array, sensors: Sensors, target: Array
    ) -> None:
        """Remember a tick, with the joint targets ``(12,)`` as far as the motors could follow."""
        self._begin(memory, observation)
        applied = self.applied(target, sensors.joint_position, sensors.joint_velocity)
        memory.ring[memory.next_row(), 0] = self._sample(observation, applied)

    def _begin(self, memory: Memory, observation: Float32Array) -> None:
        """Fill the history with the first tick, if none has been stored yet."""
        if memory.begins:
            memory.ring[:] = self._sample(observation, observation[OBSERVATION["joint_position"]])

    def _sample(self, observation: Float32Array, target: Array | Float32Array) -> Float32Array:
        """``(sample_size,)`` the sample of the history for a tick with these joint targets."""
        history = self.spec.layout.history
        sample = observation[self._sample_columns]
        if history is None or not history.targets:
            return sample
        return np.concatenate((sample, target), dtype=np.float32)

    def applied(self, target: Array, joint_position: Array, joint_velocity: Array) -> Array:
        """The targets ``(..., 12)`` that the motors can follow, from the clipped torques [rad].

        Args:
            target: ``(..., 12)`` joint targets [rad].
            joint_position: ``(..., 12)`` measured joint angles [rad].
            joint_velocity: ``(..., 12)`` measured joint rates [rad/s].
        """
        damping = self.kd * joint_velocity
        torque = self.kp * (target - joint_position) - damping
        torque = np.minimum(np.maximum(torque, -self._torque_limit), self._torque_limit)
        return (torque + damping) / self.kp + joint_position

    def state(self, sensors: Sensors) -> State:
        """The state ``(1, ...)`` of a robot with these measurements, at the origin of the world.

        Args:
            sensors: What the robot measures. Height and linear velocity of the base are zero if
                the robot does not measure them and the layout does not need them.

        Raises:
            MissingBase: The layout needs what the robot does not measure.
        """
        base = self._base(sensors)
        origin = (0.0, 0.0, base.height)
        q = np.concatenate((origin, sensors.orientation, sensors.joint_position))[None]
        v = np.concatenate((base.velocity, sensors.angular_velocity, sensors.joint_velocity))[None]
        return state_of_base(self.description, q, v)

    def _base(self, sensors: Sensors) -> BaseEstimate:
        """Height and linear velocity of the base; zeros where nothing needs them.

        Raises:
            MissingBase: The layout needs them, and nothing measures them.
        """
        if sensors.base is not None:
            return sensors.base
        if self.needs_base:
            raise MissingBase(
                f"the layout {self.spec.layout.name!r} needs {' and '.join(self._base_parts)}, "
                "and the sensors have no estimate of the base: give one, of an estimator or of "
                "motion capture, or train with the layout `proprioceptive`"
            )
        return UNKNOWN_BASE


def state_of_base(description: PolicyDescription, q: Array, v: Array) -> State:
    """The states of robots with these configurations and velocities, by a file's kinematic table.

    Args:
        description: The file's description.
        q: ``(n, 19)`` configurations.
        v: ``(n, 18)`` velocities.
    """
    turn = np.swapaxes(rotation(q[:, 3:7]), -1, -2)
    feet, com = feet_and_com(description.kinematics, q[:, 7:])
    feet = feet @ turn + q[:, None, :3]
    com = (com[:, None] @ turn)[:, 0] + q[:, :3]
    return State(q, v, com, feet, np.zeros((len(q), 4), dtype=bool))
