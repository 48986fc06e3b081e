"""Solo12 (Grimminger et al., 2020), as the package ``example-robot-data`` describes it.

Its shapes replace the meshes of the description, whose extents they follow. Read `robots.geometry`
next for where they meet the ground.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
import pinocchio as pin

from surefoot.config import RobotConfig
from surefoot.robots.model import RobotModel, Shape
from surefoot.types import LEGS

# Extents of Solo12's meshes: base 448 x 219 x 53 mm, upper leg 37 to 44 mm thick, lower leg 27 mm.
BASE_CENTER = (0.0, 0.0, 0.0015)
BASE_HALF_EDGES = (0.2241, 0.1095, 0.0265)
UPPER_LEG_RADIUS = 0.0185
LOWER_LEG_RADIUS = 0.0135
FOOT_RADIUS = 0.018
"""[m] The height of the foot frame above the ground in contact."""


def solo12(config: RobotConfig | None = None) -> RobotModel:
    """Load Solo12 as ``example-robot-data`` describes it: 2.500 kg, point feet, 12 joints.

    Joint damping and armature are zero in the planner and the simulators alike. The foot radius is
    the height of the foot frame above the ground in contact, 18 mm.

    Args:
        config: The robot's limits; the defaults if it is None.

    Raises:
        ImportError: The package ``example-robot-data`` is missing.
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
    front = (0.0, 0.8, -1.6)
    hind = (0.0, -0.8, 1.6)
    # At 0.25 m the foot spheres hang 9 mm above the ground; the nominal pose stands on them.
    nominal = np.array([0, 0, 0.25, 0, 0, 0, 1, *front, *front, *hind, *hind])
    return RobotModel(
        "solo12",
        urdf,
        share,
        model,
        nominal,
        FOOT_RADIUS,
        config.torque_limit,
        contact_shapes(model),
    )


def contact_shapes(model: pin.Model) -> tuple[Shape, ...]:
    """Return the geometry that meets the ground, the feet first, in the order of ``LEGS``.

    Mesh hulls are slow and differ between engines. A foot is a sphere around its frame, a leg two
    capsules, the base (whose outline includes the hips) a box. The lower leg's capsule stops one
    foot diameter short of the foot, so that a foot's force is never a shin's.

    Args:
        model: The Pinocchio model, for the positions of knees and feet.
    """
    feet = []
    rest = [Shape("base_link", BASE_CENTER, BASE_CENTER, BASE_HALF_EDGES)]
    for leg in LEGS:
        foot = model.frames[model.getFrameId(f"{leg}_FOOT")].placement.translation
        knee = model.jointPlacements[model.getJointId(f"{leg}_KFE")].translation
        feet.append(Shape(f"{leg}_FOOT", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (FOOT_RADIUS,)))
        # Both links run along z; the upper one is centered between its two joints.
        x, y, z = (float(value) for value in knee)
        upper = ((x, y / 2, 0.0), (x, y / 2, z))
        x, y, z = (float(value) for value in foot)
        lower = ((x, y, 0.0), (x, y, z + 2 * FOOT_RADIUS))
        rest.append(Shape(f"{leg}_UPPER_LEG", *upper, (UPPER_LEG_RADIUS,)))
        rest.append(Shape(f"{leg}_LOWER_LEG", *lower, (LOWER_LEG_RADIUS,)))
    return (*feet, *rest)
