"""Writes a robot's model as a URDF for PyBullet, with the package's collision shapes.

PyBullet takes the inertial frame of the base link as the base frame. Where the two differ, the base
link gets a thousandth of the mass of the base, at its frame's origin, and a second link, fixed to
it, carries the rest. Read `sim.bullet` next.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from surefoot.robots.canonical import BASE, KINDS, PARTS, joint_axes
from surefoot.robots.model import RobotModel, Shape
from surefoot.types import LEGS, Array

TRUNK = "trunk"
"""The name of the link that carries most of the base, where there is one."""
CORE_SHARE = 1e-3
"""The share of the base's mass that stays in the base link in that case."""


def write_urdf(robot: RobotModel) -> str:
    """Return a URDF of the robot's model, with the shapes of `RobotModel.shapes`.

    Joints turn without limits, which would only hide a broken controller.

    Args:
        robot: The robot.
    """
    model = robot.model
    axes = joint_axes(model)
    shapes = {shape.link: shape for shape in robot.shapes}
    root = ElementTree.Element("robot", {"name": robot.name})
    base = _own(model, BASE)
    if _is_centered(base):
        _add_link(root, BASE, base, shapes.get(BASE))
    else:
        size = CORE_SHARE * base.mass
        core = pin.Inertia(size, np.zeros(3), size * 1e-2 * np.eye(3))
        _add_link(root, BASE, core, shapes.get(BASE))
        _add_link(root, TRUNK, base - core, None)
        _add_joint(root, "fixed", TRUNK, BASE, TRUNK, pin.SE3.Identity())
    for number, leg in enumerate(LEGS):
        parent = BASE
        for place, (kind, part) in enumerate(zip(KINDS, PARTS, strict=True)):
            name = f"{leg}_{part}"
            _add_link(root, name, _own(model, name), shapes.get(name))
            joint = model.getJointId(f"{leg}_{kind}")
            placement = model.jointPlacements[joint]
            element = _add_joint(root, "continuous", f"{leg}_{kind}", parent, name, placement)
            axis = axes[3 * number + place]
            ElementTree.SubElement(element, "axis", {"xyz": _text(axis)})
            damping = model.damping[model.joints[joint].idx_v]
            if damping:
                ElementTree.SubElement(element, "dynamics", {"damping": _text([damping])})
            parent = name
        foot = f"{leg}_FOOT"
        _add_link(root, foot, _own(model, foot), shapes.get(foot))
        placement = model.frames[model.getFrameId(foot)].placement
        _add_joint(root, "fixed", f"{leg}_ANKLE", parent, foot, placement)
    ElementTree.indent(root)  # PyBullet reads lines of at most 1024 bytes
    return ElementTree.tostring(root, encoding="unicode")


def _own(model: pin.Model, link: str) -> pin.Inertia:
    """The inertia of a link by itself."""
    return model.frames[model.getFrameId(link)].inertia


def _is_centered(inertia: pin.Inertia) -> bool:
    """Whether an inertia's principal axes and center are those of its frame."""
    off_diagonal = inertia.inertia - np.diag(np.diag(inertia.inertia))
    return not inertia.lever.any() and not off_diagonal.any()


def _add_link(
    root: ElementTree.Element, name: str, inertia: pin.Inertia, shape: Shape | None
) -> None:
    """Add a link with its inertia, in its own frame, and its shape if it has one."""
    link = ElementTree.SubElement(root, "link", {"name": name})
    inertial = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(inertial, "origin", {"xyz": _text(inertia.lever), "rpy": "0 0 0"})
    ElementTree.SubElement(inertial, "mass", {"value": _text([inertia.mass])})
    I = inertia.inertia  # noqa: E741
    names = {"ixx": I[0, 0], "ixy": I[0, 1], "ixz": I[0, 2], "iyy": I[1, 1], "iyz": I[1, 2]}
    names["izz"] = I[2, 2]
    ElementTree.SubElement(
        inertial, "inertia", {key: _text([value]) for key, value in names.items()}
    )
    if shape is None:
        return
    # PyBullet multiplies the friction of two bodies; the floor has that of the pair.
    contact = ElementTree.SubElement(link, "contact")
    ElementTree.SubElement(contact, "lateral_friction", {"value": "1.0"})
    ElementTree.SubElement(contact, "rolling_friction", {"value": "0.0"})
    ElementTree.SubElement(contact, "spinning_friction", {"value": "0.0"})
    ElementTree.SubElement(contact, "restitution", {"value": "0.0"})
    link.append(_collision(shape))


def _add_joint(
    root: ElementTree.Element, kind: str, name: str, parent: str, child: str, placement: pin.SE3
) -> ElementTree.Element:
    """Add a joint of some kind between two links, and return its element."""
    joint = ElementTree.SubElement(root, "joint", {"name": name, "type": kind})
    ElementTree.SubElement(joint, "parent", {"link": parent})
    ElementTree.SubElement(joint, "child", {"link": child})
    angles = pin.rpy.matrixToRpy(placement.rotation) + 0.0  # no negative zeros
    origin = {"xyz": _text(placement.translation), "rpy": _text(angles)}
    ElementTree.SubElement(joint, "origin", origin)
    return joint


def _text(values: Array | list[float]) -> str:
    """Numbers as a URDF has them, to the last bit."""
    return " ".join(repr(float(value)) for value in values)


def _collision(shape: Shape) -> ElementTree.Element:
    """Return a shape as a URDF element; capsules lie along z, so they are turned into place."""
    start = np.array(shape.start)
    end = np.array(shape.end)
    axis = end - start
    length = float(np.linalg.norm(end - start))
    roll = pitch = 0.0
    if len(shape.size) == 3:
        kind = "box"
        size = {"size": " ".join(repr(2 * half) for half in shape.size)}
    elif length == 0.0:
        kind = "sphere"
        size = {"radius": repr(shape.size[0])}
    else:
        kind = "capsule"
        size = {"radius": repr(shape.size[0]), "length": repr(length)}
        # Ry(pitch) Rx(roll) takes z to this axis.
        roll = -np.arcsin(axis[1] / length)
        pitch = np.arctan2(axis[0], axis[2])
    collision = ElementTree.Element("collision")
    middle = " ".join(repr(float(x)) for x in (start + end) / 2)
    origin = {"xyz": middle, "rpy": f"{float(roll)!r} {float(pitch)!r} 0"}
    ElementTree.SubElement(collision, "origin", origin)
    ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), kind, size)
    return collision
