"""The initial states of robots with several gaits, prepared for each gait alone and then joined.

Each gait has its own command gains and initial states, exactly those of the gait alone, so that
runs with one gait find them again. Robots with several gaits share one table of safety bounds,
which includes those of each gait. Read `prepare` for one gait.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from surefoot.config import Config
from surefoot.config.single_gaits import each_gait
from surefoot.scenarios.starts import Starts, StartSet, join_starts, starts_of
from surefoot.types import IntArray

IDS_OF_A_GAIT = 1_000_000
"""The ids of the initial states of gait number n begin at n times this, which is more than a set in
a file of reasonable size can have."""


def gait_of(id: IntArray) -> IntArray:
    """``(n,)`` the numbers of the gaits of initial states; 0 for those that belong to no set.

    Args:
        id: ``(n,)`` ids of initial states, as `AllStarts` gives them.
    """
    return np.maximum(id, 0) // IDS_OF_A_GAIT


def of_gait(starts: Starts, number: int) -> Starts:
    """Initial states of a set as those of a gait, with the ids of that gait.

    Args:
        starts: Initial states of the gait's set.
        number: The number of the gait.
    """
    if number == 0:
        return starts
    ids = np.where(starts.id >= 0, starts.id + number * IDS_OF_A_GAIT, starts.id)
    return replace(starts, id=ids, gait=np.full(len(starts), number))


@dataclass(frozen=True)
class AllStarts:
    """The initial states of all gaits of a configuration: one set for each of them.

    Attributes:
        sets: The sets, by the numbers of the gaits.
    """

    sets: tuple[StartSet, ...]

    @property
    def name(self) -> str:
        """The names of all sets."""
        return ", ".join(stored.name for stored in self.sets)

    @cached_property
    def hash(self) -> str:
        """The hash of the only set, or a hash over the hashes of several sets."""
        if len(self.sets) == 1:
            return self.sets[0].hash
        return hashlib.sha256(" ".join(stored.hash for stored in self.sets).encode()).hexdigest()

    @property
    def seed(self) -> int:
        """Root seed of the disturbances in evaluations on these sets, as `StartSet.seed`."""
        return int(self.hash[:8], 16)

    def first(self, split: str, n: int) -> Starts:
        """The first n initial states of a split of each gait, gait by gait.

        Raises:
            KeyError: There is no such split.
            ValueError: It holds fewer, or n is not positive.
        """
        return self.join([stored.first(split, n) for stored in self.sets])

    def join(self, parts: Sequence[Starts]) -> Starts:
        """The initial states of all gaits in one, gait by gait.

        Args:
            parts: Initial states of each of the sets, in the order of the gaits' numbers.
        """
        return join_starts([of_gait(part, number) for number, part in enumerate(parts)])

    def phases(self, id: IntArray) -> IntArray:
        """``(n,)`` numbers that differ for each phase and gait; -1 for those of no set.

        They are the indices of `StartSet.phases`, shifted from gait to gait.
        """
        gait = gait_of(id)
        phases = np.full(len(id), -1)
        first = 0
        for number, stored in enumerate(self.sets):
            mine = gait == number
            phase = stored.phases(id[mine] - number * IDS_OF_A_GAIT)
            phases[mine] = np.where(phase >= 0, phase + first, -1)
            first += max(phases_of for _, phases_of, _ in stored.shape.values())
        return phases


def all_starts_of(config: Config) -> AllStarts:
    """The initial states of all gaits of a configuration.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: A set is missing, or belongs to another robot or gait (`starts.starts_of`).
    """
    return AllStarts(tuple(starts_of(one) for one in each_gait(config)))
