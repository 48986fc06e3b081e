"""The package's own Pinocchio model of a robot: canonical names and order, no locked joints.

A description has its own names, order and structure. Every joint that is not one of the twelve is
locked, and a new model is built from what is left: legs FL, FR, HL, HR, each with links SHOULDER,
UPPER_LEG, LOWER_LEG and FOOT, joints HAA, HFE, KFE. A foot is a frame of its lower leg, with the
inertia of the description's foot link. If that inertia, or what it leaves of the lower leg, is not
one that a body can have, at any foot, the inertias of all feet become part of the lower legs'.
Everything else in the package, the simulators included, is made from this model. Read `robots.load`
next.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from surefoot.config.robots import RobotSpec
from surefoot.errors import unknown
from surefoot.robots.description import RENAME, Description, frame_id
from surefoot.types import LEGS, Array

BASE = "base_link"
"""The name of the base's link."""
PARTS = ("SHOULDER", "UPPER_LEG", "LOWER_LEG")
"""The names of a leg's links that joints turn, in the order of its joints."""
KINDS = ("HAA", "HFE", "KFE")
"""The names of a leg's joints: hip abduction, hip flexion, knee."""
LEAST_MASS = 1e-9
"""[kg] A link that weighs less counts as having no mass."""


def canonical_model(description: Description, spec: RobotSpec) -> pin.Model:
    """Rebuild a description's model with canonical names and order.

    Args:
        description: The description that was read.
        spec: The names of its joints and feet; armature and damping of its joints.

    Raises:
        ValueError: A joint or a foot is missing, has the wrong place in the tree or the wrong type,
            or a link has no mass or an impossible inertia.
    """
    names = spec.source_joints
    _check_joints(description, spec)
    source = _locked(description.model, names)
    feet = [frame_id(description, foot, spec.name) for foot in spec.source_feet]
    foot_frames = [description.model.frames[foot] for foot in feet]
    feet = [source.getFrameId(frame.name, frame.type) for frame in foot_frames]
    where = f"{spec.name}, {description.path}"
    _check_chains(source, feet, spec, where)
    apart = all(
        _is_body(description.inertias.get(source.frames[foot].name))
        and _is_body(_own_inertia(description, source, source.frames[foot].parentJoint, foot))
        for foot in feet
    )
    model = pin.Model()
    model.name = spec.name
    placement = pin.SE3.Identity()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), placement, "root_joint")
    model.addJointFrame(root)
    _add_body(model, BASE, root, _own_inertia(description, source, 1, None))
    model.inertias[root] = source.inertias[1]
    for number, leg in enumerate(LEGS):
        parent = root
        for kind, part, name in zip(KINDS, PARTS, names[3 * number : 3 * number + 3], strict=True):
            old = source.getJointId(name)
            joint = model.addJoint(
                parent, source.joints[old], source.jointPlacements[old], f"{leg}_{kind}"
            )
            model.addJointFrame(joint)
            foot = feet[number] if apart and part == PARTS[-1] else None
            own = _own_inertia(description, source, old, foot)
            _add_body(model, f"{leg}_{part}", joint, own)
            model.inertias[joint] = source.inertias[old]
            parent = joint
        frame = source.frames[feet[number]]
        own = description.inertias[frame.name] if apart else pin.Inertia.Zero()
        foot_frame = pin.Frame(f"{leg}_FOOT", parent, frame.placement, pin.FrameType.BODY, own)
        model.addFrame(foot_frame, False)
    # Armature acts in Pinocchio's inverse dynamics; damping in the simulators only.
    model.armature[6:] = np.tile(spec.armature, 4)
    model.damping[6:] = np.tile(spec.damping, 4)
    _check_inertias(model, where)
    return model


