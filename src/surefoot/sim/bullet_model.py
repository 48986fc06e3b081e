"""The model of a robot for PyBullet: its URDF with the contact shapes of the robot.

Read ``sim.bullet`` next, which simulates such models.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from surefoot.robots.model import RobotModel, Shape


def build_urdf(robot: RobotModel) -> str:
    """Return the robot's URDF with the shapes of `RobotModel.shapes` for its collision meshes.

    Joints turn without limits, which would only hide a broken controller, and without damping.

    Args:
        robot: The robot.
    """
    root = ElementTree.fromstring(robot.urdf.read_text())
    shapes: dict[str, Shape] = {shape.link: shape for shape in robot.shapes}
    for link in root.iter("link"):
        for tag in ("visual", "collision", "contact"):
            for element in link.findall(tag):
                link.remove(element)
        shape = shapes.get(link.get("name", ""))
        if shape is None:
            continue
        # Of the friction of two bodies PyBullet takes the product; the floor has the pair's.
        contact = ElementTree.SubElement(link, "contact")
        coefficients = {"lateral_friction": 1.0}
        for name in ("lateral_friction", "rolling_friction", "spinning_friction", "restitution"):
            value = str(coefficients.get(name, 0.0))
            ElementTree.SubElement(contact, name, {"value": value})
        link.append(_collision(shape))
    for joint in root.iter("joint"):
        if joint.get("type") == "revolute":
            joint.set("type", "continuous")
        for tag in ("limit", "dynamics"):
            for element in joint.findall(tag):
                joint.remove(element)
    return ElementTree.tostring(root, encoding="unicode")


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
