"""How long the runtime's ticks take, and how many ticks of the robot it has missed.

A histogram costs next to nothing to fill; deadlines are counted by the robot's clock. Read `loop`
next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.deploy.interfaces import Sensors

BIN = 5
"""[us] The width of a bin."""
BINS = 200_000
"""The number of bins: up to 1 s, the longest silence that a bridge may allow; the last one also has
all that took longer."""


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
            microseconds: The time [us]; a negative one counts as zero.
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


class TickClock:
    """Counts the unseen ticks, those without a measurement, by the times of the measurements.

    Ticks are numbered by their time since the first one, so that jitter does not accumulate.

    Args:
        period_ns: The time from one tick to the next [ns].
    """

    def __init__(self, period_ns: float) -> None:
        self._period_ns = period_ns
        self._first_ns: int | None = None
        self._due = 1  # the number of the next tick

    def unseen(self, time_ns: int) -> int:
        """How many ticks were unseen between the last measurement and this one.

        Args:
            time_ns: The time of this measurement [ns].
        """
        if self._first_ns is None:
            self._first_ns = time_ns
            return 0
        number = round((time_ns - self._first_ns) / self._period_ns)
        unseen = max(number - self._due, 0)
        # After a late tick, one tick may seem early. No more than one: otherwise a clock that runs
        # fast would hide unseen ticks.
        self._due = min(max(number, self._due) + 1, number + 2)
        return unseen


class Deadlines:
    """Counts the missed ticks of the robot, without a command of their own, by the robot's clock.

    A command that is written again because no new measurement has come keeps the bridge alive, but
    the unseen tick is missed all the same.

    Args:
        rate_hz: The number of ticks in a second [Hz].

    Attributes:
        missed: How many ticks were missed.
        passed: How many ticks have passed, from that of the first measurement on.
        in_a_row: How many ticks were missed in a row until now.
        behind: How many more ticks were missed than had a command in time, since it was last zero.
        back_ns: By how much the robot's clock went back between the last two measurements [ns].
        unseen: How many ticks had no measurement between the last two measurements.
        steady: Whether no tick was unseen between the last two measurements.
        late_work: Whether the command for the last measurement took longer than a tick.
    """

    def __init__(self, rate_hz: int) -> None:
        self.missed = 0
        self.passed = 0
        self.in_a_row = 0
        self.behind = 0
        self.back_ns = 0
        self.unseen = 0
        self.steady = False
        self.late_work = False
        self._period_ns = 1e9 / rate_hz
        self._clock = TickClock(self._period_ns)
        self._last: Sensors | None = None

    def is_new(self, sensors: Sensors) -> bool:
        """Whether a measurement is not the last one again.

        Args:
            sensors: The measurement.
        """
        return self._last is None or sensors.sequence != self._last.sequence

    def see(self, sensors: Sensors) -> None:
        """Take a measurement; this counts no missed ticks, which `count` does.

        Args:
            sensors: The measurement.
        """
        since = sensors.time_ns - (0 if self._last is None else self._last.time_ns)
        self.back_ns = 0 if self._last is None else max(-since, 0)
        self.steady = self._last is not None and since < 1.5 * self._period_ns
        self.unseen = 0
        if self.is_new(sensors):
            self.unseen = self._clock.unseen(sensors.time_ns)
            self.passed += 1 + self.unseen
        self._last = sensors

    def wait(self) -> None:
        """Note that no new measurement has come, so the last command is written again in time."""
        self.unseen = 0
        self._add(int(self.late_work))
        self.late_work = False

    def count(self) -> None:
        """Count the ticks missed before the last measurement; if there are none, a row ends."""
        self._add(max(self.unseen, int(self.late_work)))
        if not self.late_work:
            self.behind = max(self.behind - 1, 0)

    def _add(self, missed: int) -> None:
        """Add missed ticks; none of them end a row."""
        self.missed += missed
        self.behind += missed
        self.in_a_row = self.in_a_row + missed if missed else 0

    def exceeded(self, in_a_row: int, behind: int) -> str | None:
        """Why too many ticks were missed; None if they were not.

        Args:
            in_a_row: So many in a row are too many.
            behind: So many more than had a command in time are too many.
        """
        if self.in_a_row >= in_a_row:
            return f"{self.in_a_row} ticks in a row had no command in time; {in_a_row} are a fault"
        if self.behind >= behind:
            return f"{self.behind} more ticks were missed than had a command in time"
        return None

    def worked(self, nanoseconds: int) -> None:
        """Note how long a command took.

        Args:
            nanoseconds: From the measurement to the written command [ns].
        """
        self.late_work = nanoseconds > self._period_ns

    def begin(self) -> None:
        """Begin to count missed ticks in a row."""
        self.in_a_row = 0
        self.behind = 0
        self.late_work = False
