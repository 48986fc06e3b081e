"""Numbers that know where they are stored, and what several runs say together.

Each number on a page names its source: a place in a file of the study, such as
``loco_safe_dagger/seed-0/metrics.jsonl#/3/falls`` (a file, and a JSON pointer into it), or a
formula of such places, such as ``div(A;B)`` or ``mean(A;B;C)``. Sums go over whole files:
``add(F#/collect/falls)`` is that over all lines of the stage `collect`, ``add(F#/*/seconds)`` that
over all lines that have the field, and a file's name may hold ``*`` and ``**``. So a reader, and a
test, can check the page against the files. The run is the unit: intervals are taken over runs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from surefoot.evaluation.statistics import Interval
from surefoot.study.run_statistics import Runs, mean_of_runs


@dataclass(frozen=True)
class Number:
    """A number of a report.

    Attributes:
        value: The number, in the unit in which it is stored; NaN where it has not been measured.
        source: Where it is stored, or how it follows from what is stored.
        trials: Number of trials, if the number is the share of these that had an outcome; 0 if it
            is a share of something else, such as of a time; None if it is not a share.
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
    """What several runs say together.

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
    """A number that stands in a file of a study.

    Args:
        value: The number; None where the file has null.
        file: The file, relative to the folder of the study.
        keys: Keys and positions that lead to the number in the file; the first one of a
            ``.jsonl`` file is the position of the line, from 0 on.
    """
    pointer = "".join(f"/{key}" for key in keys)
    return Number(math.nan if value is None else float(value), f"{file}#{pointer}")


def stored_share(value: float | None, file: str, *keys: str | int) -> Number:
    """A share that stands in a file, and is not one of trials; arguments as of `stored`."""
    return replace(stored(value, file, *keys), trials=0)


def share(part: Number, whole: Number) -> Number:
    """The share of trials that had an outcome; not known without any trial."""
    source = f"div({part.source};{whole.source})"
    if not whole.is_known or whole.value == 0.0:
        return Number(math.nan, source)
    return Number(part.value / whole.value, source, int(whole.value))


def total(numbers: Sequence[Number], source: str = "") -> Number:
    """The sum of some numbers.

    Args:
        numbers: The numbers.
        source: All their places in short; without it, their sources one by one.
    """
    source = source or ";".join(number.source for number in numbers)
    return Number(math.fsum(number.value for number in numbers), f"add({source})")


def rate(count: Number, seconds: Number) -> Number:
    """A count for each second; not known in no time at all."""
    known = seconds.value > 0.0
    value = count.value / seconds.value if known else math.nan
    return Number(value, f"div({count.source};{seconds.source})")


def difference(a: Number, b: Number) -> Number:
    """The number a without the number b."""
    return Number(a.value - b.value, f"sub({a.source};{b.source})")


def over_trainings(numbers: Sequence[Number]) -> Number:
    """The mean of the trainings of one seed, which together are one run.

    Args:
        numbers: The number of each training, at least one, in the same unit. Shares of trials have
            the trials of one of them, as all are tried from the same initial states.
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
    """The 95 % interval of a mean over runs (`run_statistics.mean_of_runs`); shares end at 0 and 1.

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
