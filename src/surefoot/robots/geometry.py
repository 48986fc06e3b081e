"""What of the robot can touch the ground: the same shapes in every simulator and every check.

Mesh hulls are slow and differ between engines, so a foot is a sphere around its frame, a leg two
capsules, the base a box.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.robots.model import RobotModel
from surefoot.types import LEGS, Array


def lowest_points(robot: RobotModel, data: pin.Data, q: Array) -> tuple[Array, Array]:
    """Height of the lowest point of each foot sphere, and of each other shape [m].

    Args:
        robot: its model.
        data: Pinocchio data; kinematics is computed here.
        q: ``(19,)`` configuration; the ground is z = 0.
    """
    pin.framesForwardKinematics(robot.model, data, q)
    lowest = []
    for shape in robot.shapes:
        link = data.oMf[robot.model.getFrameId(shape.link)]
        ends = np.array([link.act(np.array(point)) for point in (shape.start, shape.end)])
        reach = (
            np.abs(link.rotation[2]) @ np.array(shape.size)
            if len(shape.size) == 3
            else shape.size[0]
        )
        lowest.append(ends[:, 2].min() - reach)
    return np.array(lowest[: len(LEGS)]), np.array(lowest[len(LEGS) :])
