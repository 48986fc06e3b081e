"""Solo12's models in both simulators are the description's own, bit for bit.

Results depend on every bit of them. MuJoCo and PyBullet read the description themselves here, as
they did before its models were built from Pinocchio's.
"""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from surefoot.robots.load import load_robot
from surefoot.sim.mujoco_model import build_model
from surefoot.sim.urdf import write_urdf

ROBOT = load_robot("solo12")
LIMITS = ("jnt_range", "jnt_actfrcrange")
"""What the description has and the package does not use."""


def described_model() -> mujoco.MjModel:
    """The bodies of the model that MuJoCo makes of the description, with the feet fused."""
    root = ElementTree.fromstring(ROBOT.urdf.read_text())
    for link in root.iter("link"):
        for element in link.findall("collision") + link.findall("visual"):
            link.remove(element)
    options = {"strippath": "false", "discardvisual": "false", "fusestatic": "true"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", options)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.body("base_link").add_freejoint()
    for joint in spec.joints:
        joint.damping = np.zeros(3)
        joint.armature = 0.0
        joint.frictionloss = 0.0
    return spec.compile()


@pytest.mark.parametrize("prefix", ["body_", "jnt_", "dof_"])
def test_mujocos_bodies_and_joints(prefix):
    expected = described_model()
    model = build_model(ROBOT)
    names = [
        name
        for name in dir(model)
        if name.startswith(prefix) and isinstance(getattr(model, name), np.ndarray)
    ]
    # Geometry, sites and contacts are the package's own in both.
    own = (
        "geom",
        "bvh",
        "flags",
        "solref",
        "contype",
        "conaffinity",
        "margin",
        "limited",
        "length",
    )
    names = [name for name in names if name not in LIMITS and not any(part in name for part in own)]
    assert len(names) > 3
    for name in names:
        np.testing.assert_array_equal(getattr(model, name), getattr(expected, name), err_msg=name)


def numbers(element, path: str, key: str) -> tuple[float, ...]:
    """The numbers of an attribute somewhere below an element; zeros if it is not there."""
    found = element.find(path)
    text = "0 0 0" if found is None else found.get(key, "0 0 0")
    return tuple(float(word) for word in text.split())


def link_of(joint, end: str) -> str:
    """The name of the parent or child link of a joint."""
    found = joint.find(end)
    assert found is not None
    return found.get("link", "")


def test_pybullets_links_and_joints():
    described = ElementTree.fromstring(ROBOT.urdf.read_text())
    written = ElementTree.fromstring(write_urdf(ROBOT))
    links = {link.get("name"): link for link in described.findall("link")}
    names = [link.get("name") for link in written.findall("link")]
    assert names == list(links)
    for link in written.findall("link"):
        original = links[link.get("name")]
        assert numbers(link, "inertial/mass", "value") == numbers(
            original, "inertial/mass", "value"
        )
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
            path = "inertial/inertia"
            assert numbers(link, path, key) == numbers(original, path, key)
        path = "inertial/origin"
        assert numbers(link, path, "xyz") == numbers(original, path, "xyz")
    joints = {link_of(joint, "child"): joint for joint in described.findall("joint")}
    for joint in written.findall("joint"):
        original = joints[link_of(joint, "child")]
        assert link_of(joint, "parent") == link_of(original, "parent")
        assert numbers(joint, "origin", "xyz") == numbers(original, "origin", "xyz")
        assert numbers(joint, "origin", "rpy") == numbers(original, "origin", "rpy")
        if original.get("type") == "revolute":
            assert joint.get("name") == original.get("name")
            assert numbers(joint, "axis", "xyz") == numbers(original, "axis", "xyz")
