"""How a motion uses the limits of a robot's joints, and what to say where it is beyond them.

The expert does not know these limits. `surefoot walk` reports how it used them, and `prepare` warns
where a settled gait is beyond them.
"""

from __future__ import annotations

import numpy as np

from surefoot.robots.model import RobotModel
from surefoot.types import JOINTS, Array


def speed_shares(robot: RobotModel, v: Array) -> Array:
    """Return the share of each joint's speed limit ``(..., 12)``; 0 where there is no limit.

    Args:
        robot: The robot.
        v: ``(..., 18)`` velocities.
    """
    return np.asarray(np.abs(v[..., 6:]) / robot.speed_limit)


def speed_remark(robot: RobotModel, v: Array) -> str:
    """Say which joint is the fastest, compared with its speed limit; '' if none is too fast.

    Args:
        robot: The robot.
        v: ``(..., 18)`` velocities.
    """
    shares = speed_shares(robot, v).reshape(-1, len(JOINTS)).max(axis=0)
    joint = int(shares.argmax())
    if not shares[joint] > 1.0:
        return ""
    return (
        f"{_named(robot, joint)} turns at up to {shares[joint]:.0%} of its speed limit, "
        f"{robot.speed_limit[joint]:g} rad/s"
    )


def range_remark(robot: RobotModel, q: Array) -> str:
    """Say which joint is farthest beyond its position limits; '' if none is beyond them.

    Args:
        robot: The robot.
        q: ``(..., 19)`` configurations.
    """
    low, high = robot.position_limit.T
    angles = q[..., 7:].reshape(-1, len(JOINTS))
    beyond = np.maximum(low - angles, angles - high)
    if not (beyond > 0.0).any():
        return ""
    time, joint = np.unravel_index(np.nanargmax(beyond), beyond.shape)
    share = 100.0 * (beyond > 0.0).any(axis=1).mean()
    return (
        f"in {share:.3g} % of the time a joint is beyond its position limits, most of all "
        f"{_named(robot, int(joint))} at {angles[time, joint]:.2f} rad, where {low[joint]:.2f} to "
        f"{high[joint]:.2f} are allowed; if the gait is not to blame, check the signs in `front` "
        "and `hind`, and that the limits of left and right joints are mirror images"
    )


def _named(robot: RobotModel, joint: int) -> str:
    """The name of a joint, and what it is called in the description."""
    return f"{JOINTS[joint]} ({robot.spec.source_joints[joint]!r} in the URDF)"
