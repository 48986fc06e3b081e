"""Examines a robot's description: what the package makes of it, and what is missing or odd.

If no model can be made of a description, `load_robot` raises an error. The rest is worth knowing: a
limit that is missing, a mesh that cannot be read, a pose outside the limits. Read `cli.robot` next,
which prints it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from surefoot.config.robots import RobotConfig
from surefoot.robots.canonical import PARTS
from surefoot.robots.description import Description, located, number, read_description, read_urdf
from surefoot.robots.geometry import lowest_points
from surefoot.robots.joint_bounds import straight_knees
from surefoot.robots.load import load_robot
from surefoot.robots.meshes import missing_meshes
from surefoot.robots.model import RobotModel, standing
from surefoot.robots.rigid import feet as foot_positions
from surefoot.robots.rigid import legs_of
from surefoot.robots.scaling import OwnValues, Size, own_values, size_of
from surefoot.types import GRAVITY, JOINTS, LEGS

UNEVEN = 0.005
"""[m] Feet of a standing robot that differ by more than this in height or sideways are odd."""
STRAIGHT = 0.3
"""[rad] Knees that are bent by less leave a leg no length to push with."""
LOADED = 0.6
"""Standing should need no more than this share of the torque limits."""


@dataclass(frozen=True)
class JointRow:
    """A joint, as the package has it.

    Attributes:
        name: Its canonical name.
        source: Its name in the description.
        nominal: Its angle in the nominal pose [rad].
        low: Its smallest angle [rad]; None if it has no limit.
        high: Its largest angle [rad]; None if it has no limit.
        torque_limit: The torque limit [N m].
        speed_limit: The speed limit [rad/s]; None if it has none.
        link_mass: Mass that hangs on it directly [kg].
    """

    name: str
    source: str
    nominal: float
    low: float | None
    high: float | None
    torque_limit: float
    speed_limit: float | None
    link_mass: float


@dataclass(frozen=True)
class RobotReport:
    """What the package makes of a robot's description.

    Attributes:
        name: The robot's name.
        urdf: The description.
        mass: The total mass [kg].
        size: Its ratios to Solo12, and its heights in the nominal pose.
        own: Its own values: gains, heights, weights.
        joints: All twelve joints, in canonical order.
        feet: Centers of the feet in the nominal pose: x, y from the base, z above the ground [m].
        remarks: What is missing or odd, in sentences.
    """

    name: str
    urdf: Path
    mass: float
    size: Size
    own: OwnValues
    joints: tuple[JointRow, ...]
    feet: tuple[tuple[float, float, float], ...]
    remarks: tuple[str, ...]


def examine_robot(config: RobotConfig) -> RobotReport:
    """Load a robot, and report what the package makes of it.

    Args:
        config: Which robot.

    Raises:
        ValueError: There is no such robot, or its description cannot be used.
    """
    robot = load_robot(config)
    description = read_description(robot.spec)
    q = standing(robot)
    position = foot_positions(q[None], legs_of(robot))[0][0]
    return RobotReport(
        name=robot.name,
        urdf=robot.urdf,
        mass=robot.mass,
        size=size_of(robot),
        own=own_values(robot),
        joints=tuple(_rows(robot)),
        feet=tuple((float(x), float(y), float(z)) for x, y, z in position - [*q[:2], 0.0]),
        remarks=tuple(remarks(robot, description)),
    )


def _rows(robot: RobotModel) -> Iterator[JointRow]:
    """The table of the joints."""
    for row, (name, source) in enumerate(zip(JOINTS, robot.spec.source_joints, strict=True)):
        low, high = robot.position_limit[row]
        speed = robot.speed_limit[row]
        yield JointRow(
            name=name,
            source=source,
            nominal=float(robot.nominal[7 + row]),
            low=float(low) if np.isfinite(low) else None,
            high=float(high) if np.isfinite(high) else None,
            torque_limit=float(robot.torque_limit[row]),
            speed_limit=float(speed) if np.isfinite(speed) else None,
            link_mass=robot.model.inertias[2 + row].mass,
        )


def remarks(robot: RobotModel, description: Description) -> Iterator[str]:
    """Say what is missing or odd, one sentence for each thing.

    Args:
        robot: The robot.
        description: What its model was made from.
    """
    yield from _of_the_tree(robot, description)
    yield from _of_limits(robot)
    yield from _of_feet(robot, description)
    yield from _of_the_pose(robot)
    yield from _of_meshes(robot)


def _of_the_tree(robot: RobotModel, description: Description) -> Iterator[str]:
    """Remarks on links and joints."""
    source = description.model
    root = next(frame.name for frame in source.frames if frame.type == pin.FrameType.BODY)
    own = description.inertias.get(root)
    if own is None or own.mass == 0.0:
        yield f"The root link {root!r} has no mass; the links that are fixed to it have."
    used = robot.spec.source_joints
    locked = [name for name in source.names[2:] if name not in used]
    if locked:
        yield f"Joints that are locked: {', '.join(locked)}."
    velocities = range(6, source.nv)
    ignored = [
        name
        for name, values in (("damping", source.damping), ("armature", source.armature))
        if any(values[index] for index in velocities)
    ]
    if ignored:
        yield (
            f"The description's {' and '.join(ignored)} of joints is not used; the spec's "
            f"`damping` is {robot.spec.damping} N m s/rad, its `armature` "
            f"{robot.spec.armature} kg m^2."
        )
    elif not any(robot.spec.armature):
        yield "Its joints have no `armature`: the inertia of the rotors is not simulated."


def _of_limits(robot: RobotModel) -> Iterator[str]:
    """Remarks on limits, and on a nominal pose outside them."""
    if np.isinf(robot.speed_limit).all():
        yield "No joint has a speed limit; `speed_limit` in the spec gives one."
    if np.isinf(robot.position_limit).all():
        yield "No joint has position limits; `position_limit` in the spec gives them."
    outside = (robot.nominal[7:] < robot.position_limit[:, 0]) | (
        robot.nominal[7:] > robot.position_limit[:, 1]
    )
    if outside.any():
        names = ", ".join(np.array(JOINTS)[outside])
        yield f"The nominal angles of {names} are outside the joints' limits."


def _of_feet(robot: RobotModel, description: Description) -> Iterator[str]:
    """Remarks on the feet: what the description has there in place of the package's spheres."""
    root = read_urdf(description.path)
    names = robot.spec.source_feet
    if robot.model.frames[robot.feet[0]].inertia.mass == 0.0:
        yield f"The feet have no inertia of their own; they are a part of the {PARTS[-1]} links."
    link = next((link for link in root.iter("link") if link.get("name") == names[0]), None)
    if link is None:
        yield f"The foot {names[0]!r} is a frame, not a link."
        return
    shape = link.find("collision/geometry")
    sphere = link.find("collision/geometry/sphere")
    radius = robot.foot_radius
    if sphere is not None:
        with located(description.path, link):
            given = number(sphere, "radius")
        if abs(given - radius) > 0.1 * radius:
            yield f"Its feet are spheres of {given} m in the description, of {radius} m here."
    elif shape is None or not len(shape):
        yield f"The description's feet have nothing to collide with; here, spheres of {radius} m."
    else:
        yield f"The description's feet are a {shape[0].tag}; here they are spheres of {radius} m."


