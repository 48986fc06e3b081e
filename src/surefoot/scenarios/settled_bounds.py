"""The safety bounds of a settled gait: the robot's own table, as wide as the gait needs it.

A gate on these never calls the expert while the robot walks as it should. Read `robots.scaling` for
the robot's own table, and `prepare` for the walks.
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
"""[deg] The bounds on angles lie so far beyond what the settled gait needs."""
LOWER = 0.02
"""[m] The bound on the height lies so far below, times the ratio of leg lengths."""
SHARE = 0.5
"""Share of these margins that remains where a gate tightens the bounds."""
ROUND = 1e4
"""Bounds have four decimals."""


def settled_bounds(robot: RobotModel, safety: SafetyConfig, walks: Walks) -> SafetyConfig:
    """Bounds widened until a settled gait stays within them, with a margin, and its `settled`.

    Args:
        robot: The robot.
        safety: The robot's own bounds.
        walks: What the robots did, settled.
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
    # Rounded outward, and only where it is another number than before.
    if lowest < low:
        low = math.floor(lowest * ROUND) / ROUND
    if highest > high:
        high = math.ceil(highest * ROUND) / ROUND
    return low, high
