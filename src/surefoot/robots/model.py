"""What the package needs to know of a robot: model, names, limits, shapes and nominal pose.

One description of the robot, its URDF, feeds the planner and every simulator, so mass and geometry
cannot disagree between them. Each robot has a file of its own beside this one: read one of them
next.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from surefoot.types import JOINTS, LEGS, Array


class Shape(NamedTuple):
    """A box, or a capsule that is a sphere where both its ends coincide; in its link's frame.

    Attributes:
        link: The URDF link that carries the shape.
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
        name: The robot's name, which is written into policies and initial states.
        urdf: The path of the robot's description.
        package_root: The folder that the URDF's ``package://`` paths start from.
        model: The Pinocchio model with a free-flyer base; nq is 19, nv is 18.
        nominal: ``(19,)`` nominal configuration [m, unit quaternion, rad].
        foot_radius: The radius of the contact sphere around each foot frame [m].
        torque_limit: The torque limit at the joint, the same for all joints [N m].
        shapes: What can touch the ground, the same in every simulator; the feet come first, in the
            order of ``LEGS``.
        feet: ``(4,)`` ids of the foot frames, in the order of ``LEGS``.
        hips: ``(4,)`` ids of the HFE joints, in the order of ``LEGS``.

    Raises:
        ValueError: The model's joints are not ``JOINTS``, in their order.
    """

    name: str
    urdf: Path
    package_root: Path
    model: pin.Model
    nominal: Array
    foot_radius: float
    torque_limit: float
    shapes: tuple[Shape, ...]
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


def clip_torque(torque: Array, limit: float) -> Array:
    """Clip joint torques ``(..., 12)`` [N m] to the motor limit, the same for every controller.

    A torque that is not a number becomes zero, so that a broken controller goes limp.

    Args:
        torque: ``(..., 12)`` joint torques [N m].
        limit: The torque limit, the same for all joints [N m].
    """
    clipped = np.minimum(np.maximum(torque, -limit), limit)
    return np.where(np.isnan(clipped), 0.0, clipped)
