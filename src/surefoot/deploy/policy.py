"""Runs an exported policy on what a robot measures: NumPy and ONNX Runtime only.

`load` checks a file before anything of it runs: its hash, the version, the robot, the order of the
joints, the layout, and that the graph fits them. `OnnxPolicy` then turns measurements into the
network's input, keeps the history, and asks the network. Read `description` for what a file says.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.config.json_io import from_json
from surefoot.config.json_text import parse_json, read_file
from surefoot.deploy.description import (
    EXPORT_FORMAT,
    KEY,
    ExportFileError,
    PolicyDescription,
    file_hash,
    start_limits,
)
from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.deploy.kinematics import com_in_base, feet_in_base
from surefoot.errors import shown
from surefoot.learning.memory import Memory
from surefoot.learning.observation import Float32Array, goal, observe
from surefoot.learning.onnx_graph import runner
from surefoot.rotations import rotation
from surefoot.types import JOINTS, Array, Command, State

BASE_PARTS = ("base_height", "linear_velocity")
"""Parts of an observation that nothing on board measures."""
MOST_BYTES = 300_000_000
"""[B] No exported file is larger."""
_AGAIN = "copy it again, or export it again: `surefoot export POLICY --onnx FILE`"


@dataclass(frozen=True)
class ExportFile:
    """An exported file that has been checked.

    Attributes:
        path: Where it lies.
        content: Its bytes.
        description: What it says.
        metadata: All keys of its metadata.
    """

    path: Path
    content: bytes
    description: PolicyDescription
    metadata: dict[str, str]


def load(
    path: Path | str,
    robot: str | None = None,
    joints: tuple[str, ...] | None = None,
    layout: str | None = None,
) -> OnnxPolicy:
    """Read a policy that `surefoot export POLICY --onnx FILE` wrote; see `read_export`.

    Args:
        path: The file.
        robot: Name of the robot that it has to be made for; None takes that of any.
        joints: ``(12,)`` names of the robot's joints, in the order in which it sends them; None is
            the order of `JOINTS`.
        layout: Name of the layout that it has to have; None takes any.

    Raises:
        FileNotFoundError: There is no such file.
        ExportFileError: It cannot be run, or must not be run on this robot.
    """
    file = read_export(path, robot, joints, layout)
    if file.description.kind != "network":
        raise ExportFileError(
            f"{file.path} holds the whole {file.description.kind}, and this runs the network "
            "alone; give it the file of `surefoot export POLICY --onnx FILE`"
        )
    return OnnxPolicy(file.description, runner(file.content))


def read_export(
    path: Path | str,
    robot: str | None = None,
    joints: tuple[str, ...] | None = None,
    layout: str | None = None,
) -> ExportFile:
    """Read and check an exported file; the arguments are those of `load`.

    Raises:
        FileNotFoundError: There is no such file.
        ExportFileError: It is cut short or changed, of a newer version, or made for another robot,
            another order of joints, or another layout; the message says what to do.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(
            f"there is no file {path}; `surefoot export POLICY --onnx` makes it"
        )
    content = _content(path)
    metadata = _metadata(path, content)
    if KEY not in metadata:
        raise ExportFileError(
            f"{path} does not say what it is (it has no key {KEY!r}): it was not exported by "
            "surefoot; export the policy with `surefoot export POLICY --onnx FILE`"
        )
    description = _description(path, content, metadata[KEY])
    try:
        _check_made_for(description, metadata, robot, joints, layout)
        if description.kind == "network":
            _check_sizes(description, content)
    except ValueError as error:
        raise ExportFileError(f"{path} {error}") from error
    return ExportFile(path, content, description, metadata)


def _content(path: Path) -> bytes:
    """The bytes of a file, if it may be one."""
    try:
        content = read_file(path)
    except ValueError as error:
        raise ExportFileError(str(error)) from error
    if len(content) > MOST_BYTES:
        raise ExportFileError(f"{path} has {len(content)} bytes; at most {MOST_BYTES} are read")
    return content


def open_session(content: bytes) -> Any:
    """A session of a graph, on one core."""
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])


def _metadata(path: Path, content: bytes) -> dict[str, str]:
    """The metadata of a file."""
    try:
        return dict(open_session(content).get_modelmeta().custom_metadata_map)
    except Exception as error:  # whatever ONNX Runtime makes of a damaged file
        reason = " ".join(str(error).split())[:200]
        raise ExportFileError(f"{path} is not a whole ONNX file ({reason}); {_AGAIN}") from error


