"""The gait clock: when each foot stands, and when a robot begins a commanded gait.

Time is in ticks of 1 ms. All gaits share one clock, and the phase of each follows from its own
period. The module needs only NumPy, so that planner, rollouts, viewer and the loop on the robot
share one rule for when a gait begins. Read `mpc.schedule` for the horizon of a plan, and
`scenarios.gait_switches` for episodes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from surefoot.config.mpc import Gait
from surefoot.types import (
    GRID,
    TICKS_PER_SECOND,
    Array,
    BoolArray,
    Command,
    GaitCommand,
    IntArray,
    to_ticks,
)


def grid_cycle(gait: Gait) -> int:
    """Return the time after which gait and grid coincide again as before [ms].

    Args:
        gait: The gait, for its period.
    """
    return math.lcm(to_ticks(gait.period), GRID)


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


def switch_tick(old: Gait, new: Gait, tick: int) -> int:
    """The tick of the gait clock at which a robot begins a commanded gait [ms].

    It is the first tick at which a cycle of the new gait begins while a foot stands in the old one,
    as some foot did at the previous node, so that no robot has to land in a new gait. If there is
    none, it is the first tick at which a cycle begins. It is on the grid of plans, so an expert
    plans there anyway.

    Args:
        old: The gait that the robot walks.
        new: The gait that is commanded.
        tick: The tick at which it is commanded.
    """
    cycle = grid_cycle(new)
    several = math.lcm(grid_cycle(old), cycle) // cycle
    begins = -(-tick // cycle) * cycle + cycle * np.arange(several)
    standing = in_stance(old, begins).any(axis=1) & in_stance(old, begins - GRID).any(axis=1)
    return int(begins[standing.argmax()])


class GaitChange:
    """Which of several gaits one robot walks: the commanded one, from its `switch_tick` on.

    If another gait is commanded before that tick, only the later command counts.

    Args:
        gaits: The gaits, by their numbers.
    """

    def __init__(self, gaits: Sequence[Gait]) -> None:
        self._gaits = tuple(gaits)
        self.begin(0)

    @property
    def asked(self) -> int:
        """The number of the gait that was commanded last."""
        return self._asked

    def begin(self, number: int) -> None:
        """Walk a gait at once, as at the beginning of an episode.

        Args:
            number: Its number.

        Raises:
            ValueError: There is no such gait.
        """
        self._check(number)
        self._old = number
        self._asked = number
        self._begins = 0

    def ask(self, number: int, tick: int) -> None:
        """Command a gait; commanding it again changes nothing.

        Args:
            number: Its number.
            tick: The gait clock [ms].

        Raises:
            ValueError: There is no such gait.
        """
        if number == self._asked:
            return
        self._check(number)
        self._old = self.at(tick)
        self._asked = number
        self._begins = tick
        if number != self._old:
            self._begins = switch_tick(self._gaits[self._old], self._gaits[number], tick)

    def at(self, tick: int) -> int:
        """The number of the gait that is walked.

        Args:
            tick: The gait clock, now or later, if no other gait is commanded until then [ms].
        """
        return self._asked if tick >= self._begins else self._old

    def command(self, velocity: Command, tick: int) -> Command:
        """A velocity as a command in the gait that is walked.

        Args:
            velocity: The velocity.
            tick: As for `at`.
        """
        gait = self.at(tick)
        return GaitCommand(*velocity, gait=gait) if gait else velocity

    def _check(self, number: int) -> None:
        """Check the number of a gait."""
        if not 0 <= number < len(self._gaits):
            raise ValueError(f"the gait number {number}; use 0 to {len(self._gaits) - 1}")
