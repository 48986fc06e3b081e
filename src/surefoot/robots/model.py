"""The robot: Pinocchio model, names, limits, shapes and nominal pose. Next: `solo12`.

The one description (URDF of ``example-robot-data``) feeds the planner and every simulator, so mass
and geometry cannot disagree between them.
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
        link: URDF link that carries the shape.
        start: ``(3,)`` one end of the capsule's axis, or the centre of the box [m].
        end: ``(3,)`` the other end [m].
        size: radius of the capsule, or half edges of the box [m].
    """

    link: str
    start: tuple[float, ...]
    end: tuple[float, ...]
    size: tuple[float, ...]


@dataclass(frozen=True)
class RobotModel:
    """A quadruped: what planner, simulator and observation need to know of it.

    Attributes:
        name: the robot's name, written into policies and starts.
        urdf: path of its description.
        package_root: folder that the URDF's ``package://`` paths start from.
        model: Pinocchio model with a free-flyer base; nq 19, nv 18.
        nominal: ``(19,)`` nominal configuration [m, unit quaternion, rad].
        foot_radius: [m] of the contact sphere around each foot frame.
        torque_limit: [Nm] at the joint, the same for all joints.
        shapes: what can touch the ground, the same in every simulator; the feet first, in the order
            of ``LEGS``.
        feet: ``(4,)`` ids of the foot frames, in the order of ``LEGS``.
        hips: ``(4,)`` ids of the HFE joints, in the order of ``LEGS``.
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
        object.__setattr__(
            self, "feet", tuple(self.model.getFrameId(f"{leg}_FOOT") for leg in LEGS)
        )
        object.__setattr__(self, "hips", tuple(self.model.getJointId(f"{leg}_HFE") for leg in LEGS))

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(pin.computeTotalMass(self.model))


def standing(robot: RobotModel) -> Array:
    """``(19,)`` the nominal configuration, lowered until the foot spheres touch the ground."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.nominal)
    lowest = min(data.oMf[foot].translation[2] for foot in robot.feet)
    q = robot.nominal.copy()
    q[2] -= lowest - robot.foot_radius
    return q


def clip_torque(torque: Array, limit: float) -> Array:
    """Clip joint torques ``(..., 12)`` [Nm] to the motor limit, the same for every controller.

    A torque that is not a number becomes zero, so that a broken controller goes limp.
    """
    clipped = np.minimum(np.maximum(torque, -limit), limit)
    return np.where(np.isnan(clipped), 0.0, clipped)
