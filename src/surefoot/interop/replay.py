"""Replays a log through PyTorch, ONNX and the runtime, and names the first term that differs.

What the sensors say is turned into the network's input anew (`learning.observation`, the
reference), and compared with what the runtime makes of it, with what the network was given on the
robot, and, through the network, with the joint targets that the robot was commanded. Where a log
has neither input nor targets, its sensors are compared with each other: joint rates with the
derivative of the joint angles, the rate of turn with that of the orientation. Read `differences`
for the words, and `hypotheses` for logs that have targets only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surefoot.deploy.description import PolicyDescription, input_slices
from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.deploy.policy import BASE_PARTS, OnnxPolicy, state_of_base
from surefoot.interop.differences import explain, first_beyond, largest
from surefoot.interop.sensor_log import SensorLog
from surefoot.learning.memory import recorded_histories
from surefoot.learning.observation import Float32Array, goal, observe
from surefoot.rotations import rotation
from surefoot.types import TICKS_PER_SECOND, Array, Command, State

Network = Callable[[Float32Array], Float32Array]
"""A network, ``(n, inputs)`` to ``(n, 12)`` joint targets [rad]."""

INPUT_TOLERANCE = 1e-4
"""How much a number of the network's input may differ, in its unit."""
TARGET_TOLERANCE = 1e-4
"""[rad] How much joint targets may differ that were logged."""
NETWORK_TOLERANCE = 1e-5
"""[rad] How much the targets of PyTorch, ONNX and runtime may differ on the same input."""
NO_VALUES = np.zeros(12)


@dataclass(frozen=True)
class Finding:
    """What a check has found.

    Attributes:
        term: The term that differs: a part of the network's input, a field of the log, or
            `network`.
        kind: `order`, `sign`, `scale`, `frame`, `time`, `rate`, `network` or `unknown`.
        text: A sentence that says what differs from what, and how.
    """

    term: str
    kind: str
    text: str


@dataclass(frozen=True)
class ReplayReport:
    """What a replay has shown.

    Attributes:
        rows: Number of rows of the log.
        compared: What was compared, in words.
        largest: Largest difference of each comparison, in the order of `compared`.
        findings: What differs, the first term first; empty if all agrees.
    """

    rows: int
    compared: tuple[str, ...]
    largest: tuple[float, ...]
    findings: tuple[Finding, ...]


def states_of(log: SensorLog, description: PolicyDescription) -> State:
    """The states ``(T, ...)`` of a log, with the robot at the origin of the world.

    Args:
        log: The log.
        description: The policy that is to see them.

    Raises:
        ValueError: The layout needs what the log does not have.
    """
    T = len(log)
    asked = {term.name for term in description.observation}
    columns = zip(BASE_PARTS, (log.base_height, log.linear_velocity), strict=True)
    missing = [name for name, array in columns if array is None and name in asked]
    if missing:
        raise ValueError(
            f"the layout {description.layout!r} needs {' and '.join(missing)}, which the log does "
            "not have: record it, of an estimator or of motion capture"
        )
    height = np.zeros(T) if log.base_height is None else log.base_height
    velocity = np.zeros((T, 3)) if log.linear_velocity is None else log.linear_velocity
    zeros = np.zeros((T, 2))
    q = np.column_stack([zeros, height, log.orientation, log.joint_position])
    v = np.column_stack([velocity, log.angular_velocity, log.joint_velocity])
    return state_of_base(description, q, v)


def reference_inputs(
    log: SensorLog, description: PolicyDescription, applied: Array
) -> Float32Array:
    """``(T, inputs)`` the network's input in each row, by the package's reference.

    Args:
        log: The log.
        description: The policy.
        applied: ``(T, 12)`` the joint targets that were applied, for the history [rad].
    """
    spec = description.spec
    state = states_of(log, description)
    history = spec.layout.history
    T = len(log)
    out = np.empty((T, spec.input_size), np.float32)
    now = spec.observation_size
    if history is not None:
        now -= history.size
        begin = np.zeros(T, dtype=np.int64)
        past = recorded_histories(state, applied, begin, np.arange(T), history)
        out[:, now : spec.observation_size] = past
    observe(state, spec.layout.parts, out=out[:, :now])
    goal(log.tick, log.command, spec, out[:, spec.observation_size :])
    return out


