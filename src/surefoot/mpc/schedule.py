"""The horizon of a plan on the one global grid: how far it looks ahead, and where its nodes lie.

Time is the gait clock in ticks of 1 ms; `gait_clock` says which foot stands when. Nodes lie on
multiples of ``GRID``. A horizon that is asked for at any tick starts there and joins the grid with
its second node, so that plans made at different ticks agree about every later contact. Read
`footholds` next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surefoot.config import ExpertConfig, Gait
from surefoot.config.gait_clock import grid_cycle, in_stance, phase
from surefoot.types import GRID, Array, IntArray, to_ticks

SHORTEST_NODE = 10
"""[ms] A first node that is shorter than this is merged with the next."""


class Horizon(NamedTuple):
    """How far the two problems of a plan look ahead, in nodes."""

    centroidal: int
    kinematic: int


def horizon(gait: Gait, config: ExpertConfig) -> Horizon:
    """Return the numbers of nodes of a plan: the configured ones, or those that suit the gait.

    Forces are planned for two periods, within 10 to 20 nodes, and motions half as far, within 5 to
    10 nodes. Measured with trots of 0.33 to 0.8 s, bounds of 0.3 s and crawls of 1.6 s.

    Args:
        gait: The gait, for its period.
        config: The configuration; where its numbers of nodes are None, the gait decides.
    """
    centroidal = config.centroidal.nodes
    if centroidal is None:
        two_periods = round(2 * to_ticks(gait.period) / GRID)
        centroidal = max(min(max(two_periods, 10), 20), config.kinematic.nodes or 0)
    kinematic = config.kinematic.nodes
    if kinematic is None:
        kinematic = min(max(centroidal // 2, 5), 10, centroidal)
    return Horizon(centroidal, kinematic)


def stands(gait: Gait) -> bool:
    """Return True for a gait that plans no swing: at no node of the grid is a foot in the air.

    Args:
        gait: The gait, for its period, offsets and duty factor.
    """
    return bool(in_stance(gait, np.arange(0, grid_cycle(gait), GRID)).all())


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


def swing_fraction(gait: Gait, tick: IntArray | int) -> Array:
    """Return the share ``(..., 4)`` of the swing that has passed; it is 0 or less in stance.

    With a duty factor of 1, where there is no swing, it is 0.

    Args:
        gait: The gait, for its period, offsets and duty factor.
        tick: The gait clock, a number or an array ``(...)`` [ms].
    """
    since_stance = phase(gait, tick) - gait.duty
    if gait.duty == 1.0:
        return np.zeros_like(since_stance)
    return since_stance / (1 - gait.duty)
