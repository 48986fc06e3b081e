"""Where a robot's feet and its center of mass are, from a small table and the joint angles alone.

Each foot hangs on three revolute joints; from the foot up, each joint turns all that hangs below it
about its axis (a product of exponentials). The table has all axes, points and masses in the base
frame, with all joints at zero, so that any language computes this in a few lines. Read `policy`
next, which makes observations of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from surefoot import rotations
from surefoot.types import LEGS, Array

LEG_JOINTS = 3
"""The joints of a leg: hip abduction, hip flexion, knee."""

Point = tuple[float, float, float]
"""A point [m], or a direction, in the base frame."""
LegPoints = tuple[Point, Point, Point]
"""One for each joint of a leg, the hip first."""


@dataclass(frozen=True)
class KinematicTable:
    """The geometry and the masses of a robot, base frame, all joints at zero.

    Legs come as in `LEGS`, the joints of a leg from the hip to the knee.

    Attributes:
        joint_axes: ``(4, 3, 3)`` unit axis of each joint.
        joint_positions: ``(4, 3, 3)`` a point of each axis [m].
        foot_positions: ``(4, 3)`` centers of the feet [m].
        foot_radius: Radius of the feet [m].
        base_mass: Mass of the base, with all that does not move in it [kg].
        base_com: ``(3,)`` center of mass of the base [m].
        link_masses: ``(4, 3)`` mass of what each joint turns by itself [kg].
        link_coms: ``(4, 3, 3)`` center of mass of each of them [m].

    Raises:
        ValueError: There are not four legs of three joints, or a number makes no sense.
    """

    joint_axes: tuple[LegPoints, LegPoints, LegPoints, LegPoints]
    joint_positions: tuple[LegPoints, LegPoints, LegPoints, LegPoints]
    foot_positions: tuple[Point, Point, Point, Point]
    foot_radius: float
    base_mass: float
    base_com: Point
    link_masses: tuple[Point, Point, Point, Point]
    link_coms: tuple[LegPoints, LegPoints, LegPoints, LegPoints]

    def __post_init__(self) -> None:
        """Check shapes, unit axes and masses."""
        for name, shape in _SHAPES.items():
            array = np.array(getattr(self, name), float)
            if array.shape != shape or not np.isfinite(array).all():
                raise ValueError(f"kinematics.{name} must be {shape} finite numbers")
        lengths = np.linalg.norm(self.joint_axes, axis=-1)
        if np.abs(lengths - 1.0).max() > 1e-9:
            raise ValueError("kinematics.joint_axes must have length 1")
        if self.base_mass <= 0.0 or np.min(self.link_masses) < 0.0:
            raise ValueError("kinematics: masses must be positive")

    @cached_property
    def arrays(self) -> _Arrays:
        """The same as arrays, made once."""
        masses = np.array(self.link_masses)
        axes = np.array(self.joint_axes)
        along = axes[..., :, None] * axes[..., None, :]
        return _Arrays(
            axes=axes,
            along=along,
            across=np.eye(3) - along,
            # Its columns are the cross products of the axis with the unit vectors.
            skew=np.swapaxes(np.cross(axes[..., None, :], np.eye(3)), -1, -2),
            centers=np.array(self.joint_positions),
            feet=np.array(self.foot_positions),
            masses=masses,
            moments=masses[..., None] * np.array(self.link_coms),
            base_moment=self.base_mass * np.array(self.base_com),
            total=self.base_mass + float(masses.sum()),
        )


_SHAPES = {
    "joint_axes": (len(LEGS), LEG_JOINTS, 3),
    "joint_positions": (len(LEGS), LEG_JOINTS, 3),
    "foot_positions": (len(LEGS), 3),
    "foot_radius": (),
    "base_mass": (),
    "base_com": (3,),
    "link_masses": (len(LEGS), LEG_JOINTS),
    "link_coms": (len(LEGS), LEG_JOINTS, 3),
}


@dataclass(frozen=True)
class _Arrays:
    """The table as arrays, with moments of mass in place of centers.

    Attributes:
        axes: ``(4, 3, 3)`` unit axes a.
        along: ``(4, 3, 3, 3)`` projections on the axes, a a^T.
        across: ``(4, 3, 3, 3)`` projections on their normal planes, 1 - a a^T.
        skew: ``(4, 3, 3, 3)`` cross products with the axes.
        centers: ``(4, 3, 3)`` points of the axes [m].
        feet: ``(4, 3)`` centers of the feet [m].
        masses: ``(4, 3)`` masses of the links [kg].
        moments: ``(4, 3, 3)`` masses times centers of mass of the links [kg m].
        base_moment: ``(3,)`` that of the base [kg m].
        total: Mass of the robot [kg].
    """

    axes: Array
    along: Array
    across: Array
    skew: Array
    centers: Array
    feet: Array
    masses: Array
    moments: Array
    base_moment: Array
    total: float


def feet_in_base(table: KinematicTable, joints: Array) -> Array:
    """The centers of the feet ``(..., 4, 3)`` in the base frame [m].

    Args:
        table: The robot.
        joints: ``(..., 12)`` joint angles [rad].
    """
    arrays = table.arrays
    turns = _turns(arrays, joints)
    point = arrays.feet
    for joint in reversed(range(LEG_JOINTS)):
        center = arrays.centers[:, joint]
        point = center + _turned(point - center, turns[..., joint, :, :])
    return point


def com_in_base(table: KinematicTable, joints: Array) -> Array:
    """The center of mass ``(..., 3)`` in the base frame [m].

    Args:
        table: The robot.
        joints: ``(..., 12)`` joint angles [rad].
    """
    arrays = table.arrays
    turns = _turns(arrays, joints)
    moment: Array = np.zeros((len(LEGS), 3))
    hanging = np.zeros(len(LEGS))
    for joint in reversed(range(LEG_JOINTS)):
        center = arrays.centers[:, joint]
        hanging = hanging + arrays.masses[:, joint]
        at_center = hanging[:, None] * center
        arm = moment + arrays.moments[:, joint] - at_center
        moment = at_center + _turned(arm, turns[..., joint, :, :])
    return (arrays.base_moment + moment.sum(axis=-2)) / arrays.total


def in_heading(points: Array, orientation: Array) -> Array:
    """Vectors of the base frame ``(..., n, 3)`` in the heading frame: upright, x where it faces.

    Args:
        points: ``(..., n, 3)`` vectors in the base frame.
        orientation: ``(..., 4)`` unit quaternions xyzw, base frame to world frame.
    """
    rotation = rotations.rotation(orientation)
    world = points @ np.swapaxes(rotation, -1, -2)
    heading = rotations.heading(rotation)[..., None, :]
    level = rotations.to_heading(world[..., :2], heading)
    return np.concatenate([level, world[..., 2:]], axis=-1)


def _turns(arrays: _Arrays, joints: Array) -> Array:
    """The rotations ``(..., 4, 3, 3, 3)`` of all joints of all legs (Rodrigues).

    A robot asks for them at 1 kHz: few operations on all joints at once, and no cross product.
    """
    joints = np.asarray(joints, float)
    angles = joints.reshape(*joints.shape[:-1], len(LEGS), LEG_JOINTS, 1, 1)
    return arrays.along + np.cos(angles) * arrays.across + np.sin(angles) * arrays.skew


def _turned(points: Array, turns: Array) -> Array:
    """Points ``(..., 4, 3)`` turned by rotations ``(..., 4, 3, 3)``."""
    return (turns @ points[..., None])[..., 0]
