"""The observation of one robot, in few operations: a tick of 1 ms leaves no time for general code.

`learning.observation.observe` is the reference, for any batch of states; a test checks that both
agree. Read `policy` next, which picks the parts that its layout has.
"""

from __future__ import annotations

import math

import numpy as np

from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.deploy.kinematics import KinematicTable, feet_and_com
from surefoot.learning.observation import Float32Array
from surefoot.types import Array

NO_HEADING = 1e-9
"""A base whose x axis is this close to the vertical has no heading; its axes are zeros."""


def observed(table: KinematicTable, sensors: Sensors, base: BaseEstimate) -> Float32Array:
    """All parts of the observation ``(42,)``, as `OBSERVATION` orders them.

    Args:
        table: The robot.
        sensors: What it measures.
        base: Height and linear velocity of its base.
    """
    up, level = attitude(sensors.orientation)
    feet, com = feet_and_com(table, sensors.joint_position)
    return np.concatenate(
        (
            np.array((base.height, -up[0], -up[1], -up[2])),
            base.velocity,
            sensors.angular_velocity,
            sensors.joint_position,
            sensors.joint_velocity,
            ((feet - com) @ level).ravel(),
        ),
        dtype=np.float32,
    )


def attitude(orientation: Array) -> tuple[tuple[float, float, float], Array]:
    """The upward direction and the heading frame's x and y axes, all in the base frame.

    The two axes are horizontal; the y axis is normal to the base's x axis, and the x axis to the y
    axis. They depend on the tilt of the base, not on its yaw.

    Args:
        orientation: ``(4,)`` unit quaternion xyzw, base frame to world frame.

    Returns:
        Three numbers, and the axes as columns ``(3, 2)``.
    """
    qx, qy, qz, qw = orientation.tolist()
    x = 2.0 * (qx * qz - qy * qw)
    y = 2.0 * (qy * qz + qx * qw)
    z = 1.0 - 2.0 * (qx * qx + qy * qy)
    length = max(math.hypot(y, z), NO_HEADING)
    axes = ((length, 0.0), (-x * y / length, z / length), (-x * z / length, -y / length))
    return (x, y, z), np.array(axes)
