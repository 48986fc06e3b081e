"""Bounds on how a robot stands: those of the safety table, and those beyond which it has fallen.

Array code over B robots, which the gates, the rollouts and the initial states all use. Read
`robots.scaling` next for a robot's own bounds, and `safety.gates` for their use.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit

from surefoot.config import SafetyConfig
from surefoot.config.checked import known
from surefoot.robots import rigid
from surefoot.types import Array, BoolArray

LEFT_RIGHT = (1.0, -1.0, 1.0, -1.0)
"""Sign of each leg's hip-abduction bounds: they are given for left legs."""
FRONT_HIND = (1.0, 1.0, -1.0, -1.0)
"""Sign of each leg's hip-flexion and knee bounds: they are given for front legs."""
Rows = tuple[tuple[float, float], ...]
"""The smallest and the largest angle of each joint [deg]."""


def fallen(q: Array, safety: SafetyConfig) -> BoolArray:
    """``(B,)`` True where base height, roll or pitch is that of a robot that has fallen.

    Numbers that are not finite, from a simulation that has run away, count as fallen.

    Args:
        q: ``(B, 19)`` configurations, with the height of the base above the ground.
        safety: The bounds beyond which a robot has fallen.
    """
    return outside(q[:, 2], q, *_fall_bounds(safety))


@lru_cache
def _fall_bounds(safety: SafetyConfig) -> tuple[Array, Array]:
    """Bounds ``(3,)`` of the base's height [m], roll and pitch [rad]."""
    low, high = known(safety.fall_height, "safety.fall_height")
    angle = np.radians(safety.fall_angle)
    return np.array([low, -angle, -angle]), np.array([high, angle, angle])


@lru_cache
def table_bounds(safety: SafetyConfig) -> tuple[Array, Array]:
    """Lower and upper bounds ``(15,)`` of the center of mass's height [m] and the angles [rad].

    The angles are roll, pitch, and the three joints of every leg.

    Args:
        safety: The table.

    Raises:
        ValueError: A bound is None, which stands for the robot's own.
    """
    tilt = known(safety.roll_pitch, "safety.roll_pitch")
    rows = ((-tilt, tilt), (-tilt, tilt), *joint_rows(safety))
    lows, highs = np.radians(rows).T
    lowest, highest = known(safety.com_height, "safety.com_height")
    return np.append(lowest, lows), np.append(highest, highs)


def joint_rows(safety: SafetyConfig) -> Rows:
    """The bounds of twelve joints [deg]: given for each, or mirrored from the left front leg.

    Args:
        safety: The table.

    Raises:
        ValueError: A bound is None, which stands for the robot's own.
    """
    if safety.joints:
        return safety.joints
    rows: Rows = ()
    for leg in range(4):
        rows += (
            mirrored(LEFT_RIGHT[leg], known(safety.hip_abduction, "safety.hip_abduction")),
            mirrored(FRONT_HIND[leg], known(safety.hip_flexion, "safety.hip_flexion")),
            mirrored(FRONT_HIND[leg], known(safety.knee, "safety.knee")),
        )
    return rows


def mirrored(sign: float, bounds: tuple[float, float]) -> tuple[float, float]:
    """The bounds of a joint [deg], with their signs changed if ``sign`` is -1."""
    low, high = sorted(sign * bound for bound in bounds)
    return low, high


@njit(cache=True, error_model="numpy")
def outside(height: Array, q: Array, low: Array, high: Array) -> BoolArray:
    """``(B,)`` True where a number is outside its bounds or is not a number.

    Compiled, because it is called every tick. Roll and pitch are those of `State.roll_pitch` except
    for the rounding of arctan and arcsin: a robot within 1e-15 rad of a bound may be judged
    differently.

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
    if abs(sine) > 1.0:  # by rounding; NaN stays NaN
        sine = math.copysign(1.0, sine)
    return math.atan2(up[1], up[2]), math.asin(sine)