def sensors_of(log: SensorLog, row: int) -> Sensors:
    """What the robot measured in one row of a log."""
    base = None
    if log.base_height is not None or log.linear_velocity is not None:
        height = 0.0 if log.base_height is None else float(log.base_height[row])
        velocity = np.zeros(3) if log.linear_velocity is None else log.linear_velocity[row]
        base = BaseEstimate(height, velocity)
    return Sensors(
        time_ns=int(log.time_ns[row]),
        sequence=row,
        joint_position=log.joint_position[row],
        joint_velocity=log.joint_velocity[row],
        joint_torque=NO_VALUES,
        orientation=log.orientation[row],
        angular_velocity=log.angular_velocity[row],
        acceleration=np.zeros(3),
        base=base,
    )


def run_runtime(policy: OnnxPolicy, log: SensorLog) -> tuple[Float32Array, Array, Array]:
    """Run the runtime through a log, row by row.

    Args:
        policy: The policy, as the loop on the robot runs it.
        log: The log.

    Returns:
        ``(T, inputs)`` the network's inputs, the targets ``(T, 12)``, and those that the motors can
        follow, ``(T, 12)`` [rad].
    """
    T = len(log)
    inputs = np.empty((T, policy.spec.input_size), np.float32)
    targets = np.empty((T, 12))
    applied = np.empty((T, 12))
    policy.reset(sensors_of(log, 0))
    for row in range(T):
        sensors = sensors_of(log, row)
        command = Command(*log.command[row].tolist())
        inputs[row] = policy.inputs(sensors, int(log.tick[row]), command)
        targets[row] = policy.target(sensors, int(log.tick[row]), command)
        applied[row] = policy.applied(targets[row], sensors)
    return inputs, targets, applied


def replay(
    log: SensorLog, policy: OnnxPolicy, network: Network, torch: Network | None = None
) -> ReplayReport:
    """Compare a log with what the policy makes of it.

    Args:
        log: The log.
        policy: The policy, as the loop on the robot runs it.
        network: The network of its file.
        torch: The network of the policy file that was exported, in PyTorch, if it is at hand.

    Raises:
        ValueError: The layout needs what the log does not have.
    """
    from surefoot.interop.hypotheses import explain_sensors, explain_targets

    description = policy.description
    comparison = _Comparison()
    check_clock(log, description, comparison)
    inputs, targets, applied = run_runtime(policy, log)
    kept = applied if log.joint_target is None else clipped(policy, log, log.joint_target)
    # The runtime's history has its own targets, the log's those of whoever drove.
    own = reference_inputs(log, description, applied)
    reference = own if log.joint_target is None else reference_inputs(log, description, kept)
    turn = rotation(log.orientation)
    comparison.terms("the runtime's input", own, inputs, description, turn)
    outputs = network(own)
    comparison.network("the runtime's targets and ONNX", outputs, targets)
    if torch is not None:
        comparison.network("ONNX and PyTorch", torch(own), outputs)
    if log.network_input is not None:
        given = np.asarray(log.network_input, np.float32)
        if given.shape != reference.shape:
            raise ValueError(
                f"the log has a network input of {given.shape[1]} numbers, and the layout "
                f"{description.layout!r} has {reference.shape[1]}; it is a log of another layout"
            )
        comparison.terms("the input that was logged", reference, given, description, turn)
    if log.joint_target is not None:
        answers = clipped(policy, log, network(reference))
        error, _ = largest(answers, kept)
        comparison.add("the joint targets that were logged", error)
        if first_beyond(answers, kept, TARGET_TOLERANCE) >= 0 and not comparison.findings:
            comparison.findings.append(explain_targets(log, policy, network, kept))
    if not comparison.findings:
        comparison.findings += explain_sensors(log)
        comparison.add("the sensors with each other", 0.0)
    return comparison.report(len(log))


