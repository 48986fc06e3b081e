"""Compiled code for what the engine computes in every tick around simulator and network.

A network's weights fill the cache of a core, so between two runs of a network each numpy operation
on a small array costs 5 us instead of 1. These functions do the same operations in the same order
in one call: `driver` those around a trained policy's network, `clip_torque` the clipping of every
torque. The numpy versions, which training uses, are the reference:
`learning.observation.network_input`, `learning.memory.Memory`, `learning.policy.pd`,
`robots.model.clip_torque`. The results are the same to the bit on a processor that fuses
multiplications and additions as numpy does. Read `engine` next.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from surefoot.learning.memory import Memory
from surefoot.learning.network import MINIMUM_ROWS
from surefoot.learning.observation import (
    INPUT_SIZE,
    OBSERVATION_SIZE,
    Float32Array,
    ObservationSpec,
    columns_of,
    goal,
)
from surefoot.learning.policy import Policy
from surefoot.robots import rigid
from surefoot.types import Array, BoolArray, Controller, IntArray, State


def driver(policy: Controller) -> Controller:
    """Return a compiled controller for a trained policy, and any other controller unchanged."""
    if type(policy) is not Policy:
        return policy
    spec = policy.spec.observation
    is_full = spec == ObservationSpec(spec.phase, spec.gaits[:1])
    return CompiledPolicy(policy) if is_full else CompiledLayout(policy)


class CompiledPolicy:
    """A trained policy with the layout `full` and one gait, with compiled observation and PD.

    See `learning.policy.Policy`.

    Args:
        policy: The policy.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._phases = policy.spec.observation.phases[0]

    def reset(self, batch: int) -> None:
        """Prepare for ``batch`` robots."""
        self._policy.reset(batch)
        # The rows beyond the robots stay zero.
        self._inputs = np.zeros((max(batch, MINIMUM_ROWS), INPUT_SIZE), np.float32)

    def torque(self, state: State, tick: IntArray, command: Array, mask: BoolArray) -> Array:
        """Torques ``(B, 12)`` [N m], before any clipping, as `Policy.torque` gives them."""
        _fill_inputs(
            state.q, state.v, state.com, state.feet, tick, command, self._phases, self._inputs
        )
        target = self._policy.forward(self._inputs)
        spec = self._policy.spec
        return _pd(target, state.q, state.v, spec.kp, spec.kd)

    @property
    def diverged(self) -> BoolArray:
        """``(B,)`` all False: a policy always answers."""
        return self._policy.diverged


class CompiledLayout:
    """A trained policy with any other layout, maybe with a history; see `learning.policy.Policy`.

    Args:
        policy: The policy.
    """

    def __init__(self, policy: Policy) -> None:
        spec = policy.spec.observation
        self._policy = policy
        self._columns = columns_of(spec.layout.parts)
        # A negative radius stands for an absolute height.
        self._radius = spec.foot_radius if spec.height == "above_feet" else -1.0
        history = spec.layout.history
        self._history = history
        self._sample_columns = columns_of(() if history is None else history.parts)

    def reset(self, batch: int) -> None:
        """Forget everything, and be ready for ``batch`` robots."""
        self._policy.reset(batch)
        spec = self._policy.spec.observation
        # The rows beyond the robots stay zero.
        self._inputs = np.zeros((max(batch, MINIMUM_ROWS), spec.input_size), np.float32)
        self._memory = None if self._history is None else Memory(self._history, batch)

    def torque(self, state: State, tick: IntArray, command: Array, mask: BoolArray) -> Array:
        """Torques ``(B, 12)`` [N m], before any clipping, as `Policy.torque` gives them."""
        spec = self._policy.spec.observation
        _fill_parts(
            state.q,
            state.v,
            state.com,
            state.feet,
            state.contacts,
            self._radius,
            self._columns,
            self._inputs,
        )
        if self._memory is not None:
            self._begin(self._memory, state)
            now = spec.observation_size - self._memory.history.size
            _fill_history(self._memory.ring, self._memory.rows(), now, self._inputs)
        gait = np.broadcast_to(np.asarray(self._policy.gait), tick.shape)
        goal(tick, command, spec, self._inputs[: len(tick), spec.observation_size :], gait)
        target = self._policy.forward(self._inputs)
        return _pd(target, state.q, state.v, self._policy.spec.kp, self._policy.spec.kd)

    def observe(self, state: State, tick: IntArray, torque: Array) -> None:
        """Remember a tick, as `Policy.observe` does."""
        if self._memory is not None:
            self._begin(self._memory, state)
            row = self._memory.next_row()
            self._store(state, torque, self._memory.ring[row : row + 1])

    def _begin(self, memory: Memory, state: State) -> None:
        """Let the first states stand for all before them, if no tick has been stored yet."""
        if memory.begins:
            self._store(state, np.full((len(state.q), 12), np.nan), memory.ring)

    def _store(self, state: State, torque: Array, rows: Float32Array) -> None:
        """Write the samples of states and torques, NaN where there were none, into the ring."""
        spec = self._policy.spec
        _fill_samples(
            state.q,
            state.v,
            state.com,
            state.feet,
            torque,
            (spec.kp, spec.kd),
            self._sample_columns,
            rows,
        )

    @property
    def diverged(self) -> BoolArray:
        """``(B,)`` all False: a policy always answers."""
        return self._policy.diverged


