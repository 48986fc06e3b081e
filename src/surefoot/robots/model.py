"""What the package needs to know of a robot: model, names, limits, shapes and nominal pose.

One model of the robot, made from its URDF, feeds the planner and every simulator, so mass and
geometry cannot disagree between them. Read `robots.load` next, which makes it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from surefoot.config.profiles import HardwareProfile
from surefoot.config.robots import RobotSpec
from surefoot.types import JOINTS, LEGS, Array


class Shape(NamedTuple):
    """A box, or a capsule that is a sphere where both its ends coincide; in its link's frame.

    Attributes:
        link: The link that carries the shape, by its canonical name, such as ``FL_FOOT``.
        start: ``(3,)`` one end of the capsule's axis, or the center of the box [m].
        end: ``(3,)`` the other end of the axis, or again the center of the box [m].
        size: The radius of the capsule, or the three half edges of the box [m].
    """

    link: str
    start: tuple[float, ...]
    end: tuple[float, ...]
    size: tuple[float, ...]


@dataclass(frozen=True)
class RobotModel:
    """A quadruped: what the planner, the simulators and the observation need to know of it.

    Attributes:
        spec: What the model was made from, as data.
        urdf: The path of the robot's description.
        model: The Pinocchio model with a free-flyer base, from `canonical_model`; nq is 19, nv 18.
        nominal: ``(19,)`` nominal configuration [m, unit quaternion, rad].
        torque_limit: ``(12,)`` torque limits at the joints [N m], within those of the profile.
        speed_limit: ``(12,)`` speed limits of the joints [rad/s]; infinite where there is none.
        position_limit: ``(12, 2)`` smallest and largest angles of the joints [rad]; infinite where
            there is none.
        shapes: What can touch the ground, the same in every simulator; the feet come first, in the
            order of ``LEGS``.
        enforce_speed_limit: Whether motors stop driving joints beyond their speed limits.
        profile: What the electronics of a real robot allow; None if nothing is known about them.
        feet: ``(4,)`` ids of the foot frames, in the order of ``LEGS``.
        hips: ``(4,)`` ids of the HFE joints, in the order of ``LEGS``.

    Raises:
        ValueError: The model's joints are not ``JOINTS``, in their order.
    """

    spec: RobotSpec
    urdf: Path
    model: pin.Model
    nominal: Array
    torque_limit: Array
    speed_limit: Array
    position_limit: Array
    shapes: tuple[Shape, ...]
    enforce_speed_limit: bool = False
    profile: HardwareProfile | None = None
    feet: tuple[int, ...] = field(init=False)
    hips: tuple[int, ...] = field(init=False)

    def __post_init__(self) -> None:
        """Look up the frames and check that the joints are the ones the conventions name."""
        joints = tuple(self.model.names[2:])
        if joints != JOINTS:
            raise ValueError(f"{self.name}: joints are {joints}, expected {JOINTS}")
        feet = tuple(self.model.getFrameId(f"{leg}_FOOT") for leg in LEGS)
        hips = tuple(self.model.getJointId(f"{leg}_HFE") for leg in LEGS)
        object.__setattr__(self, "feet", feet)
        object.__setattr__(self, "hips", hips)

    @property
    def name(self) -> str:
        """The robot's name, which is written into policies and initial states."""
        return self.spec.name

    @property
    def foot_radius(self) -> float:
        """The radius of the contact sphere around each foot frame [m]."""
        return self.spec.foot_radius

    @property
    def mass(self) -> float:
        """The total mass [kg]."""
        return float(pin.computeTotalMass(self.model))


def standing(robot: RobotModel) -> Array:
    """Return the nominal configuration ``(19,)``, lowered until the feet touch the ground."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.nominal)
    lowest = min(data.oMf[foot].translation[2] for foot in robot.feet)
    q = robot.nominal.copy()
    q[2] -= lowest - robot.foot_radius
    return q


def clip_torque(torque: Array, limit: Array | float) -> Array:
    """Clip joint torques ``(..., 12)`` [N m] to the motor limits, the same for every controller.

    A torque that is not a number becomes zero, so that a broken controller goes limp.

    Args:
        torque: ``(..., 12)`` joint torques [N m].
        limit: The torque limits ``(12,)``, or one for all joints [N m].
    """
    clipped = np.minimum(np.maximum(torque, -limit), limit)
    return np.where(np.isnan(clipped), 0.0, clipped)


def stop_speeding(torque: Array, rate: Array, limit: Array) -> Array:
    """Take away torques that would turn joints faster than their speed limits.

    Args:
        torque: ``(..., 12)`` joint torques [N m].
        rate: ``(..., 12)`` joint rates [rad/s].
        limit: The speed limits ``(12,)`` [rad/s]; infinite where there is none.

    Returns:
        The torques, zero where a joint is at its limit or beyond and the torque would speed it up.
    """
    return np.where((np.abs(rate) >= limit) & (torque * rate > 0.0), 0.0, torque)