def clipped(policy: OnnxPolicy, log: SensorLog, targets: Array) -> Array:
    """``(T, 12)`` joint targets that the motors could follow: those of the clipped torques [rad].

    Args:
        policy: Gives the gains and the limits.
        log: What was measured.
        targets: ``(T, 12)`` joint targets [rad].
    """
    rows = range(len(log))
    return np.array([policy.applied(targets[row], sensors_of(log, row)) for row in rows])


def check_clock(log: SensorLog, description: PolicyDescription, comparison: _Comparison) -> None:
    """Compare time, gait clock and rate of a log.

    Args:
        log: The log.
        description: The policy, for its rate.
        comparison: Where findings go.
    """
    step = float(np.median(np.diff(log.time_ns))) / 1e9
    expected = 1.0 / description.rate_hz
    comparison.add("rate", abs(step - expected) * description.rate_hz)
    if abs(step - expected) > 0.1 * expected:
        comparison.findings.append(
            Finding(
                "time_ns",
                "rate",
                f"rate: the rows are {1000 * step:.3g} ms apart, and the policy runs at "
                f"{description.rate_hz} Hz; run it at its own rate",
            )
        )
    ticks = float(np.median(np.diff(log.tick)))
    passed = step * TICKS_PER_SECOND
    if abs(ticks - passed) > 0.1 * passed:
        comparison.findings.append(
            Finding(
                "tick",
                "rate",
                f"rate: the gait clock goes on by {ticks:g} ms a row, and the time by "
                f"{passed:.3g} ms; count it in milliseconds",
            )
        )


class _Comparison:
    """What has been compared so far, and what was found."""

    def __init__(self) -> None:
        self.compared: list[str] = []
        self.largest: list[float] = []
        self.findings: list[Finding] = []

    def add(self, what: str, error: float) -> None:
        """Note a comparison."""
        self.compared.append(what)
        self.largest.append(error)

    def terms(
        self,
        what: str,
        expected: Float32Array,
        given: Float32Array,
        description: PolicyDescription,
        turn: Array,
    ) -> None:
        """Compare inputs of the network, term by term, and explain the first that differs."""
        self.add(what, float(np.abs(expected - given).max()))
        for name, where in input_slices(description.spec).items():
            wanted = expected[:, where].astype(float)
            found = given[:, where].astype(float)
            row = first_beyond(wanted, found, INPUT_TOLERANCE)
            if row < 0:
                continue
            names = component_names(name, wanted.shape[1])
            frame = turn if name in ("angular_velocity", "linear_velocity", "gravity") else None
            kind, text = explain(wanted, found, names, rotation=frame)
            self.findings.append(
                Finding(name, kind, f"{name}: {what} differs from row {row} on; {text}")
            )
            return

    def network(self, what: str, expected: Array, given: Array) -> None:
        """Compare targets of the same network on the same input."""
        error, row = largest(expected, given)
        self.add(what, error)
        if error > NETWORK_TOLERANCE:
            text = f"network: {what} differ by up to {error:.3g} rad, most in row {row}"
            self.findings.append(
                Finding("network", "network", f"{text}; export the policy again, or the policy "
                        "file is not the one that was exported")
            )

    def report(self, rows: int) -> ReplayReport:
        """All of it."""
        return ReplayReport(
            rows, tuple(self.compared), tuple(self.largest), tuple(self.findings)
        )


def component_names(term: str, size: int) -> tuple[str, ...]:
    """What the numbers of a term are called.

    Args:
        term: Name of the term.
        size: The number of its numbers.
    """
    from surefoot.types import JOINTS, LEGS

    if term in ("joint_position", "joint_velocity"):
        return JOINTS
    if term == "feet":
        return tuple(f"{leg} {axis}" for leg in LEGS for axis in "xy")
    if term == "command":
        return ("vx", "vy", "yaw_rate")
    if size == 3:
        return ("x", "y", "z")
    return tuple(str(place) for place in range(size))
