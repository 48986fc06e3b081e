"""The safety bounds of a robot's twelve joints: its own, from the nominal pose, or given ranges.

Ranges are given for the left front leg, and mirrored for the others. Next:
`robots.scaling.own_safety`, which joins them with the other bounds.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.config import SafetyConfig
from surefoot.robots.bounds import Rows, mirrored
from surefoot.robots.canonical import joint_axes
from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import legs_of
from surefoot.types import LEGS, Array

RANGES = ("hip_abduction", "hip_flexion", "knee")
"""The fields of `SafetyConfig` that are ranges of the left front leg's joints."""


def joint_bounds(robot: RobotModel) -> tuple[tuple[float, float], ...]:
    """Return the smallest and largest safe angle of each joint [deg], from the nominal pose.

    Abduction may turn a foot 30 degrees inward and 60 outward, flexion 45 either way, and a knee
    may go from straight to 68 degrees more bent than in the nominal pose. For Solo12 that is the
    paper's Table I, to a degree; it works for knees that bend either way and for joints of any
    sign.

    Args:
        robot: The robot.
    """
    nominal = np.degrees(robot.nominal[7:]).reshape(4, 3)
    straight = np.degrees(straight_knees(robot))
    outward = outward_signs(robot)
    rows = []
    for leg in range(4):
        hip, flexion, knee = nominal[leg]
        rows.append(sorted((hip - 30.0 * outward[leg], hip + 60.0 * outward[leg])))
        rows.append((flexion - 45.0, flexion + 45.0))
        bent = knee + np.copysign(68.0, knee - straight[leg])
        rows.append(sorted((straight[leg], bent)))
    return tuple((round(float(low), 3), round(float(high), 3)) for low, high in rows)


def with_ranges(rows: Rows, safety: SafetyConfig, robot: RobotModel) -> Rows:
    """Return the bounds of twelve joints [deg]: the given ranges, or else those in ``rows``.

    Args:
        rows: The bounds of joints whose range is None.
        safety: The ranges, of the left front leg.
        robot: The robot, whose joints decide how the other legs are mirrored.
    """
    given = [vars(safety)[name] for name in RANGES]
    return tuple(
        row if bounds is None else mirrored(sign, bounds)
        for row, bounds, sign in zip(rows, 4 * given, mirror_signs(robot).flat, strict=True)
    )


def mirror_signs(robot: RobotModel) -> Array:
    """Return ``(4, 3)`` -1 where the image of a joint of the left front leg turns the other way.

    This is the case if the joints' axes are opposed, or if the legs bend to opposite sides.
    """
    bent = np.sign(robot.nominal[7:].reshape(4, 3)[:, 2] - straight_knees(robot))
    axis = legs_of(robot).axis
    # 1 where flexion and knee turn about axes that point the same way, and -1 where they are
    # opposed.
    alike = np.sign((axis[:, 1] * axis[:, 2]).sum(axis=1))
    signs = np.column_stack([outward_signs(robot), bent * alike, bent])
    return signs * signs[0]


def outward_signs(robot: RobotModel) -> Array:
    """Return ``(4,)`` 1 where a positive abduction moves a leg's foot outward, and -1 elsewhere."""
    data = robot.model.createData()
    pin.computeJointJacobians(robot.model, data, robot.nominal)
    signs = []
    for number, (leg, foot) in enumerate(zip(LEGS, robot.feet, strict=True)):
        pin.updateFramePlacement(robot.model, data, foot)
        J = pin.getFrameJacobian(robot.model, data, foot, pin.LOCAL_WORLD_ALIGNED)
        sideways = J[1, 6 + 3 * number]
        signs.append(np.sign(sideways) * (1.0 if leg.endswith("L") else -1.0))
    return np.array(signs)


def straight_knees(robot: RobotModel) -> Array:
    """Return ``(4,)`` the angle of each knee at which its leg is straight [rad].

    There the foot is farthest from the axis of hip flexion: foot, knee and that axis lie in line.

    Args:
        robot: The robot.
    """
    model = robot.model
    axes = joint_axes(model).reshape(4, 3, 3)[:, 2]
    straight = []
    for axis, hip, foot in zip(axes, robot.hips, robot.feet, strict=True):
        placement = model.jointPlacements[hip + 1]
        upper = placement.rotation.T @ placement.translation
        lower = model.frames[foot].placement.translation
        upper = upper - (upper @ axis) * axis
        lower = lower - (lower @ axis) * axis
        straight.append(np.arctan2(axis @ np.cross(lower, upper), lower @ upper))
    # Of the angles that are whole turns apart, take the one nearest to the nominal pose.
    away = robot.nominal[7:].reshape(4, 3)[:, 2] - straight
    return np.array(straight) + 2.0 * np.pi * np.round(away / (2.0 * np.pi))
