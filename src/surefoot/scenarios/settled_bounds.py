"""The safety bounds of a settled gait: the robot's own table, widened to what the gait needs.

A gate with these bounds never calls the expert while the robot walks as it should. Read
`robots.scaling` for the robot's own table, and `prepare` for the walks.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.config.checked import known
from surefoot.robots.bounds import joint_rows
from surefoot.robots.geometry import state_of
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import size_of
from surefoot.scenarios.walking import Walks
from surefoot.types import Array

MARGIN = 10.0
"""[deg] How far the bounds on angles are beyond what the settled gait needs."""
LOWER = 0.02
"""[m] How far the bounds on the height are beyond it, times the ratio of leg lengths."""
SHARE = 0.5
"""Share of these margins that remains where a gate tightens the bounds."""
ROUND = 1e4
"""Bounds have four decimals."""


def settled_bounds(robot: RobotModel, safety: SafetyConfig, walks: Walks) -> SafetyConfig:
    """The bounds, widened to contain a settled gait with a margin, with the field `settled` set.

    Args:
        robot: The robot.
        safety: The robot's own bounds.
        walks: The settled part of the walks.
    """
    q = np.ascontiguousarray(walks.q.reshape(-1, 19))
    state = state_of(robot, q, np.ascontiguousarray(walks.v.reshape(-1, 18)))
    below = LOWER * size_of(robot).length_ratio
    com_height = _widened(known(safety.com_height, "safety.com_height"), state.com[:, 2], below)
    tilt = known(safety.roll_pitch, "safety.roll_pitch")
    tilts = np.abs(np.degrees(state.roll_pitch))
    _, tilt = _widened((-tilt, tilt), tilts, MARGIN)
    settled = (
        round(float(state.com[:, 2].min()) - SHARE * below, 4),
        round(float(tilts.max()) + SHARE * MARGIN, 4),
    )
    angles = np.degrees(q[:, 7:]).T
    own = joint_rows(safety)
    joints = tuple(_widened(*row, MARGIN) for row in zip(own, angles, strict=True))
    safety = replace(safety, com_height=com_height, roll_pitch=tilt, settled=settled)
    return safety if joints == own else replace(safety, joints=joints)


def _widened(bounds: tuple[float, float], values: Array, margin: float) -> tuple[float, float]:
    """The bounds, widened where necessary to lie a margin beyond the values."""
    low, high = bounds
    lowest = float(values.min()) - margin
    highest = float(values.max()) + margin
    # Rounded outward, and only if the bound changes.
    if lowest < low:
        low = math.floor(lowest * ROUND) / ROUND
    if highest > high:
        high = math.ceil(highest * ROUND) / ROUND
    return low, high
