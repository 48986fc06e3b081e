"""How long the runtime's ticks take: a histogram that costs nothing to fill. Read `loop` next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BIN = 5
"""[us] The width of a bin."""
BINS = 4000
"""The number of bins: up to 20 ms; the last one holds all that took longer."""


@dataclass(frozen=True)
class Times:
    """A distribution of times.

    Attributes:
        count: The number of times.
        median: The median [us].
        p99: The 99th percentile [us].
        p999: The 99.9th percentile [us].
        longest: The longest [us].
    """

    count: int
    median: float
    p99: float
    p999: float
    longest: float


class Histogram:
    """Counts times in bins of 5 us."""

    def __init__(self) -> None:
        self.counts = [0] * BINS
        self.longest = 0.0

    def add(self, microseconds: float) -> None:
        """Count a time.

        Args:
            microseconds: The time [us]; one that is negative counts as none.
        """
        self.counts[min(max(int(microseconds) // BIN, 0), BINS - 1)] += 1
        self.longest = max(self.longest, microseconds)

    @property
    def times(self) -> Times:
        """The distribution; each quantile is the upper end of its bin, and at most the longest."""
        total = np.cumsum(self.counts)
        count = int(total[-1])

        def quantile(share: float) -> float:
            upper = float(BIN * (1 + int(np.searchsorted(total, share * count))))
            return min(upper, self.longest) if count else 0.0

        return Times(count, quantile(0.5), quantile(0.99), quantile(0.999), self.longest)
