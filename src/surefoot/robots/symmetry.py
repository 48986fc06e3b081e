"""The mirrors of a robot: which joint becomes which, and which way it then turns.

In the mirror D, a joint that turns by an angle about an axis a looks like one that turns by the
same angle about -D a. The joint that takes its place turns about that axis or about its opposite,
which gives the sign, so a robot's description determines everything. `learning.symmetry` mirrors
frames with these arrays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surefoot.config.learning import MirrorName
from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import center_of_mass, feet, legs_of, masses_of
from surefoot.types import JOINTS, Array, IntArray

REFLECTIONS: dict[MirrorName, tuple[int, int, int]] = {
    "left_right": (1, -1, 1),
    "front_hind": (-1, 1, 1),
}
"""Signs of the coordinates of a point in each mirror."""
EXCHANGED: dict[MirrorName, tuple[int, int, int, int]] = {
    "left_right": (1, 0, 3, 2),
    "front_hind": (2, 3, 0, 1),
}
"""For each leg of the image, in the order of ``LEGS``, the leg that it shows."""
TOLERANCE = 1e-3
"""[m] Feet and center of mass of a mirror image may differ by this much from the robot's own."""
_POSES = 20
"""The number of poses in which feet and center of mass are compared."""


class BodyMirror(NamedTuple):
    """The arrays of a mirror, without the gait.

    Attributes:
        reflection: ``(3,)`` signs of the coordinates of a point.
        legs: ``(4,)`` for each leg of the image, the leg of the robot that it shows.
        joints: ``(12,)`` the same for the joints.
        signs: ``(12,)`` sign of each joint of the image.
    """

    reflection: tuple[int, ...]
    legs: tuple[int, ...]
    joints: tuple[int, ...]
    signs: tuple[int, ...]


def body_mirror(robot: RobotModel, name: MirrorName) -> BodyMirror:
    """Return a mirror of a robot.

    Args:
        robot: The robot.
        name: Which sides change places.

    Raises:
        ValueError: The robot's axes, feet, center of mass or nominal pose are not their own mirror
            image.
    """
    reflection = np.array(REFLECTIONS[name], float)
    legs = np.array(EXCHANGED[name])
    joints = (3 * legs[:, None] + np.arange(3)).ravel()
    axis = legs_of(robot).axis.reshape(len(JOINTS), 3)
    agreement = (axis * -(axis[joints] * reflection)).sum(1)
    signs = np.sign(agreement)
    if np.abs(agreement).min() < 1.0 - 1e-6:
        joint = JOINTS[int(np.argmin(np.abs(agreement)))]
        raise ValueError(_refusal(robot, name, f"the axis of {joint} is not that of its image"))
    nominal = robot.nominal[7:]
    if not np.allclose(nominal[joints] * signs, nominal, atol=1e-6):
        raise ValueError(_refusal(robot, name, "its nominal pose bends the legs differently"))
    worst = _largest_difference(robot, reflection, legs, joints, signs)
    if worst > TOLERANCE:
        text = f"feet or center of mass differ by {1000 * worst:.1f} mm"
        raise ValueError(_refusal(robot, name, text))
    return BodyMirror(
        REFLECTIONS[name],
        EXCHANGED[name],
        tuple(joints.tolist()),
        tuple(signs.astype(int).tolist()),
    )


def _largest_difference(
    robot: RobotModel, reflection: Array, legs: IntArray, joints: IntArray, signs: Array
) -> float:
    """The largest difference of the image's feet or center of mass from the mirrored ones [m]."""
    rng = np.random.default_rng(0)
    q = np.tile(robot.nominal, (_POSES, 1))
    q[:, :3] = 0.0
    q[:, 7:] += rng.uniform(-0.5, 0.5, (_POSES, len(JOINTS)))
    image = q.copy()
    image[:, 7:] = q[:, 7:][:, joints] * signs
    chains = legs_of(robot)
    masses = masses_of(robot)
    position = feet(q, chains)[0][:, legs] * reflection
    com = center_of_mass(q, chains, masses) * reflection
    apart = np.abs(feet(image, chains)[0] - position).max()
    return max(float(apart), float(np.abs(center_of_mass(image, chains, masses) - com).max()))


def _refusal(robot: RobotModel, name: MirrorName, reason: str) -> str:
    """Why a robot has no such mirror, and what to do."""
    return f"{robot.name} is not its own mirror image ({name}): {reason}. Use training.mirror none"