def joint_axes(model: pin.Model) -> Array:
    """Return the axis of each joint ``(12, 3)`` in its own frame."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    rows = [
        pin.getJointJacobian(model, data, joint, pin.LOCAL)[3:, 4 + joint]
        for joint in range(2, model.njoints)
    ]
    return np.array(rows)


def _check_joints(description: Description, spec: RobotSpec) -> None:
    """Check that all twelve joints exist, and that each turns about one axis."""
    model = description.model
    movable = list(model.names[2:])
    for name in spec.source_joints:
        if name not in movable:
            few = f"It has {len(movable)} joints; 12 are needed."
            advice = few if len(movable) < 12 else RENAME
            message = unknown("joint that moves", name, movable)
            raise ValueError(f"{spec.name}, {description.path}: {message}. {advice}")
        joint = model.joints[model.getJointId(name)]
        if joint.nv != 1 or not joint.shortname().startswith("JointModelR"):
            raise ValueError(
                f"{spec.name}, {description.path}: the joint {name!r} does not turn about one axis "
                f"({joint.shortname()})"
            )


def _locked(model: pin.Model, names: tuple[str, ...]) -> pin.Model:
    """The model with all joints but these locked, at zero or the nearest angle in their limits."""
    others = _others(model, names)
    return pin.buildReducedModel(model, others, locked_pose(model, names)) if others else model


def locked_pose(model: pin.Model, names: tuple[str, ...]) -> Array:
    """The configuration in which joints are locked: at zero or the nearest angle in their limits.

    Args:
        model: The model with all joints of a description.
        names: The joints that are not locked; they are at zero here.
    """
    q = pin.neutral(model)
    for joint in _others(model, names):
        if model.joints[joint].nq == 1:
            index = model.joints[joint].idx_q
            low = model.lowerPositionLimit[index]
            high = model.upperPositionLimit[index]
            if low <= high:
                q[index] = min(max(0.0, low), high)
    return q


def _others(model: pin.Model, names: tuple[str, ...]) -> list[int]:
    """The joints of a model with other names than these."""
    return [joint for joint in range(2, model.njoints) if model.names[joint] not in names]


def _check_chains(source: pin.Model, feet: list[int], spec: RobotSpec, where: str) -> None:
    """Check that each leg is a chain from the base: abduction, flexion, knee, foot."""
    for number, leg in enumerate(spec.legs):
        names = spec.source_joints[3 * number : 3 * number + 3]
        chain = [source.getJointId(name) for name in names]
        parents = [source.parents[joint] for joint in chain]
        if parents != [1, *chain[:2]]:
            hangs = [source.names[parent] for parent in parents]
            raise ValueError(
                f"{where}: the joints {[*names]} of the leg {leg!r} "
                f"hang on {hangs}; expected one below the other, the first on the base"
            )
        foot = source.frames[feet[number]]
        if foot.parentJoint != chain[2]:
            raise ValueError(
                f"{where}: the foot {foot.name!r} hangs on the joint "
                f"{source.names[foot.parentJoint]!r}, expected {source.names[chain[2]]!r}"
            )


def _own_inertia(
    description: Description, source: pin.Model, joint: int, foot: int | None
) -> pin.Inertia:
    """The inertia of the links that hang on a joint directly, without the foot, in its frame.

    If that is a single link at the joint, its inertia is the description's, to the last bit.
    """
    total = pin.Inertia.Zero()
    count = 0
    for index, frame in enumerate(source.frames):
        if frame.type != pin.FrameType.BODY or frame.parentJoint != joint or index == foot:
            continue
        inertia = description.inertias.get(frame.name)
        if inertia is None:
            continue
        at_joint = frame.placement == pin.SE3.Identity()
        inertia = inertia if at_joint else frame.placement.act(inertia)
        total = total + inertia if count else inertia
        count += 1
    return total


def _is_body(inertia: pin.Inertia | None) -> bool:
    """Whether an inertia is that of a body, which has a mass and three moments of inertia."""
    return (
        inertia is not None
        and inertia.mass > LEAST_MASS
        and _are_moments(np.linalg.eigvalsh(inertia.inertia))
    )


def _are_moments(moments: NDArray[np.floating]) -> bool:
    """Whether a body may have these principal moments of inertia ``(3,)``, the largest one last."""
    return bool(moments[0] > 0.0 and moments[2] <= 1.001 * (moments[0] + moments[1]))


def _add_body(model: pin.Model, name: str, joint: int, inertia: pin.Inertia) -> None:
    """Add the frame of a link at its joint, which carries the link's own inertia."""
    frame = pin.Frame(name, joint, pin.SE3.Identity(), pin.FrameType.BODY, inertia)
    model.addFrame(frame, False)


def _check_inertias(model: pin.Model, where: str) -> None:
    """Check that everything that moves has a mass, and the inertia of a body of that mass."""
    for joint in range(1, model.njoints):
        inertia = model.inertias[joint]
        what = "the base" if joint == 1 else f"what the joint {model.names[joint]} turns"
        if not inertia.mass > LEAST_MASS:
            raise ValueError(f"{where}: {what} has no mass; no simulator can move it")
        moments = np.linalg.eigvalsh(inertia.inertia)
        if not _are_moments(moments):
            raise ValueError(
                f"{where}: {what} has principal moments of inertia {moments.tolist()} kg m^2, "
                "which no body has: all are positive, and none exceeds the sum of the others"
            )
