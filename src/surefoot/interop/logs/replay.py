"""Replays a log: the network's input in each row, from the package's reference and the runtime.

Read `check` next, which compares these inputs with each other and with what was logged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from surefoot.deploy.description import PolicyDescription
from surefoot.deploy.interfaces import NO_VALUES, BaseEstimate, Sensors
from surefoot.deploy.policy import BASE_PARTS, OnnxPolicy, state_of_base
from surefoot.interop.logs.differences import Numbers
from surefoot.interop.logs.sensor_log import SensorLog, remembered
from surefoot.interop.onnx.runner import PipelineRunner
from surefoot.learning.observation import Float32Array, goal, observe
from surefoot.learning.policy import Policy
from surefoot.types import Array, Command, GaitCommand, IntArray, State

Network = Callable[[Float32Array], Float32Array]
"""A network, ``(n, inputs)`` to ``(n, 12)`` joint targets [rad]."""

MOST_ROWS = 200
"""Number of rows on which hypotheses are tried: a few rows settle it."""


@dataclass(frozen=True)
class Finding:
    """What a check has found.

    Attributes:
        term: The term that differs: a part of the network's input, a field of the log, or
            `network`.
        kind: `order`, `sign`, `scale`, `frame`, `time`, `rate`, `network`, `outlier` or
            `unknown`.
        text: A sentence on what differs from what, and how.
    """

    term: str
    kind: str
    text: str


class Window(NamedTuple):
    """Some rows of a log, in which something differs.

    Attributes:
        log: These rows.
        rows: Where they are in the whole log.
        known: Index of the first of these rows whose past is known.
    """

    log: SensorLog
    rows: slice
    known: int


def first_known(log: SensorLog, description: PolicyDescription) -> int:
    """The first row whose past is known: a log may begin in the middle of an episode.

    Args:
        log: The log. If it does not record how it begins, and is at most twice as long as the
            history, it is assumed to begin with an episode.
        description: The policy, which may have a history.

    Returns:
        The row, or the number of rows if no row has a known past.
    """
    history = description.spec.layout.history
    reach = 0 if history is None else history.reach
    if log.begins is not None:
        return 0 if log.begins else min(reach, len(log))
    return reach if len(log) > 2 * reach else 0


def window_of(log: SensorLog, description: PolicyDescription, row: int) -> Window:
    """The rows around one row, and the earlier rows that are in their history.

    Args:
        log: The log.
        description: The policy.
        row: The first row that differs.
    """
    history = description.spec.layout.history
    reach = 0 if history is None else history.reach
    first = max(min(row, len(log) - MOST_ROWS) - reach, 0)
    known = reach if first > 0 else first_known(log, description)
    rows = slice(first, first + reach + MOST_ROWS)
    return Window(log.at(rows), rows, known)


def commanded(log: SensorLog) -> Array:
    """``(T, 12)`` the joint targets of a log [rad].

    Raises:
        ValueError: The log has none.
    """
    if log.joint_target is None:
        raise ValueError("the log has no joint_target")
    return log.joint_target


def states_of(log: SensorLog, description: PolicyDescription) -> State:
    """The states ``(T, ...)`` of a log, with the robot at the origin of the world.

    Args:
        log: The log.
        description: The policy that is to see them.

    Raises:
        ValueError: The layout needs something that the log lacks.
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
    log: SensorLog,
    description: PolicyDescription,
    applied: Array,
    elapsed: IntArray | None = None,
) -> Float32Array:
    """``(T, inputs)`` the network's input in each row, from the package's reference.

    Args:
        log: The log.
        description: The policy.
        applied: ``(T, 12)`` the joint targets that were applied, for the history [rad].
        elapsed: ``(T,)`` the ticks since the first row, for the history; None for those of the
            program that drove the robot.
    """
    spec = description.spec
    state = states_of(log, description)
    history = spec.layout.history
    T = len(log)
    out = np.empty((T, spec.input_size), np.float32)
    now = spec.observation_size
    if history is not None:
        now -= history.size
        if elapsed is None:
            elapsed = ticks_of_driver(log, description)
        out[:, now : spec.observation_size] = remembered(state, applied, elapsed, history)
    observe(state, spec.layout.parts, out=out[:, :now])
    goal(log.tick, log.command, spec, out[:, spec.observation_size :], log.gaits)
    return out