def _build_multiply_add(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    """Return the type of a * b + c, rounded once, and a function that writes its instruction."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), build


# numpy rounds once where it multiplies complex numbers, as `rotations.to_heading` does.
_multiply_add: Any = intrinsic(_build_multiply_add)


@njit(cache=True, error_model="numpy")
def heading(x: float, y: float) -> tuple[float, float]:
    """Return the heading of a base whose x axis has these horizontal parts; yaw 0 if both are 0."""
    length = np.hypot(x, y)
    if length <= 1e-9:
        return 1.0, 0.0
    return x / length, y / length


@njit(cache=True, error_model="numpy")
def to_heading(x: float, y: float, cos: float, sin: float) -> tuple[float, float]:
    """Return a horizontal world vector in the frame of a heading."""
    return _multiply_add(x, cos, y * sin), _multiply_add(x, -sin, y * cos)


@njit(cache=True, error_model="numpy", inline="always")
def _fill_row(q: Array, v: Array, com: Array, feet: Array, row: Float32Array) -> None:
    """Fill the first 42 numbers of a row with all parts of one robot's observation."""
    X, Y, Z = rigid.rotation(q)
    row[0] = q[2]
    for i in range(3):
        row[1 + i] = -Z[i]
    for i in range(6):
        row[4 + i] = v[i]
    for i in range(12):
        row[10 + i] = q[7 + i]
        row[22 + i] = v[6 + i]
    cos, sin = heading(X[0], Y[0])
    for leg in range(4):
        dx = feet[leg, 0] - com[0]
        dy = feet[leg, 1] - com[1]
        row[34 + 2 * leg], row[35 + 2 * leg] = to_heading(dx, dy, cos, sin)


@njit(cache=True, error_model="numpy")
def _fill_parts(
    q: Array,
    v: Array,
    com: Array,
    feet: Array,
    contacts: BoolArray,
    radius: float,
    columns: IntArray,
    out: Float32Array,
) -> None:
    """Fill the beginnings of B rows with the given columns of a whole observation."""
    row = np.empty(OBSERVATION_SIZE, np.float32)
    for robot in range(len(q)):
        _fill_row(q[robot], v[robot], com[robot], feet[robot], row)
        if radius >= 0.0:
            row[0] = q[robot, 2] - ground_height(feet[robot], contacts[robot], radius)
        for i in range(len(columns)):
            out[robot, i] = row[columns[i]]


@njit(cache=True, error_model="numpy")
def ground_height(feet: Array, contacts: BoolArray, radius: float) -> float:
    """Return the height of the ground under one robot [m], as `types.ground_height` gives it."""
    total = 0.0
    count = 0
    lowest = feet[0, 2]
    for leg in range(4):
        if contacts[leg]:
            total += feet[leg, 2]
            count += 1
        if feet[leg, 2] < lowest or np.isnan(feet[leg, 2]):
            lowest = feet[leg, 2]
    return (total / count if count > 0 else lowest) - radius


@njit(cache=True, error_model="numpy")
def _fill_samples(
    q: Array,
    v: Array,
    com: Array,
    feet: Array,
    torque: Array,
    gains: tuple[float, float],
    columns: IntArray,
    out: Float32Array,
) -> None:
    """Fill rows ``(r, B, size)`` of the memory with one sample, as `memory.samples_of` makes it.

    Args:
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities.
        com: ``(B, 3)`` center of mass [m].
        feet: ``(B, 4, 3)`` foot positions [m].
        torque: ``(B, 12)`` torques [N m]; NaN makes the joint angle the target.
        gains: kp and kd of the PD, which turn torques into targets.
        columns: Where the parts of a sample lie in a whole row.
        out: The rows to fill.
    """
    kp, kd = gains
    size = len(columns)
    row = np.empty(OBSERVATION_SIZE, np.float32)
    for robot in range(len(q)):
        _fill_row(q[robot], v[robot], com[robot], feet[robot], row)
        for i in range(size):
            out[0, robot, i] = row[columns[i]]
        for i in range(out.shape[2] - size):
            target = q[robot, 7 + i]
            if not np.isnan(torque[robot, i]):
                target = (torque[robot, i] + kd * v[robot, 6 + i]) / kp + target
            out[0, robot, size + i] = target
    for tick in range(1, len(out)):
        out[tick] = out[0]


@njit(cache=True)
def _fill_history(ring: Float32Array, rows: IntArray, start: int, out: Float32Array) -> None:
    """Write the samples in the given rows of the memory into the inputs, starting at a column."""
    size = ring.shape[2]
    for number in range(len(rows)):
        sample = ring[rows[number]]
        begin = start + number * size
        for robot in range(len(sample)):
            for i in range(size):
                out[robot, begin + i] = sample[robot, i]


@njit(cache=True, error_model="numpy")
def _fill_inputs(
    q: Array,
    v: Array,
    com: Array,
    feet: Array,
    tick: IntArray,
    command: Array,
    phases: Float32Array,
    out: Float32Array,
) -> None:
    """Fill the first B rows of ``out`` ``(n, 47)`` as `network_input` does.

    Args:
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities.
        com: ``(B, 3)`` center of mass [m].
        feet: ``(B, 4, 3)`` foot positions [m].
        tick: ``(B,)`` gait clock [ms].
        command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        phases: ``(period, 2)`` what the network sees of the gait clock, `ObservationSpec.phases`.
        out: The network's inputs.
    """
    for robot in range(len(q)):
        row = out[robot]
        _fill_row(q[robot], v[robot], com[robot], feet[robot], row)
        phase = tick[robot] % len(phases)
        row[42] = phases[phase, 0]
        row[43] = phases[phase, 1]
        for i in range(3):
            row[44 + i] = command[robot, i]


@njit(cache=True, error_model="numpy")
def _pd(target: Float32Array, q: Array, v: Array, kp: float, kd: float) -> Array:
    """Return the torques ``(B, 12)`` [N m] of `learning.policy.pd`."""
    torque = np.empty((len(q), 12))
    for robot in range(len(q)):
        for i in range(12):
            error = np.float64(target[robot, i]) - q[robot, 7 + i]
            torque[robot, i] = kp * error - kd * v[robot, 6 + i]
    return torque


@njit(cache=True)
def clip_torque(torque: Array, limit: Array) -> Array:
    """Clip joint torques ``(B, 12)`` [N m] to the motor limits, in a new array.

    Args:
        torque: ``(B, 12)`` joint torques [N m]; NaN becomes zero.
        limit: ``(12,)`` torque limits [N m].
    """
    clipped = np.empty(torque.shape)
    for robot in range(torque.shape[0]):
        for i in range(torque.shape[1]):
            value = torque[robot, i]
            if np.isnan(value):
                value = 0.0
            clipped[robot, i] = min(max(value, -limit[i]), limit[i])
    return clipped
