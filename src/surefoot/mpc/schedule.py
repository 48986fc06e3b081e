"""Gait timing on the one global grid: which foot stands when, and where the nodes of a horizon lie.

Time is the gait clock in ticks of 1 ms. Nodes lie on multiples of ``GRID``. A horizon that is asked
for at any tick starts there and joins the grid with its second node, so that plans made at
different ticks agree about every later contact. Read `footholds` next.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import Gait
from surefoot.types import GRID, TICKS_PER_SECOND, Array, BoolArray, IntArray, to_ticks

SHORTEST_NODE = 10
"""[ms] A first node that is shorter than this is merged with the next."""


def node_ticks(tick: int, nodes: int) -> IntArray:
    """Return the gait clock ``(nodes + 1,)`` [ms] of the nodes of a horizon asked for at ``tick``.

    Args:
        tick: The gait clock at the start of the horizon [ms].
        nodes: The number of nodes of the horizon.
    """
    first = GRID - tick % GRID
    if first < SHORTEST_NODE:
        first += GRID
    return tick + np.concatenate([[0], first + GRID * np.arange(nodes)])


def phase(gait: Gait, tick: IntArray | int) -> Array:
    """Return the phase ``(..., 4)`` in [0, 1) of each leg; 0 is the start of its stance.

    Args:
        gait: The gait, for its period and offsets.
        tick: The gait clock, a number or an array ``(...)`` [ms].
    """
    period = to_ticks(gait.period)
    offset = np.array([round(share * period) for share in gait.offsets])
    return ((np.asarray(tick)[..., None] + offset) % period) / period


def in_stance(gait: Gait, tick: IntArray | int) -> BoolArray:
    """Return ``(..., 4)`` True where the gait clock puts a foot on the ground.

    The end of stance belongs to stance: on the grid a trot has two nodes of four feet in each half
    period, although its duty factor is 0.6.

    Args:
        gait: The gait, for its period, offsets and duty factor.
        tick: The gait clock, a number or an array ``(...)`` [ms].
    """
    return phase(gait, tick) <= gait.duty + 0.5 / (gait.period * TICKS_PER_SECOND)


def swing_fraction(gait: Gait, tick: IntArray | int) -> Array:
    """Return the share ``(..., 4)`` of the swing that has passed; it is 0 or less in stance.

    Args:
        gait: The gait, for its period, offsets and duty factor.
        tick: The gait clock, a number or an array ``(...)`` [ms].
    """
    return (phase(gait, tick) - gait.duty) / (1 - gait.duty)
