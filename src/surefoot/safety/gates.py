"""When the expert takes over, and when a robot has failed: gates, blocking, falls, stalls.

A `Gate` calls states unsafe: `Bounds` by the paper's Table I, `AnyOf` if one of several does, and
those that are learned (``gates.py``). `SafetyMonitor` adds the blocking of Algorithm 4. `fallen`
ends an episode; `stepping` decides afterwards whether the robot kept walking. All array code over B
robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Protocol

import numpy as np
from numba import njit

from surefoot.config import SafetyConfig
from surefoot.types import Array, BoolArray, IntArray, State

LEFT_RIGHT = np.array([1.0, -1.0, 1.0, -1.0])
FRONT_HIND = np.array([1.0, 1.0, -1.0, -1.0])
TROT_HEIGHT = 0.20
"""[m] of the centre of mass in the trot (BiConMP)."""


def unsafe(state: State, config: SafetyConfig) -> BoolArray:
    """``(B,)`` True where a robot is outside the paper's Table I."""
    return _outside(state.com[:, 2], state.roll_pitch, state.q[:, 7:], *_table(config))


def margin(state: State, config: SafetyConfig, angle: float, height: float) -> Array:
    """``(n,)`` distance to the nearest bound of Table I, in units; negative outside.

    Args:
        state: of n robots.
        config: the bounds.
        angle: the unit of an angle [rad].
        height: the unit of the height [m].
    """
    low, high = _table(config)
    values = np.column_stack([state.com[:, 2], state.roll_pitch, state.q[:, 7:]])
    unit = np.append(height, np.full(len(low) - 1, angle))
    return (np.minimum(values - low, high - values) / unit).min(axis=1)


@njit(cache=True)
def _outside(height: Array, roll_pitch: Array, joints: Array, low: Array, high: Array) -> BoolArray:
    """Where a number is outside its bounds, or none; compiled, because it is asked every tick."""
    result = np.empty(len(height), np.bool_)
    for robot in range(len(height)):
        inside = low[0] <= height[robot] <= high[0]
        for i in range(2):
            inside &= low[1 + i] <= roll_pitch[robot, i] <= high[1 + i]
        for i in range(joints.shape[1]):
            inside &= low[3 + i] <= joints[robot, i] <= high[3 + i]
        result[robot] = not inside
    return result


@lru_cache
def _table(config: SafetyConfig) -> tuple[Array, Array]:
    """Bounds ``(15,)`` of the centre of mass's height [m], roll, pitch and the joints [rad]."""
    hip, thigh, knee = config.hip_abduction, config.hip_flexion, config.knee
    rows = [(-config.roll_pitch, config.roll_pitch)] * 2
    for side, end in zip(LEFT_RIGHT, FRONT_HIND, strict=True):
        for sign, bounds in ((side, hip), (end, thigh), (end, knee)):
            low, high = sorted(sign * bound for bound in bounds)
            rows.append((low, high))
    low, high = np.radians(rows).T
    return np.append(config.com_height[0], low), np.append(config.com_height[1], high)


class Gate(Protocol):
    """Says in which states the expert is needed (pi_safe, pi_safety)."""

    def reset(self, batch: int) -> None:
        """Forget everything; ``batch`` robots follow."""
        ...

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where a state is unsafe; called once a tick.

        Args:
            state: of B robots, as they measure it.
            tick: ``(B,)`` gait clock [ms].
            command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        """
        ...


class Bounds:
    """The paper's Table I."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def reset(self, batch: int) -> None:
        """It has no memory."""

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """True outside the table."""
        return unsafe(state, self._config)


def tightened(config: SafetyConfig, share: float) -> SafetyConfig:
    """The bounds on height, roll and pitch moved towards a level trot; the joints keep theirs.

    Args:
        config: Table I.
        share: of the angles that is left, and of the height below that of the trot; 1 changes
            nothing.
    """
    low, high = config.com_height
    low = TROT_HEIGHT - share * (TROT_HEIGHT - low)
    return replace(config, com_height=(low, high), roll_pitch=share * config.roll_pitch)


class AnyOf:
    """Unsafe where one of several gates says so."""

    def __init__(self, gates: Sequence[Gate]) -> None:
        self._gates = gates

    def reset(self, batch: int) -> None:
        """For all of them."""
        for gate in self._gates:
            gate.reset(batch)

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """Every gate is asked at every tick, whatever the others say: they may remember."""
        return np.any([gate.unsafe(state, tick, command) for gate in self._gates], axis=0)
