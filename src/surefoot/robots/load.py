"""Loads a robot: from its name, its spec, or a JSON or TOML file with a spec.

Read `robots.model` for the result, `config.robot_table` for the robots of the package, and
`robots.canonical` for how a description becomes a model.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from surefoot.config.profiles import PROFILES, HardwareProfile
from surefoot.config.robot_table import ROBOTS
from surefoot.config.robots import RobotConfig, RobotSpec
from surefoot.errors import unknown
from surefoot.robots.canonical import BASE, PARTS, canonical_model, joint_axes
from surefoot.robots.data_file import SUFFIXES, read_data_file
from surefoot.robots.description import Description, find_urdf, read_description, urdf_places
from surefoot.robots.model import RobotModel, Shape, standing
from surefoot.robots.profile import check_standing, checked_profile, load_profile, torque_limits
from surefoot.types import LEGS, Array

MOST_BYTES = 1_000_000
"""[B] No file with a spec is larger."""
URDF_SUFFIXES = (".urdf", ".xacro")
"""The endings of descriptions, which are no specs."""
FREE_TRAVEL = 4 * np.pi
"""[rad] A joint that may turn this far counts as having no limits; URDFs cannot leave them out."""
NO_LIMIT = 1000.0
"""[N m, rad/s] URDFs write a torque or a speed limit of this or more, or 0, if there is none."""


def load_robot(robot: RobotConfig | RobotSpec | str | Path = "solo12") -> RobotModel:
    """Load a robot, shared by all that load the same one: nobody may change it.

    Args:
        robot: The name of a robot of the package, a file with a `RobotSpec`, a spec itself, or the
            configuration of a robot.

    Raises:
        ValueError: There is no such robot or file, or its description cannot be used; the message
            says what is wrong with it.
        ImportError: The package ``example-robot-data`` is missing.
    """
    config = robot if isinstance(robot, RobotConfig) else RobotConfig()
    spec = find_spec(robot)
    description = read_description(spec)
    profile = find_profile(config)
    return _model(description, spec, profile, config.torque_limit, config.enforce_speed_limit)


@lru_cache(maxsize=16)
def _model(
    description: Description,
    spec: RobotSpec,
    profile: HardwareProfile | None,
    same_torque: float | None,
    enforce_speed_limit: bool,
) -> RobotModel:
    """The model of a robot, made once, since a program asks for it often.

    Args:
        description: The robot's URDF.
        spec: What the URDF does not say.
        profile: What its electronics allow; None if nothing is known about them.
        same_torque: The torque limit of all joints; None is the robot's own [N m].
        enforce_speed_limit: Whether motors stop driving joints beyond their speed limits.
    """
    model = canonical_model(description, spec)
    _check_lower_legs(description, model, spec)
    torque_limit = _torque_limits(description, spec, same_torque)
    if profile is not None:
        torque_limit = np.minimum(torque_limit, torque_limits(profile))
    loaded = RobotModel(
        spec=spec,
        urdf=description.path,
        model=model,
        nominal=_nominal(model, spec),
        torque_limit=torque_limit,
        speed_limit=_speed_limits(description, spec),
        position_limit=_position_limits(description, spec),
        shapes=contact_shapes(model, spec),
        enforce_speed_limit=enforce_speed_limit,
        profile=profile,
    )
    _check_pose(loaded)
    if profile is not None:
        check_standing(profile, loaded.nominal[7:], spec.name)
    if spec.nominal_height is None:
        return replace(loaded, nominal=standing(loaded))
    return loaded


def find_spec(robot: RobotConfig | RobotSpec | str | Path) -> RobotSpec:
    """Return the spec of a robot.

    Args:
        robot: As for `load_robot`.

    Raises:
        ValueError: There is no such robot, or the file holds no spec.
    """
    if isinstance(robot, RobotSpec):
        return robot
    if isinstance(robot, RobotConfig):
        return robot.spec or find_spec(robot.model)
    name = str(robot)
    if name in ROBOTS:
        return ROBOTS[name]
    if name.lower().endswith(SUFFIXES):
        return read_spec(Path(name))
    if name.lower().endswith(URDF_SUFFIXES):
        raise ValueError(
            f"{name!r} is a description, which does not say all that a robot needs: write a spec "
            f"beside it, a {' or '.join(SUFFIXES)} file (docs/your-robot.md), and name that"
        )
    raise ValueError(
        f"{unknown('robot', name, ROBOTS)}; a robot of your own is a {' or '.join(SUFFIXES)} file"
    )


def find_profile(config: RobotConfig) -> HardwareProfile | None:
    """Return the hardware profile of a configured robot; None if it has none.

    Args:
        config: The configuration of the robot.

    Raises:
        ValueError: There is no such profile or file, it belongs to another robot, or it takes
            commands at another rate.
    """
    if config.profile_spec is not None:
        return checked_profile(config.profile_spec, find_spec(config).name)
    return None if config.profile is None else load_profile(config.profile, find_spec(config).name)


def with_profile(config: RobotConfig, which: str) -> RobotConfig:
    """Return the configuration of a robot with another hardware profile.

    A file is read now, and the configuration no longer depends on it.

    Args:
        config: The configuration of the robot.
        which: The name of a profile of the package, or a JSON or TOML file with one.

    Raises:
        ValueError: There is no such profile or file, it belongs to another robot, or it takes
            commands at another rate.
    """
    return holding_profile(config, load_profile(which, find_spec(config).name))


def holding_profile(config: RobotConfig, profile: HardwareProfile) -> RobotConfig:
    """Return the configuration of a robot with a profile, by name alone if the package has it.

    Args:
        config: The configuration of the robot.
        profile: The profile, of this robot.
    """
    is_packaged = PROFILES.get(profile.name) == profile
    return replace(config, profile=profile.name, profile_spec=None if is_packaged else profile)


def read_spec(path: Path) -> RobotSpec:
    """Read a spec from a JSON or TOML file, which is data: nothing in it is run.

    Args:
        path: The file. A relative `urdf` in it is looked for next to the file first.

    Raises:
        ValueError: The file is not there, not JSON or TOML, or holds no spec; the message names the
            file and the key that is wrong. Or it gives another robot the name of one of the
            package.
    """
    spec = read_data_file(path, RobotSpec, MOST_BYTES, "spec of a robot")
    beside = path.parent / Path(spec.urdf).expanduser()
    # A description that is nowhere is missed there, where most users look first.
    if beside.is_file() or not any(place.is_file() for place in urdf_places(spec)):
        spec = replace(spec, urdf=str(beside.resolve()))
    _check_name(path, spec)
    return spec


def _check_name(path: Path, spec: RobotSpec) -> None:
    """Check that no other robot has the name of one of the package.

    Policies and initial states name their robot, and would be taken for those of the package's.

    Args:
        path: The file of the spec, for the message.
        spec: The spec.

    Raises:
        ValueError: The package has another robot of this name.
    """
    packaged = ROBOTS.get(spec.name)
    if packaged is None or spec == packaged:
        return
    is_same = replace(spec, urdf=packaged.urdf) == packaged
    if is_same and find_urdf(spec).read_bytes() == find_urdf(packaged).read_bytes():
        return
    raise ValueError(
        f"{path} gives the name {spec.name!r} to another robot than the one of the package; their "
        f"policies could not be told apart, so use another name, such as {'my-' + spec.name!r}"
    )


def contact_shapes(model: pin.Model, spec: RobotSpec) -> tuple[Shape, ...]:
    """Return the geometry that meets the ground, the feet first, in the order of ``LEGS``.

    Mesh hulls are slow and differ between engines. A foot is a sphere around its frame, a leg two
    capsules, the base a box. An upper leg's capsule runs halfway between the planes in which its
    two joints turn. A lower leg's stops one foot diameter short of the foot, so the force on a foot
    is never taken for one on a shin.

    Args:
        model: The Pinocchio model, for the positions of knees and feet.
        spec: The sizes.
    """
    axes = joint_axes(model)
    radius = spec.foot_radius
    feet = []
    rest = [Shape(BASE, spec.body_center, spec.body_center, spec.body_half_edges)]
    for number, leg in enumerate(LEGS):
        foot = model.frames[model.getFrameId(f"{leg}_FOOT")].placement.translation
        knee = model.jointPlacements[model.getJointId(f"{leg}_KFE")].translation
        feet.append(Shape(f"{leg}_FOOT", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (radius,)))
        sideways = (axes[3 * number + 1] @ knee) * axes[3 * number + 1]
        upper = (sideways / 2, knee - sideways / 2)
        sideways = (axes[3 * number + 2] @ foot) * axes[3 * number + 2]
        back = (sideways - foot) / np.linalg.norm(sideways - foot)
        lower = (sideways, foot + 2 * radius * back)
        for part, ends, size in zip(PARTS[1:], (upper, lower), spec.leg_radii, strict=True):
            start, end = (tuple(float(x) for x in point + 0.0) for point in ends)  # no -0.0
            rest.append(Shape(f"{leg}_{part}", start, end, (size,)))
    return (*feet, *rest)


def _nominal(model: pin.Model, spec: RobotSpec) -> Array:
    """The nominal configuration ``(19,)``; right legs are the mirror images of left ones.

    Mirrored in the plane between left and right, a rotation about the axis a is the same rotation
    about (-ax, ay, -az), so a joint with the opposite axis turns the other way.
    """
    data = model.createData()
    J = pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = J[3:, 6:].T.reshape(4, 3, 3)
    legs = np.empty((4, 3))
    for left, angles in ((0, spec.front), (2, spec.hind)):
        mirrored = axes[left] * (-1.0, 1.0, -1.0)
        sign = np.sign((mirrored * axes[left + 1]).sum(axis=1))
        legs[left] = angles
        legs[left + 1] = sign * angles + 0.0  # no negative zero
    height = spec.nominal_height or 0.0
    return np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0, *legs.ravel()])


def _check_pose(robot: RobotModel) -> None:
    """Check that in the nominal pose the feet are below the body, each in its own corner."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.nominal)
    pin.updateFramePlacements(robot.model, data)
    feet = np.array([data.oMf[foot].translation for foot in robot.feet])
    hips = np.array([data.oMi[hip].translation for hip in robot.hips])
    spread = feet[:, :2] - feet[:, :2].mean(axis=0)
    corner = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    for leg, name, way, wanted in zip(LEGS, robot.spec.legs, spread, corner, strict=True):
        if not (way * wanted > 0.0).all():
            where = ("front" if way[0] > 0 else "hind") + (" left" if way[1] > 0 else " right")
            raise ValueError(
                f"{robot.name}: the foot of the leg {name!r} is at the {where}, but `legs` has it "
                f"in the place of {leg}; the order is front left, front right, hind left, hind "
                "right, with x forward and y to the left"
            )
    if not (hips[:, 2] - feet[:, 2] > 2 * robot.foot_radius).all():
        raise ValueError(
            f"{robot.name}: in the nominal pose its feet are {(hips - feet)[:, 2].tolist()} m "
            "below its hips; give `front` and `hind` the angles of a standing posture"
        )