def _description(path: Path, content: bytes, text: str) -> PolicyDescription:
    """The description in a file's metadata, whose hash has to be that of the file."""
    try:
        values = parse_json(text.encode())
    except ValueError as error:
        raise ExportFileError(f"{path}: its description is damaged ({error}); {_AGAIN}") from error
    version = values.get("format") if isinstance(values, dict) else None
    if isinstance(version, int) and version > EXPORT_FORMAT:
        raise ExportFileError(
            f"{path} has format {version}, which a newer version of surefoot has written, expected "
            f"{EXPORT_FORMAT}; update surefoot, or export the policy again with this version"
        )
    if version != EXPORT_FORMAT:
        raise ExportFileError(
            f"{path} has format {shown(version)}, expected {EXPORT_FORMAT}; {_AGAIN}"
        )
    try:
        stored = str(values.get("sha256"))
        if file_hash(content, stored) != stored:
            raise ValueError("its contents do not match their hash: it was changed or damaged")
        description = from_json(PolicyDescription, values, KEY)
    except ValueError as error:
        raise ExportFileError(f"{path}: {error}; {_AGAIN}") from error
    return description


def _check_made_for(
    description: PolicyDescription,
    metadata: dict[str, str],
    robot: str | None,
    joints: tuple[str, ...] | None,
    layout: str | None,
) -> None:
    """Check that a file is made for this robot, its joints and this layout.

    Raises:
        ValueError: It is not.
    """
    if robot is not None and description.robot != robot:
        raise ValueError(
            f"is a policy of the robot {description.robot!r}, not of {robot!r}; export one that "
            f"was trained on {robot}"
        )
    for order, owner in ((JOINTS, "this version of surefoot"), (joints, "the robot")):
        if order is None or tuple(description.joints) == tuple(order):
            continue
        if sorted(description.joints) == sorted(order):
            place = next(i for i in range(12) if description.joints[i] != order[i])
            raise ValueError(
                f"has the joints in another order than {owner}: joint {place} is "
                f"{description.joints[place]}, and there {order[place]}; its weights belong to its "
                "own order, so do not rename them: send and take joints in the order of the file, "
                "or export the policy again"
            )
        raise ValueError(
            f"has other joints than {owner}, {shown(description.joints)}, expected {shown(order)}; "
            "export a policy that was trained on this robot"
        )
    if metadata.get("joint_names", ",".join(description.joints)) != ",".join(description.joints):
        raise ValueError(
            "names its joints twice, in different orders (`joint_names` and `surefoot`); export "
            "the policy again"
        )
    spec = description.spec
    if layout is not None and spec.layout.name != layout:
        raise ValueError(
            f"has the layout {spec.layout.name!r}, expected {layout!r}; export a policy that was "
            "trained with this layout"
        )


def _check_sizes(description: PolicyDescription, content: bytes) -> None:
    """Check that the graph of a network takes what is described, and gives twelve targets.

    Raises:
        ValueError: It does not.
    """
    session = open_session(content)
    sizes = [session.get_inputs(), session.get_outputs()]
    shapes = [[tensor.shape[-1:] for tensor in tensors] for tensors in sizes]
    expected = [[[description.spec.input_size]], [[len(JOINTS)]]]
    if shapes != expected:
        raise ValueError(
            f"has a graph of the sizes {shapes}, and describes {expected}; export it again"
        )