def ticks_of_driver(log: SensorLog, description: PolicyDescription) -> IntArray:
    """``(T,)`` the ticks since the first row, as the program that drove the robot counted them.

    A pipeline only counts its calls. The runtime, which alone records flights, runs the network and
    is told which ticks it has missed, whichever file of the policy the flight is checked with.

    Args:
        log: The log.
        description: The policy.
    """
    flown = log.robot is not None
    return log.elapsed if flown or description.kind == "network" else np.arange(len(log))


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


def command_of(log: SensorLog, row: int) -> Command:
    """The velocity and the gait that were commanded in one row of a log."""
    gait = 0 if log.gait is None else int(log.gait[row])
    return GaitCommand(*log.command[row].tolist(), gait=gait)


def check_fits(log: SensorLog, description: PolicyDescription) -> None:
    """Check that a policy is one for the robot of a log, and has the log's gaits.

    Args:
        log: The log.
        description: The policy.

    Raises:
        ValueError: The log is of another robot, or the policy lacks a gait.
    """
    if log.robot not in (None, description.robot):
        raise ValueError(
            f"the log is of the robot {log.robot!r}, and the policy is one for "
            f"{description.robot!r}; give the file of the policy that was run"
        )
    gaits = len(description.gaits)
    wrong = (log.gaits < 0) | (log.gaits >= gaits)
    if wrong.any():
        row = int(wrong.argmax())
        raise ValueError(
            f"the log has gait {log.gaits[row]} in row {row}, and the policy has the gaits 0 to "
            f"{gaits - 1}; give the file of the policy that was run"
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
    policy.reset(sensors_of(log, 0))
    unseen = np.diff(log.elapsed, prepend=-1) - 1
    for row in tqdm(range(T), "replay", leave=False, unit="ms"):
        sensors = sensors_of(log, row)
        command = command_of(log, row)
        policy.miss(int(unseen[row]))
        inputs[row] = policy.inputs(sensors, int(log.tick[row]), command)
        targets[row] = policy.target(sensors, int(log.tick[row]), command)
    return inputs, targets, clipped(policy, log, targets)


def run_pipeline(runner: PipelineRunner, log: SensorLog) -> tuple[Float32Array, Array]:
    """Run a whole pipeline through a log, row by row.

    Args:
        runner: The pipeline.
        log: The log.

    Returns:
        ``(T, inputs)`` the network's inputs, and the targets ``(T, 12)`` [rad].
    """
    runner.reset()
    inputs = []
    targets = []
    for row in tqdm(range(len(log)), "replay", leave=False, unit="ms"):
        command = command_of(log, row)
        target, seen = runner.run(sensors_of(log, row), int(log.tick[row]), command)
        inputs.append(seen)
        targets.append(target)
    return np.array(inputs), np.array(targets)


def torch_network_of(policy: Policy) -> Network:
    """The network of a policy as PyTorch computes it, without folding in its normalizers.

    Args:
        policy: The policy.
    """
    import torch

    def run(inputs: Float32Array) -> Float32Array:
        with torch.no_grad():
            return policy.network(torch.from_numpy(inputs)).numpy()

    return run


def clipped(policy: OnnxPolicy, log: SensorLog, targets: Numbers) -> Array:
    """``(T, 12)`` joint targets that the motors could follow, which give the clipped torques [rad].

    Args:
        policy: Gives the gains and the limits.
        log: What was measured.
        targets: ``(T, 12)`` joint targets [rad].
    """
    return policy.applied(np.asarray(targets, float), log.joint_position, log.joint_velocity)