def _check_lower_legs(description: Description, model: pin.Model, spec: RobotSpec) -> None:
    """Check that no foot is at its knee, as it is if the spec names the wrong link.

    Args:
        description: The description, for the links that a foot could be.
        model: The canonical model.
        spec: The names and sizes.

    Raises:
        ValueError: A lower leg is no longer than the diameter of its foot, so nothing is left of it
            that could touch the ground.
    """
    axes = joint_axes(model)
    source = description.model
    for number, (leg, name) in enumerate(zip(LEGS, spec.legs, strict=True)):
        foot = model.frames[model.getFrameId(f"{leg}_FOOT")].placement.translation
        axis = axes[3 * number + 2]
        length = float(np.linalg.norm(foot - (axis @ foot) * axis))
        if length > 2 * spec.foot_radius:
            continue
        frame = spec.source_feet[number]
        knee = source.getJointId(spec.source_joints[3 * number + 2])
        links = [
            link.name
            for link in source.frames
            if link.type == pin.FrameType.BODY and link.parentJoint in source.subtrees[knee]
        ]
        raise ValueError(
            f"{spec.name}, {description.path}: the foot {frame!r} of the leg {name!r} is "
            f"{length:.3f} m away from the axis of its knee, expected more than the foot's "
            f"diameter, {2 * spec.foot_radius:g} m; give `foot` the link or frame in the center of "
            f"the foot's sphere. The links below this knee are {', '.join(links)}"
        )


