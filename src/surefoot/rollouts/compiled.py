"""What the engine computes in every tick around simulator and network, compiled.

Between two runs of a network, whose weights fill the cache of a core, each of numpy's operations on
a small array costs 5 us instead of 1. These functions make the same operations in the same order
in one call: `driver` around a trained policy's network, `clip_torque` for every torque. The numpy
forms are the reference, which training and deployment use: `learning.observation.network_input`,
`learning.policy.pd`, `robots.model.clip_torque`. The results are the same to the bit, on a
processor that fuses multiplications and additions as numpy does. Read `engine` next.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from surefoot.learning.network import MINIMUM_ROWS
from surefoot.learning.observation import INPUT_SIZE, Float32Array
from surefoot.learning.policy import Policy
from surefoot.robots import rigid
from surefoot.types import Array, BoolArray, Controller, IntArray, State


def driver(policy: Controller) -> Controller:
    """Return what drives as a controller does: a trained policy compiled, any other as it is."""
    return CompiledPolicy(policy) if type(policy) is Policy else policy


class CompiledPolicy:
    """A trained policy, whose observation and PD are compiled; see `learning.policy.Policy`.

    Args:
        policy: The policy.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._phases = policy.spec.observation.phases

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


def _build_multiply_add(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    """Return the type of a * b + c, rounded once, and what writes its machine instruction."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), build


# numpy rounds once where it multiplies complex numbers, as `rotations.to_heading` does.
_multiply_add: Any = intrinsic(_build_multiply_add)


@njit(cache=True, error_model="numpy")
def heading(x: float, y: float) -> tuple[float, float]:
    """Return the heading of a base whose x axis has these horizontal parts; yaw 0 without any."""
    length = np.hypot(x, y)
    if length <= 1e-9:
        return 1.0, 0.0
    return x / length, y / length


@njit(cache=True, error_model="numpy")
def to_heading(x: float, y: float, cos: float, sin: float) -> tuple[float, float]:
    """Return a horizontal world vector in the frame of a heading."""
    return _multiply_add(x, cos, y * sin), _multiply_add(x, -sin, y * cos)


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
        X, Y, Z = rigid.rotation(q[robot])
        row = out[robot]
        row[0] = q[robot, 2]
        for i in range(3):
            row[1 + i] = -Z[i]
        for i in range(6):
            row[4 + i] = v[robot, i]
        for i in range(12):
            row[10 + i] = q[robot, 7 + i]
            row[22 + i] = v[robot, 6 + i]
        cos, sin = heading(X[0], Y[0])
        for leg in range(4):
            dx = feet[robot, leg, 0] - com[robot, 0]
            dy = feet[robot, leg, 1] - com[robot, 1]
            row[34 + 2 * leg], row[35 + 2 * leg] = to_heading(dx, dy, cos, sin)
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
        torque: ``(B, 12)`` joint torques [N m]; what is not a number becomes zero.
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
