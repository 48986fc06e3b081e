"""Reads a robot's URDF: finds the file, and makes Pinocchio's model of it, with all its joints.

Errors say in one sentence what is wrong with such a file. Read `robots.canonical` next, which makes
the package's own model of what is read here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
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
MOST_MASS = 10_000.0
"""[kg] No link is heavier: such a number is a mistake, and no simulator can use it."""
MOST_INERTIA = 1e6
"""[kg m^2] No link has a larger moment of inertia, likewise."""
LEAST_AXIS = 1e-6
"""An axis shorter than this has no direction."""
RENAME = (
    "A spec writes {leg} for the leg's name in `legs`; names that do not follow one such pattern "
    "in all legs have to be changed in the URDF"
)
"""The advice for joints and links that a spec cannot name."""


@dataclass(frozen=True, eq=False)
class Description:
    """A URDF that has been read; only the same reading of the same content is equal to it.

    Attributes:
        path: The file.
        model: Pinocchio's model with a free-flyer base, with all joints of the file.
        inertias: The inertia of each link that has one, in its own frame, exactly as in the file;
            Pinocchio would add up those of links that move together.
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
    candidates = urdf_places(spec)
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    tried = " nor ".join(str(candidate) for candidate in candidates)
    raise ValueError(
        f"{spec.name}: there is no description {tried}; `urdf` is the path of a URDF file, which "
        "may be beside the spec, or its path under the robots of example-robot-data"
    )


def urdf_places(spec: RobotSpec) -> list[Path]:
    """Return where a robot's description may be, in the order in which it is looked for.

    Args:
        spec: The robot.

    Raises:
        ImportError: The package ``example-robot-data`` is missing.
    """
    path = Path(spec.urdf).expanduser()
    return [path] if path.is_absolute() else [robots_folder() / path, path]


def read_description(spec: RobotSpec) -> Description:
    """Read a robot's URDF.

    Args:
        spec: The robot.

    Raises:
        ValueError: The file is not there, too large, no URDF, or one that Pinocchio cannot read; or
            the numbers of a link or a joint, which the message names, are impossible.
        ImportError: The package ``example-robot-data`` is missing.
    """
    path = find_urdf(spec)
    return _description(path, _content(path))


@lru_cache(maxsize=16)
def _description(path: Path, content: bytes) -> Description:
    """The description in a URDF, shared by all that read the same content: nobody may change it.

    Args:
        path: The file.
        content: Its content.
    """
    root = _root(path, content)
    # This is before Pinocchio, which takes numbers that it cannot read as zeros.
    inertias = {}
    # Children of the robot only: elements of the same names in <gazebo> are not Pinocchio's.
    for link in root.findall("link"):
        with located(path, link):
            own = _inertia(link)
        if own is not None:
            inertias[link.get("name", "")] = own
    for joint in root.findall("joint"):
        with located(path, joint):
            _check_joint(joint)
        if joint.get("type") == "continuous":
            _limit_widely(joint)
    text = ElementTree.tostring(root, encoding="unicode")
    try:
        model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{path}: Pinocchio cannot read it ({error})") from error
    return Description(path, model, inertias)


def read_urdf(path: Path) -> ElementTree.Element:
    """Read the elements of a URDF, in whatever encoding it declares.

    Args:
        path: The file.

    Raises:
        ValueError: The file is too large, or no URDF.
    """
    return _root(path, _content(path))