def _torque_limits(description: Description, spec: RobotSpec, same: float | None) -> Array:
    """The torque limits ``(12,)`` [N m]."""
    if same is not None:
        return np.full(12, same)
    if spec.torque_limit is not None:
        return np.tile(spec.torque_limit, 4)
    model = description.model
    effort = np.array([model.effortLimit[joint.idx_v] for joint in _joints(model, spec)])
    if not ((effort > 0.0) & (effort < NO_LIMIT)).all():
        raise ValueError(
            f"{spec.name}, {description.path}: not every joint has a torque limit (the efforts are "
            f"{effort.tolist()} N m); give `torque_limit` in the spec"
        )
    return effort


def _speed_limits(description: Description, spec: RobotSpec) -> Array:
    """The speed limits ``(12,)`` [rad/s]; infinite where there is none."""
    if spec.speed_limit is not None:
        return np.tile(spec.speed_limit, 4)
    model = description.model
    speed = np.array([model.velocityLimit[joint.idx_v] for joint in _joints(model, spec)])
    return np.where((speed > 0.0) & (speed < NO_LIMIT), speed, np.inf)


def _position_limits(description: Description, spec: RobotSpec) -> Array:
    """The smallest and largest angle of each joint ``(12, 2)`` [rad]; infinite if there is none."""
    model = description.model
    joints = _joints(model, spec)
    rows = [joint.idx_q for joint in joints]
    limits = np.column_stack([model.lowerPositionLimit[rows], model.upperPositionLimit[rows]])
    limits[limits[:, 1] - limits[:, 0] >= FREE_TRAVEL] = (-np.inf, np.inf)
    advice = "give `position_limit` in the spec"
    if spec.position_limit:
        limits = np.array(spec.position_limit)
        advice = "correct `position_limit` in the spec"
    for joint, (low, high) in zip(joints, limits, strict=True):
        if not low < high:
            raise ValueError(
                f"{spec.name}, {description.path}: the joint {model.names[joint.id]!r} may not "
                f"move: its limits are {low:g} and {high:g} rad; {advice}"
            )
    return limits


def _joints(model: pin.Model, spec: RobotSpec) -> list[pin.JointModel]:
    """The twelve joints among those of the description, in canonical order."""
    return [model.joints[model.getJointId(name)] for name in spec.source_joints]
