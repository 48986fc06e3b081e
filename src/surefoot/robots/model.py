"""The robot: Pinocchio model, names, limits and nominal pose. Solo12 comes with the package.

The one description (URDF of ``example-robot-data``) feeds the planner and every simulator, so mass
and geometry cannot disagree between them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pinocchio as pin

from surefoot.config import RobotConfig
from surefoot.types import JOINTS, LEGS, Array


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


def solo12(config: RobotConfig | None = None) -> RobotModel:
    """Solo12 as described by ``example-robot-data``: 2.500 kg, point feet, 12 joints.

    Joint damping and armature are zero in planner and simulators alike. The foot radius is the
    height of the foot frame above the ground in contact, 18 mm.

    Raises:
        ImportError: ``example-robot-data`` is missing.
    """
    config = config or RobotConfig()
    try:
        data = distribution("example-robot-data")
    except PackageNotFoundError as error:
        raise ImportError(
            "Solo12's description is missing: pip install example-robot-data"
        ) from error
    share = Path(str(data.locate_file("cmeel.prefix/share")))
    urdf = share / "example-robot-data/robots/solo_description/robots/solo12.urdf"
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    model.damping[:] = 0.0
    model.armature[:] = 0.0
    front, hind = (0.0, 0.8, -1.6), (0.0, -0.8, 1.6)
    # At 0.25 m the foot spheres hang 9 mm above the ground; the nominal pose stands on them.
    nominal = np.array([0, 0, 0.25, 0, 0, 0, 1, *front, *front, *hind, *hind])
    robot = RobotModel("solo12", urdf, share, model, nominal, 0.018, config.torque_limit)
    return robot


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
