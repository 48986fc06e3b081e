"""When robots change their gait in an episode, and to which one, by command.

A gait is commanded as a velocity is. All gaits keep one clock, that of the episode, and each is at
the phase that this has in its own period: nothing is carried over, and what a controller does
depends on state, clock and command alone. A robot begins a new gait where that gait's cycle begins
(`next_cycle`): it may be asked for at any time, but switched at another phase an expert falls into
a pronk that is about to take off. Read `rollouts.engine` next, which commands them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Gait
from surefoot.mpc.schedule import grid_cycle
from surefoot.scenarios.seeds import seed_of
from surefoot.types import IntArray, to_ticks

NEVER = 2**31
"""[ms] When a robot changes its gait that does so less often than others."""


@dataclass(frozen=True)
class GaitSwitches:
    """The changes of gait of B robots, at most n of each.

    Attributes:
        elapsed: ``(B, n)`` the tick of the episode from which on each gait is walked [ms], in each
            row in the order of time; `NEVER` fills a row up.
        gait: ``(B, n)`` the number of that gait.

    Raises:
        ValueError: The two have other shapes, or a row is not in the order of time.
    """

    elapsed: IntArray
    gait: IntArray

    def __post_init__(self) -> None:
        """Check both arrays."""
        if np.ndim(self.elapsed) != 2 or np.shape(self.elapsed) != np.shape(self.gait):
            raise ValueError(
                f"gaits {np.shape(self.gait)} from the ticks {np.shape(self.elapsed)} on; give "
                "both for each robot and switch"
            )
        if (np.diff(self.elapsed, axis=1) < 0).any():
            raise ValueError("switches of gait that are not in the order of time; sort each row")

    def __len__(self) -> int:
        return len(self.elapsed)

    def __getitem__(self, rows: slice | NDArray) -> GaitSwitches:
        """The switches of some of the robots."""
        return GaitSwitches(self.elapsed[rows], self.gait[rows])

    def at(self, first: IntArray, elapsed: int) -> IntArray:
        """``(B,)`` the number of the gait that each robot is to walk at a tick of the episode.

        Args:
            first: ``(B,)`` the gaits in which the robots begin.
            elapsed: The tick.
        """
        begun = np.count_nonzero(self.elapsed <= elapsed, axis=1)
        gaits = np.column_stack([first, self.gait])
        return gaits[np.arange(len(self)), begun]

    def table(self, first: IntArray, ticks: int) -> IntArray:
        """``(B, ticks)`` the same for all ticks of an episode.

        Args:
            first: ``(B,)`` the gaits in which the robots begin.
            ticks: The number of ticks.
        """
        table = np.repeat(np.asarray(first)[:, None], ticks, axis=1)
        for robot, (elapsed, gait) in enumerate(zip(self.elapsed, self.gait, strict=True)):
            for tick, number in zip(elapsed.tolist(), gait.tolist(), strict=True):
                table[robot, max(tick, 0) :] = number
        return table

    def after(self, elapsed: IntArray) -> GaitSwitches:
        """The switches as they are for robots whose episodes go on as new ones.

        Args:
            elapsed: ``(B,)`` the tick at which each of them goes on.
        """
        later = np.where(self.elapsed < NEVER, self.elapsed - elapsed[:, None], NEVER)
        return GaitSwitches(later, self.gait)


def join_switches(parts: Sequence[GaitSwitches]) -> GaitSwitches:
    """The switches of the robots of at least one part, one part after another."""
    most = max(part.elapsed.shape[1] for part in parts)
    rows = [(0, 0), (0, 0)]
    elapsed = []
    gait = []
    for part in parts:
        rows[1] = (0, most - part.elapsed.shape[1])
        elapsed.append(np.pad(part.elapsed, rows, constant_values=NEVER))
        gait.append(np.pad(part.gait, rows))
    return GaitSwitches(np.concatenate(elapsed), np.concatenate(gait))


def next_cycle(gait: Gait, tick: int) -> int:
    """The first tick of the gait clock, from one on, at which a cycle of a gait begins [ms].

    It is on the grid of plans as well, so that an expert plans there anyway.

    Args:
        gait: The gait.
        tick: The tick at which it is asked for.
    """
    cycle = grid_cycle(gait)
    return -(-tick // cycle) * cycle


def switches_at(
    gaits: Sequence[Gait], begun: IntArray, asked: IntArray, chosen: IntArray
) -> GaitSwitches:
    """Switches of gait that are asked for at some ticks, each where the new cycle begins.

    Args:
        gaits: The gaits, by their numbers.
        begun: ``(B,)`` the gait clocks at which the episodes begin [ms].
        asked: ``(B, n)`` the ticks of the episode at which a gait is asked for [ms], in each row in
            the order of time.
        chosen: ``(B, n)`` the numbers of these gaits.
    """
    elapsed = np.empty(np.shape(asked), dtype=np.int64)
    for place, tick in np.ndenumerate(asked):
        robot, number = place
        clock = int(begun[robot])
        # A gait that is asked for later does not begin before an earlier one.
        before = 0 if number == 0 else int(elapsed[robot, number - 1])
        gait = gaits[int(chosen[place])]
        elapsed[place] = next_cycle(gait, clock + max(int(tick), before)) - clock
    return GaitSwitches(elapsed, np.array(chosen, dtype=np.int64))


def draw_switches(
    gaits: Sequence[Gait],
    begun: IntArray,
    first: IntArray,
    count: int,
    duration: float,
    seeds: tuple[int, IntArray],
) -> GaitSwitches | None:
    """Switches at random times, each to any other gait; fixed by the seed and the episodes' ids.

    Args:
        gaits: The gaits, by their numbers.
        begun: ``(B,)`` the gait clocks at which the episodes begin [ms].
        first: ``(B,)`` the gaits in which they begin.
        count: How often each robot is asked to change its gait.
        duration: The time in which it is [s]; each switch has an equal part of it to itself.
        seeds: Root of the randomness, and ``(B,)`` ids of the episodes.

    Returns:
        The switches; None if there are none, or one gait alone.
    """
    if len(gaits) < 2 or count == 0:
        return None
    seed, ids = seeds
    part = to_ticks(duration) / (count + 1)
    asked = np.empty((len(ids), count), dtype=np.int64)
    chosen = np.empty((len(ids), count), dtype=np.int64)
    for robot, id_ in enumerate(ids.tolist()):
        rng = np.random.default_rng(seed_of(seed, "gaits", id_))
        asked[robot] = part * (np.arange(count) + 0.5 + rng.random(count))
        now = int(first[robot])
        for number in range(count):
            now = (now + int(rng.integers(1, len(gaits)))) % len(gaits)
            chosen[robot, number] = now
    return switches_at(gaits, begun, asked, chosen)
