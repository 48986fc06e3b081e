"""The meshes that pictures of a robot show; nothing else needs them.

Pinocchio reads them, in any format that a URDF may name, and turns them all into triangles.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from surefoot.robots.canonical import BASE, PARTS, locked_pose
from surefoot.robots.description import read_description, read_urdf
from surefoot.robots.model import RobotModel
from surefoot.types import LEGS, Array, IntArray

MOST_AREA = 5.0
"""A mesh whose triangles have more than this times the area of its bounding box is a tangle: in
some COLLADA files with several parts, Pinocchio joins corners that do not belong together."""


class Mesh(NamedTuple):
    """A mesh of a link.

    Attributes:
        link: The link that carries it, by its canonical name.
        placement: The mesh in the frame of that link.
        vertices: ``(n, 3)`` corners of the triangles [m].
        triangles: ``(m, 3)`` three corners of each triangle.
        color: ``(4,)`` red, green, blue and opacity.
    """

    link: str
    placement: pin.SE3
    vertices: Array
    triangles: IntArray
    color: Array


def visual_meshes(robot: RobotModel) -> list[Mesh]:
    """Read the meshes of a robot's description, which takes seconds for some robots.

    If the visual meshes are a tangle, the collision meshes are used instead; if these are one too,
    there are none.

    Args:
        robot: The robot.

    Raises:
        ValueError: A mesh is missing, or cannot be read.
    """
    for kind in (pin.GeometryType.VISUAL, pin.GeometryType.COLLISION):
        meshes = _meshes(robot, kind)
        if not any(map(_is_tangle, meshes)):
            return meshes
    return []


def missing_meshes(path: Path) -> tuple[int, list[str]]:
    """Return how many visual meshes a description has, and the names of the missing ones.

    Args:
        path: The description; the packages that it names are folders above it.
    """
    root = read_urdf(path)
    names = {mesh.get("filename", "") for mesh in root.iterfind("link/visual/geometry/mesh")}
    missing = []
    for name in sorted(names):
        scheme, _, inside = name.rpartition("://")
        # Pinocchio looks for a name without a scheme below the packages, too.
        folders = path.parents if scheme in ("", "package", "model") else (path.parent,)
        if not any((folder / inside).is_file() for folder in folders):
            missing.append(name)
    return len(names), missing


def _meshes(robot: RobotModel, kind: pin.GeometryType) -> list[Mesh]:
    """The meshes of one kind in a robot's description."""
    description = read_description(robot.spec)
    packages = [str(folder) for folder in description.path.parents]
    source = description.model
    try:
        geometry = pin.buildGeomFromUrdf(source, str(description.path), kind, package_dirs=packages)
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{robot.name}: its meshes cannot be read ({error})") from error
    links = [f"{leg}_{part}" for leg in LEGS for part in PARTS]
    link_of = dict(zip(robot.spec.source_joints, links, strict=True))
    data = source.createData()
    pin.forwardKinematics(source, data, locked_pose(source, robot.spec.source_joints))
    meshes = []
    for visual in geometry.geometryObjects:
        if not visual.meshPath or visual.geometry.getObjectType().name != "OT_BVH":
            continue
        # A mesh of a locked joint belongs to the first joint above it that is not locked.
        joint = visual.parentJoint
        while joint > 1 and source.names[joint] not in link_of:
            joint = source.parents[joint]
        placement = data.oMi[joint].actInv(data.oMi[visual.parentJoint]) * visual.placement
        shape = visual.geometry
        corners = map(shape.tri_indices, range(shape.num_tris))
        triangles = [(corner[0], corner[1], corner[2]) for corner in corners]
        meshes.append(
            Mesh(
                link_of.get(source.names[joint], BASE),
                placement,
                np.array(shape.vertices()),
                np.array(triangles),
                np.array(visual.meshColor),
            )
        )
    return meshes


def _is_tangle(mesh: Mesh) -> bool:
    """Whether a mesh's triangles have far more area than its bounding box."""
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)  # corners of all triangles
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    x, y, z = np.ptp(mesh.vertices, axis=0)
    return bool(area > MOST_AREA * 2 * (x * y + y * z + z * x))
