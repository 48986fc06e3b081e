"""When robots change their gait in an episode on command, and to which one.

A gait is commanded just as a velocity is. All gaits share one clock, that of the episode, and each
derives its phase from it by its own period: nothing is carried over, and a controller depends on
state, clock and command alone. A gait may be commanded at any time; a robot begins it where one of
its cycles begins (`gait_clock.switch_tick`). When gaits began at any node of the grid of plans,
robots fell if they entered a pronk that was about to take off. Read `rollouts.engine` next, which
commands the gaits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config, Gait
from surefoot.config.gait_clock import switch_tick
from surefoot.scenarios.seeds import seed_of
from surefoot.scenarios.starts import Starts
from surefoot.types import IntArray, to_ticks

NEVER = 2**31
"""[ms] Padding for robots with fewer switches than the others."""


@dataclass(frozen=True)
class GaitSwitches:
    """The gait switches of B robots, at most n for each.

    Attributes:
        elapsed: ``(B, n)`` the tick of the episode at which each gait begins [ms], in order of time
            in each row; a row is padded with `NEVER`.
        gait: ``(B, n)`` the number of that gait.

    Raises:
        ValueError: The two do not have the same shape, a row is not in order of time, or the number
            of a gait is negative.
    """

    elapsed: IntArray
    gait: IntArray

    def __post_init__(self) -> None:
        """Check both arrays, and convert them to one type."""
        if np.ndim(self.elapsed) != 2 or np.shape(self.elapsed) != np.shape(self.gait):
            raise ValueError(
                f"gaits {np.shape(self.gait)} from the ticks {np.shape(self.elapsed)} on; give "
                "both for each robot and switch"
            )
        for name in ("elapsed", "gait"):
            values = np.asarray(getattr(self, name))
            if values.size and values.dtype.kind not in "iu":
                raise ValueError(f"switches of gait: {name} is {values.dtype}; use whole numbers")
            object.__setattr__(self, name, values.astype(np.int64, copy=False))
        if (np.diff(self.elapsed, axis=1) < 0).any():
            raise ValueError("switches of gait that are not in the order of time; sort each row")
        if (self.gait < 0).any():
            raise ValueError(f"a switch to gait number {self.gait.min()}; use 0 or more")

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

    def after(self, elapsed: IntArray) -> GaitSwitches:
        """The switches of new episodes that branch off from these.

        Args:
            elapsed: ``(B,)`` the tick of its episode at which each robot branches off.
        """
        later = np.where(self.elapsed < NEVER, self.elapsed - elapsed[:, None], NEVER)
        return GaitSwitches(later, self.gait)


def gaits_by_tick(first: IntArray, switches: GaitSwitches | None, ticks: int) -> IntArray:
    """``(B, ticks)`` the number of the gait that each robot is to walk, tick by tick.

    Args:
        first: ``(B,)`` the gaits in which the robots begin.
        switches: When they change their gait; None if none does.
        ticks: The number of ticks.
    """
    table = np.repeat(first[:, None], ticks, axis=1)
    if switches is None:
        return table
    for robot, (elapsed, gait) in enumerate(zip(switches.elapsed, switches.gait, strict=True)):
        for tick, number in zip(elapsed.tolist(), gait.tolist(), strict=True):
            table[robot, max(tick, 0) :] = number
    return table


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


def switches_at(
    gaits: Sequence[Gait], starts: Starts, asked: IntArray, chosen: IntArray
) -> GaitSwitches:
    """Gait switches that are commanded at some ticks; each happens at its `switch_tick`.

    Args:
        gaits: The gaits, by their numbers.
        starts: The B initial states, with their clocks and gaits.
        asked: ``(B, n)`` the ticks of the episode at which a gait is commanded [ms], in order of
            time in each row.
        chosen: ``(B, n)`` the numbers of these gaits.
    """
    elapsed = np.empty(np.shape(asked), dtype=np.int64)
    for robot, (ticks, numbers) in enumerate(zip(asked, chosen, strict=True)):
        clock = int(starts.tick[robot])
        old = gaits[int(starts.gait[robot])]
        before = clock
        for switch, (tick, number) in enumerate(zip(ticks.tolist(), numbers.tolist(), strict=True)):
            new = gaits[number]
            # A gait that is commanded later does not begin before an earlier one.
            before = switch_tick(old, new, max(clock + tick, before))
            elapsed[robot, switch] = before - clock
            old = new
    return GaitSwitches(elapsed, np.array(chosen, dtype=np.int64))


def draw_switches(
    config: Config, starts: Starts, duration: float, ids: IntArray
) -> GaitSwitches | None:
    """The gait switches of episodes at random times, from each gait to any other one.

    They are fixed by the root seed and the ids of the episodes. On average, each gait gets an equal
    part of the time.

    Args:
        config: The gaits, how often robots change them, and the root seed.
        starts: The B initial states.
        duration: The time in which a gait may be commanded [s].
        ids: ``(B,)`` ids of the episodes.

    Returns:
        The switches; None if there are none, or only one gait.
    """
    count = config.switches
    gaits = config.gaits
    if len(gaits) < 2 or count == 0:
        return None
    part = to_ticks(duration) / (count + 1)
    asked = np.empty((len(ids), count), dtype=np.int64)
    chosen = np.empty((len(ids), count), dtype=np.int64)
    for robot, id_ in enumerate(ids.tolist()):
        rng = np.random.default_rng(seed_of(config.seed, "gaits", id_))
        asked[robot] = part * (np.arange(count) + 0.5 + rng.random(count))
        now = int(starts.gait[robot])
        for number in range(count):
            now = (now + int(rng.integers(1, len(gaits)))) % len(gaits)
            chosen[robot, number] = now
    return switches_at(gaits, starts, asked, chosen)


def in_turn(
    config: Config, starts: Starts, numbers: Sequence[int], seconds: float
) -> tuple[Starts, GaitSwitches]:
    """Initial states and switches of robots that walk some gaits one after another.

    Each gait gets an equal part of the time.

    Args:
        config: The gaits.
        starts: The B initial states.
        numbers: The numbers of the gaits, in the order in which they are to be walked.
        seconds: The duration of the episodes [s].
    """
    first, *rest = numbers
    B = len(starts)
    starts = replace(starts, gait=np.full(B, first))
    part = to_ticks(seconds) / len(numbers)
    asked = np.tile(np.arange(1, len(numbers)) * part, (B, 1)).astype(np.int64)
    chosen = np.tile(np.array(rest, dtype=np.int64), (B, 1))
    return starts, switches_at(config.gaits, starts, asked, chosen)
