"""Where a robot touches the ground: lowest points of its shapes, and states without a simulator.

The shapes are those of `RobotModel.shapes`, the same in every simulator: spheres for the feet,
capsules for the legs and a box for the base.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import center_of_mass, feet, legs_of, masses_of
from surefoot.types import LEGS, Array, State

HIGHEST_CONTACT = 1e-3
"""[m] A foot whose sphere is at most this far above the ground is in contact, for `state_of`."""


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


def state_of(robot: RobotModel, q: Array, v: Array) -> State:
    """Return the state of B robots with these configurations and velocities; the ground is z = 0.

    Args:
        robot: The robot.
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities.
    """
    legs = legs_of(robot)
    position, _ = feet(q, legs)
    com = center_of_mass(q, legs, masses_of(robot))
    contacts = position[:, :, 2] < robot.foot_radius + HIGHEST_CONTACT
    return State(q, v, com, position, contacts)