class OnnxPolicy:
    """A policy of one robot, as the loop on the robot runs it.

    Args:
        description: What the file says.
        forward: The network, ``(n, inputs)`` to ``(n, 12)`` joint targets [rad].

    Attributes:
        description: What the file says.
        spec: How measurements become the network's input.
        robot: The name of the robot.
        joints: The names of the twelve joints, in order.
        rate_hz: How often it is to be asked [Hz].
        kp: ``(12,)`` stiffness of the joints [N m/rad].
        kd: ``(12,)`` damping of the joints [N m s/rad].
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s], yaw rate [rad/s] trained on.
        nominal: ``(12,)`` joint angles of the standing robot [rad].
        start_range: ``(2, 14)`` smallest and largest roll, pitch and joint angles of the initial
            states trained on [rad]; infinite if unknown.
        needs_base: Whether it asks for the height or the linear velocity of the base.
        gait: Which of the gaits it is to walk, as its place among those of the file.
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
        asked = set(self.spec.layout.parts)
        if self.spec.layout.history is not None:
            asked |= set(self.spec.layout.history.parts)
        self._base_parts = tuple(part for part in BASE_PARTS if part in asked)
        self.needs_base = bool(self._base_parts)
        self.gait = 0
        self._torque_limit = np.array(description.torque_limit)
        self._forward = forward
        self._memory: Memory | None = None

    def reset(self, sensors: Sensors) -> None:
        """Begin an episode: forget everything, and let this measurement stand for all before it.

        Args:
            sensors: What the robot measures now.

        Raises:
            ValueError: The layout needs what the robot does not measure.
        """
        history = self.spec.layout.history
        self._memory = None if history is None else Memory(history, 1)
        if self._memory is not None:
            self._memory.read(self.state(sensors))
        else:
            self.state(sensors)

    def target(self, sensors: Sensors, tick: int, command: Command) -> Array:
        """The joint targets ``(12,)`` [rad]; to be asked once in every tick.

        Args:
            sensors: What the robot measures now.
            tick: The gait clock [ms].
            command: The velocity that is asked for.

        Raises:
            ValueError: The layout needs what the robot does not measure.
        """
        state = self.state(sensors)
        inputs = self._inputs(state, tick, command)
        target = self._forward(inputs)[0].astype(float)
        if self._memory is not None:
            applied = self.applied(target, sensors.joint_position, sensors.joint_velocity)
            self._memory.store(state, applied[None])
        return target

    def remember(self, sensors: Sensors, torque: Array) -> None:
        """Take a tick into the history in which another drove; to be called instead of `target`.

        Args:
            sensors: What the robot measured at that tick.
            torque: ``(12,)`` the joint torques that were commanded [N m].
        """
        if self._memory is None:
            return
        target = (torque + self.kd * sensors.joint_velocity) / self.kp + sensors.joint_position
        applied = self.applied(target, sensors.joint_position, sensors.joint_velocity)
        self._memory.store(self.state(sensors), applied[None])

    def inputs(self, sensors: Sensors, tick: int, command: Command) -> Float32Array:
        """The network's input ``(inputs,)`` at this instant; nothing is remembered of it.

        The arguments are those of `target`.
        """
        return self._inputs(self.state(sensors), tick, command)[0]

    def _inputs(self, state: State, tick: int, command: Command) -> Float32Array:
        """``(1, inputs)`` the network's input."""
        spec = self.spec
        out = np.empty((1, spec.input_size), np.float32)
        now = spec.observation_size
        if spec.layout.history is not None:
            if self._memory is None:
                raise ValueError(
                    "a policy with a history: call reset(sensors) before its first tick"
                )
            now -= spec.layout.history.size
            out[:, now : spec.observation_size] = self._memory.read(state)
        observe(state, spec.layout.parts, out=out[:, :now])
        goal(tick, np.array(command, float), spec, out[:, spec.observation_size :], self.gait)
        return out

    def applied(self, target: Array, joint_position: Array, joint_velocity: Array) -> Array:
        """The targets ``(..., 12)`` that the motors can follow: those of the clipped torques [rad].

        Args:
            target: ``(..., 12)`` joint targets [rad].
            joint_position: ``(..., 12)`` measured joint angles [rad].
            joint_velocity: ``(..., 12)`` measured joint rates [rad/s].
        """
        damping = self.kd * joint_velocity
        torque = self.kp * (target - joint_position) - damping
        torque = np.clip(torque, -self._torque_limit, self._torque_limit)
        return (torque + damping) / self.kp + joint_position

    def state(self, sensors: Sensors) -> State:
        """The state ``(1, ...)`` of a robot that measures this, at the origin of the world.

        Args:
            sensors: What the robot measures. Height and linear velocity of the base are zero where
                neither the robot measures nor the layout needs them.

        Raises:
            ValueError: The layout needs what the robot does not measure.
        """
        base = sensors.base
        if base is None:
            if self.needs_base:
                raise ValueError(
                    f"the layout {self.spec.layout.name!r} needs {' and '.join(self._base_parts)}, "
                    "and the sensors have no estimate of the base: give one, of an estimator or of "
                    "motion capture, or train with the layout `proprioceptive`"
                )
            base = BaseEstimate(0.0, np.zeros(3))
        q = np.concatenate([[0.0, 0.0, base.height], sensors.orientation, sensors.joint_position])[
            None
        ]
        v = np.concatenate([base.velocity, sensors.angular_velocity, sensors.joint_velocity])[None]
        return state_of_base(self.description, q, v)


def state_of_base(description: PolicyDescription, q: Array, v: Array) -> State:
    """The states of robots with these configurations and velocities, by the table of a file.

    Args:
        description: What the file says.
        q: ``(n, 19)`` configurations.
        v: ``(n, 18)`` velocities.
    """
    table = description.kinematics
    turn = np.swapaxes(rotation(q[:, 3:7]), -1, -2)
    feet = feet_in_base(table, q[:, 7:]) @ turn + q[:, None, :3]
    com = (com_in_base(table, q[:, 7:])[:, None] @ turn)[:, 0] + q[:, :3]
    return State(q, v, com, feet, np.zeros((len(q), 4), dtype=bool))
