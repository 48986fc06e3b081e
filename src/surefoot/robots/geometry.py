"""Where a robot touches the ground: lowest points of its shapes, and states without a simulator.

The shapes are those of `RobotModel.shapes`, the same in every simulator: spheres for the feet,
capsules for the legs and a box for the base.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import center_of_mass, feet, legs_of, masses_of
from surefoot.types import LEGS, Array, IntArray, State

POINT_DISTANCE = 0.02
"""[m] The largest distance between the points that stand for the surface of a shape."""
RINGS = (0.0, 0.35, 0.7, 0.95)
"""The circles of points below a sphere, as shares of its radius."""
SPOKES = 8
"""The number of points on each of these circles."""
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


def undersides(robot: RobotModel, data: pin.Data, q: Array) -> tuple[Array, IntArray]:
    """Return points of the surface of a robot that could touch uneven ground first.

    Args:
        robot: The robot, with its shapes.
        data: Pinocchio data of its model, in which this function computes the kinematics.
        q: ``(19,)`` configuration.

    Returns:
        Points ``(n, 3)``, world frame [m], and the index of the shape ``(n,)`` that each is on.
    """
    pin.framesForwardKinematics(robot.model, data, q)
    parts = []
    for shape in robot.shapes:
        link = data.oMf[robot.model.getFrameId(shape.link)]
        if len(shape.size) == 3:
            points = np.array(shape.start) + _box_surface(np.array(shape.size))
            parts.append(points @ link.rotation.T + link.translation)
        else:
            ends = np.array([link.act(np.array(point)) for point in (shape.start, shape.end)])
            spheres = _between(*ends)
            parts.append((spheres[:, None] + shape.size[0] * _below_unit_sphere()).reshape(-1, 3))
    of_shape = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return np.concatenate(parts), of_shape


def _between(start: Array, end: Array) -> Array:
    """Points ``(n, 3)`` along a line, both ends included; one point if they coincide."""
    length = float(np.linalg.norm(end - start))
    count = 1 + int(np.ceil(length / POINT_DISTANCE))
    return np.linspace(start, end, count)


def _below_unit_sphere() -> Array:
    """Points ``(n, 3)`` of the lower half of a sphere of radius 1 about the origin."""
    angle = np.arange(SPOKES) * (2.0 * np.pi / SPOKES)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(SPOKES)], axis=1)
    points = np.concatenate([share * ring for share in RINGS])
    points[:, 2] = -np.sqrt(1.0 - points[:, 0] ** 2 - points[:, 1] ** 2)
    return points


def _box_surface(half_edges: Array) -> Array:
    """Points ``(n, 3)`` of the surface of a box about the origin, its corners among them."""
    axes = [np.linspace(-half, half, 2 + int(2 * half / POINT_DISTANCE)) for half in half_edges]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return points[(np.abs(points) >= half_edges).any(axis=1)]


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
