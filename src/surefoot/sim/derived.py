"""What follows from the states of a tick, computed in one compiled call: `complete`.

A ``State`` computes its rotation, its heading and the places of its feet when they are first
needed, with numpy. That is the reference, for one robot and for a million frames alike; but in
every tick of a simulation it takes some fifteen calls on small arrays. The compiled form makes the
same operations in the same order, so that the results are the same to the bit. Read `types.State`
for the definitions, and `mujoco` next, which uses this.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from surefoot.robots import rigid
from surefoot.types import Array, BoolArray, State


def complete(q: Array, v: Array, com: Array, feet: Array, contacts: BoolArray) -> State:
    """Return the states of B robots, with all but the angles that `State` derives from them.

    Args:
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities, base part in the base frame.
        com: ``(B, 3)`` center of mass, world frame [m].
        feet: ``(B, 4, 3)`` foot positions, world frame [m].
        contacts: ``(B, 4)`` True where a foot is in contact.
    """
    B = len(q)
    rotation = np.empty((B, 3, 3))
    heading = np.empty((B, 2))
    feet_around = np.empty((B, 4, 2))
    _derive(q, com, feet, rotation, heading, feet_around)
    return State.complete(q, v, com, feet, contacts, rotation, heading, feet_around)


@intrinsic
def _multiply_add(typingctx: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001
    """Return a * b + c, rounded once, as numpy's product of complex numbers does it."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:  # noqa: ARG001
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), build


@njit(cache=True, error_model="numpy")
def _derive(
    q: Array, com: Array, feet: Array, rotation: Array, heading: Array, feet_around: Array
) -> None:
    """Fill the last three arrays, as `rotations.rotation`, `heading` and `to_heading` would."""
    for robot in range(len(q)):
        rows = rigid.rotation(q[robot])
        for i in range(3):
            rigid.store(rotation[robot, i], rows[i])
        x = rows[0][0]
        y = rows[1][0]
        length = np.hypot(x, y)
        if length <= 1e-9:  # the base's x axis is vertical
            x = 1.0
            y = 0.0
            length = 1.0
        cos = x / length
        sin = y / length
        heading[robot, 0] = cos
        heading[robot, 1] = sin
        for leg in range(4):
            dx = feet[robot, leg, 0] - com[robot, 0]
            dy = feet[robot, leg, 1] - com[robot, 1]
            feet_around[robot, leg, 0] = _multiply_add(dx, cos, dy * sin)
            feet_around[robot, leg, 1] = _multiply_add(dx, -sin, dy * cos)