def _of_the_pose(robot: RobotModel) -> Iterator[str]:
    """Remarks on how the robot stands."""
    q = standing(robot)
    data = robot.model.createData()
    position, J = foot_positions(q[None], legs_of(robot))
    height = position[0, :, 2]
    if np.ptp(height) > UNEVEN:
        yield f"In the nominal pose its feet are {np.ptp(height):.3f} m apart in height."
    mirrored = position[0, [0, 2]] - position[0, [1, 3]] * [1.0, -1.0, 1.0]
    if np.abs(mirrored).max() > UNEVEN:
        yield f"Left and right feet are {np.abs(mirrored).max():.3f} m from being mirror images."
    bent = np.abs(robot.nominal[7:].reshape(4, 3)[:, 2] - straight_knees(robot))
    if bent.min() < STRAIGHT:
        leg = robot.spec.legs[int(bent.argmin())]
        yield (
            f"In the nominal pose the leg {leg!r} is almost straight: its knee is bent by "
            f"{bent.min():.2f} rad. A straight leg cannot reach any lower; bend it in `front` or "
            "`hind`."
        )
    _, rest = lowest_points(robot, data, q)
    if rest.min() <= 0.0:
        link = robot.shapes[len(LEGS) + int(rest.argmin())].link
        yield f"In the nominal pose the shape of {link} is {-rest.min():.3f} m in the ground."
    # Each foot carries a quarter of the weight.
    load = robot.mass * GRAVITY / 4
    torque = pin.computeGeneralizedGravity(robot.model, data, q)[6:].reshape(4, 3)
    torque = torque - load * J[0, :, 2, 6:]
    share = np.abs(torque.ravel()) / robot.torque_limit
    if share.max() > LOADED:
        joint = JOINTS[int(share.argmax())]
        yield f"Standing takes {share.max():.0%} of the torque limit of {joint}; steps take more."


def _of_meshes(robot: RobotModel) -> Iterator[str]:
    """Remarks on what pictures will show."""
    count, missing = missing_meshes(robot.urdf)
    if count == 0:
        yield "It has no meshes; pictures show the shapes that meet the ground."
    elif missing:
        yield (
            f"{len(missing)} of its {count} meshes are not there, such as {missing[0]}; pictures "
            "show the shapes that meet the ground."
        )
