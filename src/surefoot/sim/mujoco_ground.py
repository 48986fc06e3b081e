"""The ground in a MuJoCo model: a plane, and the height fields of the robots that need one.

Robots of a batch share a model, but not the ground. Its parts are on bodies that each simulation
moves to where its own ground lies (`ground_poses`), and each simulation selects its own height
field. Read `sim.terrain` first, and `sim.mujoco_model` next, which builds the rest of a model.
"""

from __future__ import annotations

import mujoco
import numpy as np

from surefoot.config import SimulationConfig
from surefoot.config.sim import Terrain
from surefoot.rotations import from_heading, to_heading
from surefoot.sim.terrain import (
    APRON,
    CELL,
    HALF_WIDTH,
    POINTS,
    Ground,
    height_field,
    incline,
    is_plane,
)
from surefoot.types import Array

FLOOR = "floor"
"""The plane on which a robot walks, or that surrounds a height field."""
FIELD = "field"
"""On a `Ground`: the height field of a robot. Robots of a batch have one each."""
AWAY = -1000.0
"""[m] Where a height field is put that a robot does not need."""


def set_contact(geom: mujoco.MjsGeom, config: SimulationConfig, is_ground: bool) -> None:
    """Give a geom the settings of its contacts.

    Two geoms collide if the type of one is in the affinity of the other, so only robot and ground
    do. MuJoCo takes the larger friction of two geoms; with equal values that makes no difference.

    Args:
        geom: The geom.
        config: The friction and stiffness of the contacts.
        is_ground: Whether it is a part of the ground, and not of a robot.
    """
    geom.contype = int(is_ground)
    geom.conaffinity = int(not is_ground)
    geom.friction = [config.friction, 0.005, 0.0001]
    geom.condim = 3
    geom.solref = config.solref


def add_floor(body: mujoco.MjsBody, config: SimulationConfig) -> None:
    """Add an endless plane to a body.

    Args:
        body: The body.
        config: The friction and stiffness of the contacts.
    """
    plane = mujoco.mjtGeom.mjGEOM_PLANE
    geom = body.add_geom(name=FLOOR, type=plane, size=[0, 0, 0.05])
    set_contact(geom, config, is_ground=True)


def add_ground(spec: mujoco.MjSpec, ground: Ground, config: SimulationConfig) -> None:
    """Add a plane and, if a robot needs one, the height fields of all robots.

    Both are on mocap bodies, which each simulation can put where it wants. One geom stands for all
    fields, because each simulation selects its own field; the highest field gives the geom its
    bounds.

    Args:
        spec: The model.
        ground: The ground of the robots; the compiled model has that of the first robot.
        config: The friction and stiffness of the contacts.
    """
    planes, fields = ground_poses(ground)
    # The compiled model has the ground of the first robot.
    body = spec.worldbody.add_body(name=FLOOR, mocap=True, pos=planes[0, :3], quat=planes[0, 3:])
    add_floor(body, config)
    terrains = fields_of(ground)
    if not terrains:
        return
    for number, terrain in enumerate(terrains):
        unit = height_field(terrain.kind, terrain.seed)
        # Elevations are shares of `highest`; below its lowest point, the field is solid for 1 m.
        highest = max(terrain.high * unit.max(), 1e-6)
        spec.add_hfield(
            name=f"{FIELD}-{number}",
            size=[HALF_WIDTH, HALF_WIDTH, highest, 1.0],
            nrow=POINTS,
            ncol=POINTS,
            userdata=(unit / unit.max()).ravel(),
        )
    tallest = max(range(len(terrains)), key=lambda number: _highest(terrains[number]))
    body = spec.worldbody.add_body(name=FIELD, mocap=True, pos=fields[0, :3], quat=fields[0, 3:])
    kind = mujoco.mjtGeom.mjGEOM_HFIELD
    geom = body.add_geom(name=FIELD, type=kind, hfieldname=f"{FIELD}-{tallest}")
    set_contact(geom, config, is_ground=True)


def keep_near(model: mujoco.MjModel, ground: Ground, points: Array, margin: float) -> None:
    """Cut a model's height field down to what is near some points, in place.

    Only pictures need it: a renderer draws a whole field, which takes long.

    Args:
        model: A model from `build_model`, of one robot.
        ground: Its ground.
        points: ``(n, 2)`` points of the world [m].
        margin: What lies farther than about this from all of them is cut off [m].
    """
    if not fields_of(ground):
        return
    turn = np.array([np.cos(ground.yaw[0]), np.sin(ground.yaw[0])])
    local = to_heading(points - ground.origin[0, :2], turn)
    low = np.clip((local.min(axis=0) - margin + HALF_WIDTH) / CELL, 0, POINTS - 2).astype(int)
    high = np.clip((local.max(axis=0) + margin + HALF_WIDTH) / CELL, low + 1, POINTS - 1)
    left, front = low
    right, back = high.astype(int)
    field = model.hfield_data.reshape(POINTS, POINTS)[front : back + 1, left : right + 1].copy()
    rows, columns = field.shape
    model.hfield_nrow[0] = rows
    model.hfield_ncol[0] = columns
    model.hfield_data[: field.size] = field.ravel()
    model.hfield_size[0, :2] = 0.5 * CELL * np.array([right - left, back - front])
    middle = CELL * 0.5 * np.array([right + left, back + front]) - HALF_WIDTH
    body = model.body(FIELD).id
    model.body_pos[body, :2] = ground.origin[0, :2] + from_heading(middle, turn)


def _highest(terrain: Terrain) -> float:
    """The height of the highest point of a height field above its lowest [m]."""
    return terrain.high * float(height_field(terrain.kind, terrain.seed).max())


def fields_of(ground: Ground) -> list[Terrain]:
    """Return the terrains of a ground that are height fields, each of them once, in order.

    Args:
        ground: The ground.
    """
    return [terrain for terrain in dict.fromkeys(ground.terrains) if not is_plane(terrain)]


def ground_poses(ground: Ground) -> tuple[Array, Array]:
    """Return where the plane and the height field of each robot lie.

    Args:
        ground: The ground of B robots.

    Returns:
        Positions [m] and quaternions, wxyz, of the planes ``(B, 7)`` and of the fields ``(B, 7)``,
        which are far away where a robot has none.
    """
    half = 0.5 * ground.yaw
    zero = np.zeros_like(half)
    heading = np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)
    fields = np.concatenate([ground.origin, heading], axis=1)
    planes = fields.copy()
    for row, terrain in enumerate(ground.terrains):
        if is_plane(terrain):
            fields[row, 2] = AWAY
            # A rise along x is a rotation about -y.
            rise = -0.5 * incline(terrain)
            mujoco.mju_mulQuat(
                planes[row, 3:], heading[row], np.array([np.cos(rise), 0.0, np.sin(rise), 0.0])
            )
        else:
            planes[row, 2] -= APRON
    return planes, fields
