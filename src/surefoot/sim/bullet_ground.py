"""The ground of one PyBullet world: a plane, and a height field where a terrain has one.

The surface is the one that MuJoCo sees, to 1e-8 m: `sim.terrain` has its numbers. Read `sim.bullet`
next, which builds worlds with it.
"""

from __future__ import annotations

import numpy as np
import pybullet

from surefoot.sim.terrain import APRON, CELL, POINTS, Ground, height_field, incline, is_plane


def set_friction(client: int, body: int, friction: float) -> None:
    """Give a part of the ground its friction, and no other resistance.

    Args:
        client: PyBullet's ``physicsClientId``.
        body: PyBullet's id of the part.
        friction: The coefficient of friction.
    """
    pybullet.changeDynamics(
        body,
        -1,
        lateralFriction=friction,
        restitution=0.0,
        rollingFriction=0.0,
        spinningFriction=0.0,
        physicsClientId=client,
    )


def lay_ground(client: int, floor: int, ground: Ground, friction: float) -> None:
    """Put the floor of a world where its ground is, and add the height field if there is one.

    Args:
        client: PyBullet's ``physicsClientId``.
        floor: PyBullet's id of the plane, which surrounds a height field.
        ground: The ground of one robot.
        friction: The coefficient of friction.
    """
    [terrain] = ground.terrains
    x, y, z = ground.origin[0].tolist()
    yaw = float(ground.yaw[0])
    plane = is_plane(terrain)
    # A rise along x is a rotation about -y.
    turn = pybullet.getQuaternionFromEuler([0.0, -incline(terrain), yaw])
    place = [x, y, z if plane else z - APRON]
    pybullet.resetBasePositionAndOrientation(floor, place, turn, physicsClientId=client)
    if plane:
        return
    heights = terrain.high * height_field(terrain.kind, terrain.seed)
    # PyBullet divides cells along the other diagonal, so the field is turned by 90 degrees to get
    # the right one. It also puts the middle between the lowest and the highest point at 0.
    turned = heights[:, ::-1].T
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_HEIGHTFIELD,
        meshScale=[CELL, CELL, 1.0],
        heightfieldData=turned.ravel().tolist(),
        numHeightfieldRows=POINTS,
        numHeightfieldColumns=POINTS,
        physicsClientId=client,
    )
    field = pybullet.createMultiBody(0.0, shape, physicsClientId=client)
    place = [x, y, z + 0.5 * float(heights.max() + heights.min())]
    turn = pybullet.getQuaternionFromEuler([0.0, 0.0, yaw + 0.5 * np.pi])
    pybullet.resetBasePositionAndOrientation(field, place, turn, physicsClientId=client)
    set_friction(client, field, friction)
