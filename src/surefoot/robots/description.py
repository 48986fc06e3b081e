"""Reads a robot's URDF: finds the file, and makes Pinocchio's model of it, with all its joints.

Everything that can be wrong with such a file is said in one sentence. Read `robots.canonical` next,
which makes the package's own model of what is read here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from surefoot.config.json_text import read_file
from surefoot.config.robots import RobotSpec
from surefoot.errors import unknown
from surefoot.types import Array

MOST_BYTES = 20_000_000
"""[B] No URDF is larger; that of a humanoid takes 200 kB."""


@dataclass(frozen=True)
class Description:
    """A URDF that has been read.

    Attributes:
        path: The file.
        model: Pinocchio's model with a free-flyer base, with all joints of the file.
        inertias: The inertia of each link that has one, in its own frame, exactly as in the file:
            Pinocchio adds up those of links that move together.
    """

    path: Path
    model: pin.Model
    inertias: Mapping[str, pin.Inertia]


def robots_folder() -> Path:
    """Return the folder of the robots of ``example-robot-data``.

    Raises:
        ImportError: The package ``example-robot-data`` is missing.
    """
    try:
        data = distribution("example-robot-data")
    except PackageNotFoundError as error:
        raise ImportError(
            "the robots' descriptions are missing: pip install example-robot-data"
        ) from error
    share = Path(str(data.locate_file("cmeel.prefix/share")))
    return share / "example-robot-data/robots"


def find_urdf(spec: RobotSpec) -> Path:
    """Return the path of a robot's description.

    Args:
        spec: The robot.

    Raises:
        ValueError: There is no such file, neither as a path nor under ``example-robot-data``.
        ImportError: The package ``example-robot-data`` is missing.
    """
    path = Path(spec.urdf).expanduser()
    candidates = [path] if path.is_absolute() else [robots_folder() / path, path]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    tried = " nor ".join(str(candidate) for candidate in candidates)
    raise ValueError(
        f"{spec.name}: there is no description {tried}; `urdf` is the path of a URDF file, or its "
        "path under the robots of example-robot-data"
    )


def read_description(spec: RobotSpec) -> Description:
    """Read a robot's URDF.

    Args:
        spec: The robot.

    Raises:
        ValueError: The file is not there, too large, no URDF, or one that Pinocchio cannot read.
        ImportError: The package ``example-robot-data`` is missing.
    """
    path = find_urdf(spec)
    root = read_urdf(path)
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            _limit_widely(joint)
    text = ElementTree.tostring(root, encoding="unicode")
    try:
        model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{path}: Pinocchio cannot read it ({error})") from error
    try:
        inertias = {link.get("name", ""): _inertia(link) for link in root.iter("link")}
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    links = {name: own for name, own in inertias.items() if own is not None}
    return Description(path, model, links)


def read_urdf(path: Path) -> ElementTree.Element:
    """Read the elements of a URDF, in whatever encoding it declares.

    Args:
        path: The file.

    Raises:
        ValueError: The file is too large, or no URDF.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ValueError(f"{path} has {size} bytes; a URDF has at most {MOST_BYTES}")
    content = read_file(path)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # of unknown encodings too
        raise ValueError(f"{path} is no URDF: it is not XML ({error})") from error
    if root.tag != "robot":
        raise ValueError(f"{path} is no URDF: its root is <{root.tag}>, expected <robot>")
    return root


def frame_id(description: Description, name: str, robot: str) -> int:
    """Return the id of a frame.

    Args:
        description: The description.
        name: The name of the frame, or of the link whose frame it is.
        robot: The robot's name, for the error.

    Raises:
        ValueError: There is no such frame.
    """
    model = description.model
    if not model.existFrame(name):
        names = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
        raise ValueError(f"{robot}, {description.path}: " + unknown("frame", name, names))
    return model.getFrameId(name)


def _inertia(link: ElementTree.Element) -> pin.Inertia | None:
    """The inertia of a link in its own frame; None if it has none."""
    inertial = link.find("inertial")
    mass = None if inertial is None else inertial.find("mass")
    tensor = None if inertial is None else inertial.find("inertia")
    if inertial is None or mass is None or tensor is None:
        return None
    xx, xy, xz, yy, yz, zz = (
        float(tensor.get(key, "0")) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    origin = inertial.find("origin")
    center = _three(origin, "xyz")
    turn = _three(origin, "rpy")
    if turn.any():
        R = pin.rpy.rpyToMatrix(turn)
        inertia = R @ inertia @ R.T
    return pin.Inertia(float(mass.get("value", "nan")), center, inertia)


def _three(element: ElementTree.Element | None, key: str) -> Array:
    """Three numbers of an attribute; zeros if it is missing."""
    text = "0 0 0" if element is None else element.get(key, "0 0 0")
    values = np.array([float(word) for word in text.split()])
    if len(values) != 3:
        raise ValueError(f"{key} is {text!r}, expected three numbers")
    return values


def _limit_widely(joint: ElementTree.Element) -> None:
    """Make a joint that turns forever one with limits that nothing reaches.

    Pinocchio gives a joint without limits two coordinates, its cosine and sine.
    """
    joint.set("type", "revolute")
    if joint.find("limit") is None:
        ElementTree.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
    for limit in joint.findall("limit"):
        limit.set("lower", "-1000")
        limit.set("upper", "1000")
