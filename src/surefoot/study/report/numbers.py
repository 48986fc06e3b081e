"""Numbers together with the place where they are stored, and means over several runs.

Each number on a page names its source: a place in a file of the study, such as
``loco_safe_dagger/seed-0/metrics.jsonl#/3/falls`` (a file, and a JSON pointer into it), or a
formula of such places, such as ``div(A;B)`` or ``mean(A;B;C)``. Sums run over whole files:
``add(F#/collect/falls)`` is the sum over all lines of the stage `collect`, ``add(F#/*/seconds)``
the sum over all lines that have the field, and a file's name may contain ``*`` and ``**``. This
lets a reader, and a test, check the page against the files. The run is the unit: intervals are
taken over runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.evaluation.statistics import Interval
from surefoot.study.run_statistics import Runs, mean_of_runs


@dataclass(frozen=True)
class Number:
    """A number of a report.

    Attributes:
        value: The number, in the unit in which it is stored; NaN where it has not been measured.
        source: Where it is stored, or how it follows from what is stored.
        trials: Number of trials, if the number is the share of trials with an outcome; 0 if it is a
            share of something else, such as time; None if it is not a share.
    """

    value: float
    source: str
    trials: int | None = None

    @property
    def is_known(self) -> bool:
        """Whether it has been measured."""
        return math.isfinite(self.value)


@dataclass(frozen=True)
class Estimate:
    """A mean over several runs, with its interval.

    Attributes:
        mean: Mean over the runs that have a number.
        low: Lower end of the mean's interval over runs; None where there is no interval.
        high: Upper end of that interval.
        runs: Number of runs that have a number.
    """

    mean: Number
    low: Number | None
    high: Number | None
    runs: int


def stored(value: float | None, file: str, *keys: str | int) -> Number:
    """A number stored in a file of a study.

    Args:
        value: The number; None where the file has null.
        file: The file, relative to the folder of the study.
        keys: Keys and positions that lead to the number in the file; in a ``.jsonl`` file, the
            first one is the position of the line, from 0.
    """
    pointer = "".join(f"/{key}" for key in keys)
    return Number(math.nan if value is None else float(value), f"{file}#{pointer}")


def share(part: Number, whole: Number) -> Number:
    """The share of trials with an outcome; unknown without any trial."""
    source = f"div({part.source};{whole.source})"
    if not whole.is_known or whole.value == 0.0:
        return Number(math.nan, source)
    return Number(part.value / whole.value, source, int(whole.value))


def total(numbers: Sequence[Number], source: str = "") -> Number:
    """The sum of some numbers.

    Args:
        numbers: The numbers.
        source: A short form of all their places; without it, each of their sources is listed.
    """
    source = source or ";".join(number.source for number in numbers)
    return Number(math.fsum(number.value for number in numbers), f"add({source})")


def rate(count: Number, seconds: Number) -> Number:
    """A count per second; unknown if the time is zero."""
    known = seconds.value > 0.0
    value = count.value / seconds.value if known else math.nan
    return Number(value, f"div({count.source};{seconds.source})")


def difference(a: Number, b: Number) -> Number:
    """The number a minus the number b."""
    return Number(a.value - b.value, f"sub({a.source};{b.source})")


def over_trainings(numbers: Sequence[Number]) -> Number:
    """The mean of the trainings of one seed, which together are one run.

    Args:
        numbers: The number of each training, at least one, in the same unit. A mean of shares has
            the trials of only one training, as all are tried from the same initial states.
    """
    known = [number for number in numbers if number.is_known]
    if len(known) < 2:
        return known[0] if known else numbers[0]
    value = math.fsum(number.value for number in known) / len(known)
    sources = ";".join(number.source for number in known)
    counts = [number.trials for number in known if number.trials is not None]
    return Number(value, f"mean({sources})", min(counts) if len(counts) == len(known) else None)


def over_runs(numbers: Sequence[Number]) -> Estimate | None:
    """The mean over runs, with its interval; None if no run has a number.

    Args:
        numbers: The number of each run, in the same unit.
    """
    known = [number for number in numbers if number.is_known]
    if not known:
        return None
    values = [number.value for number in known]
    sources = ";".join(number.source for number in known)
    mean = Number(float(np.mean(values)), f"mean({sources})")
    interval = interval_over_runs(values, [number.trials for number in known])
    if interval is None:
        return Estimate(mean, None, None, len(known))
    low = Number(interval[0], f"low({sources})")
    high = Number(interval[1], f"high({sources})")
    return Estimate(mean, low, high, len(known))


def interval_over_runs(values: Sequence[float], trials: Sequence[int | None]) -> Interval | None:
    """The 95 % interval of a mean over runs (`run_statistics.mean_of_runs`); shares stay in 0 to 1.

    Args:
        values: The value of each run.
        trials: Number of trials of each run, as in `Number`.

    Returns:
        Both ends; None for a single run, and where nothing shows the spread.
    """
    counts = [count for count in trials if count is not None]
    if len(counts) == len(values) and min(counts) > 0:
        return mean_of_runs(Runs(tuple(values), tuple(counts))).interval
    interval = mean_of_runs(Runs(tuple(values))).interval
    if interval is None or len(counts) < len(values):
        return interval
    return max(interval[0], 0.0), min(interval[1], 1.0)
