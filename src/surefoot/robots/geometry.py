"""Where a robot touches the ground: the lowest points of its shapes in a configuration.

The shapes are those of `RobotModel.shapes`, the same in every simulator: spheres for the feet,
capsules for the legs and a box for the base.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.robots.model import RobotModel
from surefoot.types import LEGS, Array


def lowest_points(robot: RobotModel, data: pin.Data, q: Array) -> tuple[Array, Array]:
    """Return the height of the lowest point of each foot ``(4,)`` and each other shape [m].

    Args:
        robot: The robot, with its shapes.
        data: Pinocchio data of its model, in which this function computes the kinematics.
        q: ``(19,)`` configuration; the ground is z = 0.
    """
    pin.framesForwardKinematics(robot.model, data, q)
    lowest = []
    for shape in robot.shapes:
        link = data.oMf[robot.model.getFrameId(shape.link)]
        ends = np.array([link.act(np.array(point)) for point in (shape.start, shape.end)])
        if len(shape.size) == 3:
            reach = np.abs(link.rotation[2]) @ np.array(shape.size)
        else:
            reach = shape.size[0]
        lowest.append(ends[:, 2].min() - reach)
    return np.array(lowest[: len(LEGS)]), np.array(lowest[len(LEGS) :])