def _content(path: Path) -> bytes:
    """The content of a file that is not too large for a URDF.

    Raises:
        ValueError: It is too large.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ValueError(f"{path} has {size} bytes; a URDF has at most {MOST_BYTES}")
    return read_file(path)


def _root(path: Path, content: bytes) -> ElementTree.Element:
    """The elements of a URDF.

    Args:
        path: The file, for errors.
        content: Its content.

    Raises:
        ValueError: It is no URDF.
    """
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # of unknown encodings too
        raise ValueError(f"{path} is no URDF: it is not XML ({error})") from error
    if root.tag != "robot":
        raise ValueError(f"{path} is no URDF: its root is <{root.tag}>, expected <robot>")
    return root


@contextmanager
def located(path: Path, element: ElementTree.Element) -> Iterator[None]:
    """Name the element and the file in errors about an element of a URDF.

    Args:
        path: The file.
        element: A link or a joint.

    Raises:
        ValueError: The code inside raised an error.
    """
    try:
        yield
    except (ValueError, RuntimeError) as error:  # Pinocchio's too
        name = element.get("name", "")
        raise ValueError(f"{path}, {element.tag} {name!r}: {error}") from error


def number(element: ElementTree.Element | None, key: str, default: float | None = None) -> float:
    """Return an attribute of an element as a number.

    Args:
        element: The element; None has no attributes.
        key: The name of the attribute.
        default: The number where there is no such attribute.

    Raises:
        ValueError: The attribute is not a number, or is missing and has no default.
    """
    text = None if element is None else element.get(key)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if math.isnan(value):
        given = "missing" if text is None else repr(text)
        raise ValueError(f"{key} is {given}, expected a number")
    return value


def frame_id(description: Description, name: str, robot: str) -> int:
    """Return the id of a frame; if a link and a joint share the name, that of the link.

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
        message = unknown("frame", name, names)
        raise ValueError(f"{robot}, {description.path}: {message}. {RENAME}")
    if model.existFrame(name, pin.FrameType.BODY):
        return model.getFrameId(name, pin.FrameType.BODY)
    return model.getFrameId(name)


def _inertia(link: ElementTree.Element) -> pin.Inertia | None:
    """The inertia of a link in its own frame; None if it has none."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    missing = [name for name in ("mass", "inertia") if inertial.find(name) is None]
    if missing:
        raise ValueError(f"its <inertial> has no <{missing[0]}>")
    tensor = inertial.find("inertia")
    mass = number(inertial.find("mass"), "value")
    if not 0.0 <= mass <= MOST_MASS:
        raise ValueError(f"its mass is {mass:g} kg, expected 0 to {MOST_MASS:g}")
    xx, xy, xz, yy, yz, zz = (
        number(tensor, key, 0.0) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if np.abs(inertia).max() > MOST_INERTIA:
        largest = np.abs(inertia).max()
        raise ValueError(
            f"its moments of inertia reach {largest:g} kg m^2, expected at most {MOST_INERTIA:g}"
        )
    origin = inertial.find("origin")
    center = _three(origin, "xyz")
    turn = _three(origin, "rpy")
    if turn.any():
        R = pin.rpy.rpyToMatrix(turn)
        inertia = R @ inertia @ R.T
    return pin.Inertia(mass, center, inertia)


def _three(element: ElementTree.Element | None, key: str, default: str = "0 0 0") -> Array:
    """Three numbers of an attribute; the default if it is missing."""
    text = default if element is None else element.get(key, default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([])
    if len(values) != 3 or not np.isfinite(values).all():
        raise ValueError(f"{key} is {text!r}, expected three numbers")
    return values


def _check_joint(joint: ElementTree.Element) -> None:
    """Check the numbers of a joint, as far as they belong to its type.

    Raises:
        ValueError: The joint has no valid place, no axis, no limits, or a lower limit above the
            upper one.
    """
    origin = joint.find("origin")
    _three(origin, "xyz")
    _three(origin, "rpy")
    if joint.get("type") not in ("revolute", "continuous", "prismatic"):
        return
    axis = _three(joint.find("axis"), "xyz", "1 0 0")
    if not np.linalg.norm(axis) > LEAST_AXIS:
        raise ValueError(f"its axis is {axis.tolist()}, which has no direction")
    limit = joint.find("limit")
    if joint.get("type") == "continuous":
        return
    if limit is None:
        raise ValueError("it has no <limit>; give it one, or the type continuous")
    low = number(limit, "lower", 0.0)
    high = number(limit, "upper", 0.0)
    if low > high:
        raise ValueError(f"its lower limit, {low:g}, is above the upper one, {high:g}")


def _limit_widely(joint: ElementTree.Element) -> None:
    """Give a joint that turns without end limits that nothing reaches.

    Pinocchio gives a joint without limits two coordinates, its cosine and sine.
    """
    joint.set("type", "revolute")
    if joint.find("limit") is None:
        ElementTree.SubElement(joint, "limit", {"effort": "0", "velocity": "0"})
    for limit in joint.findall("limit"):
        limit.set("lower", "-1000")
        limit.set("upper", "1000")
