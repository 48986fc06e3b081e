"""A robot's feet and center of mass, from a small table and the joint angles alone.

Each foot hangs on three revolute joints; from the foot up, each joint turns all that hangs below it
about its axis (a product of exponentials). The table has all axes, points and masses in the base
frame, with all joints at zero, so that this takes a few lines in any language. Read `policy` next,
which makes observations from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from surefoot.types import LEGS, Array

LEG_JOINTS = 3
"""The joints of a leg: hip abduction, hip flexion, knee."""

Point = tuple[float, float, float]
"""A point [m], or a direction, in the base frame."""
LegPoints = tuple[Point, Point, Point]
"""One point or direction for each joint of a leg, the hip first."""


@dataclass(frozen=True)
class KinematicTable:
    """The geometry and the masses of a robot in the base frame, with all joints at zero.

    Legs are in the order of `LEGS`, the joints of a leg from the hip to the knee.

    Attributes:
        joint_axes: ``(4, 3, 3)`` unit axis of each joint.
        joint_positions: ``(4, 3, 3)`` a point on each axis [m].
        foot_positions: ``(4, 3)`` centers of the feet [m].
        foot_radius: Radius of the feet [m].
        base_mass: Mass of the base, with all that is fixed to it [kg].
        base_com: ``(3,)`` center of mass of the base [m].
        link_masses: ``(4, 3)`` mass of the link that follows each joint [kg].
        link_coms: ``(4, 3, 3)`` center of mass of each of these links [m].

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
        axes = np.array(self.joint_axes)
        along = axes[..., :, None] * axes[..., None, :]
        centers = np.array(self.joint_positions)
        total = self.base_mass + np.sum(self.link_masses)
        shares = np.array(self.link_masses)[..., None] / total
        moments = shares * np.array(self.link_coms)
        # A joint carries its own link and those below it.
        carried = np.cumsum(shares[:, ::-1], axis=1)[:, ::-1] * centers
        arms = np.stack([-centers, moments - carried], axis=-1)
        return _Arrays(
            along=along,
            across=np.eye(3) - along,
            # Its columns are the cross products of the axis with the unit vectors.
            skew=np.swapaxes(np.cross(axes[..., None, :], np.eye(3)), -1, -2),
            arms=np.swapaxes(arms, 0, 1),
            centers=np.swapaxes(np.stack([centers, carried], axis=-1), 0, 1),
            ends=np.stack([np.array(self.foot_positions), np.zeros((len(LEGS), 3))], axis=-1),
            base=self.base_mass / total * np.array(self.base_com),
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
    """The table as arrays, so that one product turns two columns about a joint of each leg.

    The first column is the position of the foot. The second is the sum of the links' centers of
    mass, each times its share of the robot's mass. A joint at c turns a foot p into c + R (p - c),
    and such a sum b, whose shares add up to m, into m c + R (b - m c).

    Attributes:
        along: ``(4, 3, 3, 3)`` projections on the axes a, a a^T.
        across: ``(4, 3, 3, 3)`` projections on their normal planes, 1 - a a^T.
        skew: ``(4, 3, 3, 3)`` cross products with the axes.
        arms: ``(3, 4, 3, 2)`` for each joint -c, and the term of its own link in b minus m c [m].
        centers: ``(3, 4, 3, 2)`` for each joint c, and m c [m].
        ends: ``(4, 3, 2)`` centers of the feet, and zeros, since nothing hangs on them [m].
        base: ``(3,)`` center of mass of the base, times its share [m].
    """

    along: Array
    across: Array
    skew: Array
    arms: Array
    centers: Array
    ends: Array
    base: Array


def feet_and_com(table: KinematicTable, joints: Array) -> tuple[Array, Array]:
    """The centers of the feet ``(..., 4, 3)`` and the center of mass ``(..., 3)``, base frame [m].

    A robot computes them at 1 kHz, so these are few operations on all legs at once.

    Args:
        table: The robot.
        joints: ``(..., 12)`` joint angles [rad].
    """
    arrays = table.arrays
    joints = np.asarray(joints, float)
    angles = joints.reshape(*joints.shape[:-1], len(LEGS), LEG_JOINTS, 1, 1)
    # Rodrigues' formula.
    turns = arrays.along + np.cos(angles) * arrays.across + np.sin(angles) * arrays.skew
    columns = arrays.ends
    for joint in reversed(range(LEG_JOINTS)):
        turned = turns[..., joint, :, :] @ (columns + arrays.arms[joint])
        columns = turned + arrays.centers[joint]
    return columns[..., 0], arrays.base + columns[..., 1].sum(axis=-2)


def com_in_base(table: KinematicTable, joints: Array) -> Array:
    """The center of mass ``(..., 3)`` in the base frame [m].

    Args:
        table: The robot.
        joints: ``(..., 12)`` joint angles [rad].
    """
    return feet_and_com(table, joints)[1]
