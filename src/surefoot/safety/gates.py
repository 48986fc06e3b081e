"""Gates: which states are unsafe, so that the expert has to drive.

A `Gate` is asked once a tick about B robots. `Bounds` applies the paper's Table I, `AnyOf` combines
several gates, and learned gates are in ``learned.py``. `unsafe` and `margin` are the table as plain
functions. Read next: ``monitor.py``, which adds the blocking of
Algorithm 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Protocol

import numpy as np
from numba import njit

from surefoot.config import SafetyConfig
from surefoot.robots import rigid
from surefoot.types import Array, BoolArray, IntArray, State

LEFT_RIGHT = np.array([1.0, -1.0, 1.0, -1.0])
"""Sign of each leg's hip-abduction bounds: they are given for left legs."""
FRONT_HIND = np.array([1.0, 1.0, -1.0, -1.0])
"""Sign of each leg's hip-flexion and knee bounds: they are given for front legs."""


class Gate(Protocol):
    """Says which states are unsafe, so that the expert has to drive."""

    def reset(self, batch: int) -> None:
        """Forget everything and prepare for ``batch`` robots."""
        ...

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where a state is unsafe; called once a tick.

        Args:
            state: States of B robots, as they measure them.
            tick: ``(B,)`` gait clock [ms].
            command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        """
        ...


class Bounds:
    """The gate of the paper's Table I.

    Args:
        config: The table.
    """

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config
        self._low, self._high = bounds_of(config)

    def reset(self, batch: int) -> None:
        """Do nothing: this gate has no memory."""

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where a robot is outside the table."""
        return outside(state.com[:, 2], state.q, self._low, self._high)


class AnyOf:
    """The gate that calls a state unsafe if one of several gates does.

    Args:
        gates: The gates.
    """

    def __init__(self, gates: Sequence[Gate]) -> None:
        self._gates = gates

    def reset(self, batch: int) -> None:
        """Reset all of them."""
        for gate in self._gates:
            gate.reset(batch)

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where any gate says so. Every gate is asked: it may have a memory."""
        return np.any([gate.unsafe(state, tick, command) for gate in self._gates], axis=0)


def unsafe(state: State, config: SafetyConfig) -> BoolArray:
    """``(B,)`` True where a robot is outside the paper's Table I.

    Args:
        state: States of B robots.
        config: The table.
    """
    low, high = bounds_of(config)
    return outside(state.com[:, 2], state.q, low, high)


def margin(state: State, config: SafetyConfig, angle: float, height: float) -> Array:
    """``(B,)`` distance of each robot to the nearest bound of Table I, negative outside.

    Distances to bounds on angles and on the height are made comparable by a unit for each: a margin
    of 1 is ``angle`` away from a bound on an angle, or ``height`` away from one on the height.

    Args:
        state: States of B robots.
        config: The table.
        angle: Unit of the distance to a bound on an angle [rad].
        height: Unit of the distance to a bound on the height [m].
    """
    low, high = bounds_of(config)
    values = np.column_stack([state.com[:, 2], state.roll_pitch, state.q[:, 7:]])
    unit = np.append(height, np.full(len(low) - 1, angle))
    return (np.minimum(values - low, high - values) / unit).min(axis=1)


def tightened(config: SafetyConfig, share: float, height: float) -> SafetyConfig:
    """The table with height, roll and pitch moved towards a level gait; joints keep their bounds.

    Args:
        config: The table.
        share: How much is left of the angles, and of the distance from the gait's height down to
            its lower bound; 1 changes nothing.
        height: Height of the center of mass in the gait [m].
    """
    low, high = config.com_height
    low = height - share * (height - low)
    return replace(config, com_height=(low, high), roll_pitch=share * config.roll_pitch)


@njit(cache=True, error_model="numpy")
def outside(height: Array, q: Array, low: Array, high: Array) -> BoolArray:
    """``(B,)`` True where a number is outside its bounds or is not a number.

    Compiled, because it is asked every tick. Roll and pitch are those of `State.roll_pitch` but for
    the rounding of arctan and arcsin: a robot within 1e-15 rad of a bound may be judged otherwise.

    Args:
        height: ``(B,)`` heights [m].
        q: ``(B, 19)`` configurations, for the angles.
        low: ``(3 + n,)`` lower bounds of height, roll, pitch and the first n joints.
        high: ``(3 + n,)`` upper bounds.
    """
    result = np.empty(len(height), np.bool_)
    for robot in range(len(height)):
        roll, pitch = _roll_pitch(rigid.rotation(q[robot])[2])
        inside = low[0] <= height[robot] <= high[0]
        inside &= low[1] <= roll <= high[1]
        inside &= low[2] <= pitch <= high[2]
        for i in range(len(low) - 3):
            inside &= low[3 + i] <= q[robot, 7 + i] <= high[3 + i]
        result[robot] = not inside
    return result


@njit(cache=True, error_model="numpy")
def _roll_pitch(up: rigid.Vector) -> tuple[float, float]:
    """Roll and pitch [rad] of a base that sees the vertical as ``up``."""
    sine = -up[0]
    if abs(sine) > 1.0:  # by rounding; what is not a number stays so
        sine = math.copysign(1.0, sine)
    return math.atan2(up[1], up[2]), math.asin(sine)


@lru_cache
def bounds_of(config: SafetyConfig) -> tuple[Array, Array]:
    """Lower and upper bounds ``(15,)`` of the center of mass's height [m] and the angles [rad].

    The angles are roll, pitch, and the three joints of every leg.

    Args:
        config: The table.
    """
    rows = [(-config.roll_pitch, config.roll_pitch)] * 2
    rows += config.joints or _mirrored(config)
    lows, highs = np.radians(rows).T
    lowest, highest = config.com_height
    return np.append(lowest, lows), np.append(highest, highs)


def _mirrored(config: SafetyConfig) -> list[tuple[float, float]]:
    """The bounds of twelve joints [deg]: those of a left front leg, mirrored for the others."""
    rows = []
    for left, front in zip(LEFT_RIGHT, FRONT_HIND, strict=True):
        joints = (
            (left, config.hip_abduction),
            (front, config.hip_flexion),
            (front, config.knee),
        )
        for sign, bounds in joints:
            low, high = sorted(sign * bound for bound in bounds)
            rows.append((low, high))
    return rows
