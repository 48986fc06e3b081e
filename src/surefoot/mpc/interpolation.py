"""Interpolates the nodes of a plan linearly, to one row per tick. Read `planner` next."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.types import TICKS_PER_SECOND, Array


class NodeRows(NamedTuple):
    """What a plan gives at its nodes, or at its ticks.

    Attributes:
        q: ``(T, 19)`` configurations.
        v: ``(T, 18)`` velocities.
        acceleration: ``(T, 18)`` generalized accelerations [m/s^2, rad/s^2].
        force: ``(T, 4, 3)`` forces on the feet, world axes [N].
    """

    q: Array
    v: Array
    acceleration: Array
    force: Array


@njit(cache=True, error_model="numpy")
def interpolate(dt: Array, nodes: NodeRows, ticks: int) -> NodeRows:
    """Interpolate the rows at nodes linearly, to one row per tick, and normalize quaternions.

    Args:
        dt: ``(N,)`` durations of the nodes that contain the ticks [s].
        nodes: At least N + 1 rows.
        ticks: The number of ticks.
    """
    q, v, a, force = nodes
    row_q = np.empty((ticks, 19))
    row_v = np.empty((ticks, 18))
    row_a = np.empty((ticks, 18))
    row_force = np.empty((ticks, 4, 3))
    node = 0
    start = 0.0
    for tick in range(ticks):
        time = tick / TICKS_PER_SECOND
        while node < len(dt) - 1 and time + 1e-9 >= start + dt[node]:
            start += dt[node]
            node += 1
        share = (time - start) / dt[node]
        for i in range(19):
            row_q[tick, i] = (1 - share) * q[node, i] + share * q[node + 1, i]
        for i in range(18):
            row_v[tick, i] = (1 - share) * v[node, i] + share * v[node + 1, i]
            row_a[tick, i] = (1 - share) * a[node, i] + share * a[node + 1, i]
        for leg in range(4):
            for i in range(3):
                one = (1 - share) * force[node, leg, i]
                row_force[tick, leg, i] = one + share * force[node + 1, leg, i]
        x, y, z, w = row_q[tick, 3:7]
        row_q[tick, 3:7] /= np.sqrt(x * x + y * y + z * z + w * w)
    return NodeRows(row_q, row_v, row_a, row_force)
