"""What of the robot can touch the ground: the same shapes in every simulator and every check.

Mesh hulls are slow and differ between engines, so a foot is a sphere around its frame, a leg two
capsules, the base a box.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from surefoot.robots.model import RobotModel
from surefoot.types import LEGS, Array


class Shape(NamedTuple):
    """A box, or a capsule that is a sphere where both its ends coincide; in its link's frame.

    Attributes:
        link: URDF link that carries the shape.
        start: ``(3,)`` one end of the capsule's axis, or the centre of the box [m].
        end: ``(3,)`` the other end [m].
        size: radius of the capsule, or half edges of the box [m].
    """

    link: str
    start: tuple[float, ...]
    end: tuple[float, ...]
    size: tuple[float, ...]


# Extents of Solo12's meshes: base 448 x 219 x 53 mm, upper leg 37 to 44 mm thick, lower leg 27 mm.
BASE_CENTRE = (0.0, 0.0, 0.0015)
BASE_HALF_EDGES = (0.2241, 0.1095, 0.0265)
UPPER_LEG_RADIUS = 0.0185
LOWER_LEG_RADIUS = 0.0135


def contact_shapes(robot: RobotModel) -> list[Shape]:
    """The geometry that meets the ground, the same in every simulator; feet first, as ``LEGS``.

    Mesh hulls are slow and differ between engines. A foot is a sphere around its frame, a leg two
    capsules, the base (whose outline includes the hips) a box. The lower leg's capsule stops one
    foot diameter short of the foot, so that a foot's force is never a shin's.
    """
    feet, rest = [], [Shape("base_link", BASE_CENTRE, BASE_CENTRE, BASE_HALF_EDGES)]
    for leg, foot_id in zip(LEGS, robot.feet, strict=True):
        foot = robot.model.frames[foot_id].placement.translation
        knee = robot.model.jointPlacements[robot.model.getJointId(f"{leg}_KFE")].translation
        feet.append(Shape(f"{leg}_FOOT", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (robot.foot_radius,)))
        # Both links run along z; the upper one is centred between its two joints.
        x, y, z = (float(value) for value in knee)
        upper = ((x, y / 2, 0.0), (x, y / 2, z))
        x, y, z = (float(value) for value in foot)
        lower = ((x, y, 0.0), (x, y, z + 2 * robot.foot_radius))
        rest.append(Shape(f"{leg}_UPPER_LEG", *upper, (UPPER_LEG_RADIUS,)))
        rest.append(Shape(f"{leg}_LOWER_LEG", *lower, (LOWER_LEG_RADIUS,)))
    return feet + rest


def lowest_points(robot: RobotModel, data: pin.Data, q: Array) -> tuple[Array, Array]:
    """Height of the lowest point of each foot sphere, and of each other shape [m].

    Args:
        robot: its model.
        data: Pinocchio data; kinematics is computed here.
        q: ``(19,)`` configuration; the ground is z = 0.
    """
    pin.framesForwardKinematics(robot.model, data, q)
    lowest = []
    for shape in contact_shapes(robot):
        link = data.oMf[robot.model.getFrameId(shape.link)]
        ends = np.array([link.act(np.array(point)) for point in (shape.start, shape.end)])
        reach = (
            np.abs(link.rotation[2]) @ np.array(shape.size)
            if len(shape.size) == 3
            else shape.size[0]
        )
        lowest.append(ends[:, 2].min() - reach)
    return np.array(lowest[: len(LEGS)]), np.array(lowest[len(LEGS) :])
