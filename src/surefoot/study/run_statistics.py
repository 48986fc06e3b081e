"""The run as the unit: means over runs, differences of two sets of runs, tests, and Holm's method.

Each run contributes one value; its rollouts only show how well that value is known. A mean over
runs has a t interval, a difference of means has Welch's interval, and a difference of two sets of
runs is tested by exchanging the runs in all possible ways (an exact permutation test). Shares of
rollouts have the same intervals, never narrower than the score interval of all rollouts together,
because a few runs may agree by chance. `evaluation.statistics` has the equations. Read `claims` for
how an interval leads to a verdict.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.stats import permutation_test
from scipy.stats import t as student_t

from surefoot.evaluation.statistics import (
    SEED,
    Interval,
    RunMeans,
    effective_rollouts,
    mean_interval,
    mean_share_interval,
    unpaired_difference,
)

EXCHANGES = 200_000
"""Exchanges of runs that a permutation test tries: all of them if there are no more than this (10
against 10 runs have 184,756), and otherwise this many at random."""


@dataclass(frozen=True)
class Runs:
    """What was measured for each run.

    Attributes:
        values: ``(R,)`` the value of each run. A share is a number from 0 to 1.
        rollouts: ``(R,)`` for a share, the number of rollouts of each run; None for other values.
        seeds: ``(R,)`` the seed of each run, if two measurements of the same runs are compared.
    """

    values: tuple[float, ...]
    rollouts: tuple[int, ...] | None = None
    seeds: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Check that all values are finite, and that shares are between 0 and 1 and have rollouts.

        Raises:
            ValueError: There is no run, a value is not finite, a share is not between 0 and 1, or
                the numbers of rollouts do not fit the runs.
        """
        if not self.values or not np.isfinite(self.values).all():
            raise ValueError(f"values of runs {self.values}; give at least one, all of them finite")
        if self.rollouts is None:
            return
        if len(self.rollouts) != len(self.values) or min(self.rollouts) < 1:
            raise ValueError(
                f"{self.rollouts} rollouts of {len(self.values)} runs; give one number for each, "
                "all at least 1"
            )
        if min(self.values) < 0.0 or max(self.values) > 1.0:
            raise ValueError(f"shares {self.values}; use numbers from 0 to 1")


@dataclass(frozen=True)
class RunDifference:
    """Mean of one set of runs minus the mean of another.

    Attributes:
        difference: The difference of the means, in the unit of the values.
        interval: Its 95 % interval over runs; None where nothing shows how much runs differ.
        a: The first set's mean.
        b: The second set's mean, which is subtracted.
    """

    difference: float
    interval: Interval | None
    a: RunMeans
    b: RunMeans


def mean_of_runs(runs: Runs) -> RunMeans:
    """Mean over runs with its 95 % t interval; each run has the same weight.

    The interval of a share is never narrower than the score interval of all rollouts together,
    which is what remains if all runs are at 0 or at 100 %. It then assumes that runs differ no more
    than their rollouts do by chance (`run_interval`).
    """
    if runs.rollouts is None:
        interval = mean_interval(runs.values)
    else:
        interval = mean_share_interval(runs.values, runs.rollouts)
    return RunMeans(float(np.mean(runs.values)), interval, runs.values)


def difference_of_runs(a: Runs, b: Runs) -> RunDifference:
    """Mean of one set of runs minus that of another set, with Welch's 95 % t interval.

    The interval of a difference of shares is never narrower than Newcombe's of all rollouts
    together. There is none if a set has a single run, or if the values are not shares and neither
    set has any spread.

    Args:
        a: The first set of runs.
        b: The second one, which is subtracted; no run belongs to both.
    """
    mean_a = mean_of_runs(a)
    mean_b = mean_of_runs(b)
    interval = None
    if min(len(a.values), len(b.values)) > 1:
        interval = _welch_interval(np.asarray(a.values), np.asarray(b.values))
        interval = _no_narrower_than_rollouts(interval, a, b)
    return RunDifference(mean_a.mean - mean_b.mean, interval, mean_a, mean_b)


def _welch_interval(a: NDArray[np.float64], b: NDArray[np.float64]) -> Interval | None:
    """Welch's 95 % t interval of a difference of means; None if neither set has any spread.

    SciPy's `ttest_ind` gives the same, but warns where one of the sets has no spread.
    """
    if np.ptp(a) == 0.0 and np.ptp(b) == 0.0:
        return None
    of_a = a.var(ddof=1) / len(a)
    of_b = b.var(ddof=1) / len(b)
    # Degrees of freedom by Welch and Satterthwaite.
    freedom = (of_a + of_b) ** 2 / (of_a**2 / (len(a) - 1) + of_b**2 / (len(b) - 1))
    half = float(student_t.ppf(0.975, freedom) * np.sqrt(of_a + of_b))
    difference = float(a.mean() - b.mean())
    return difference - half, difference + half


def change_in_runs(after: Runs, before: Runs) -> RunDifference:
    """Mean change from one measurement of some runs to another one of the same runs.

    Its interval is the t interval of the runs' changes; for shares, it is never narrower than
    Newcombe's interval of all rollouts together.

    Args:
        after: The later measurement.
        before: The earlier measurement of the same runs in the same order (`of_both`), which is
            subtracted.

    Raises:
        ValueError: These are not the same runs.
    """
    if after.seeds != before.seeds or len(after.values) != len(before.values):
        raise ValueError(f"runs of the seeds {after.seeds} and {before.seeds}; give the same ones")
    changes = np.subtract(after.values, before.values)
    interval = mean_interval(changes)
    if len(changes) > 1:
        interval = _no_narrower_than_rollouts(interval, after, before)
    return RunDifference(float(changes.mean()), interval, mean_of_runs(after), mean_of_runs(before))


def of_both(after: Runs, before: Runs) -> tuple[Runs, Runs] | None:
    """The runs that two measurements have in common, in the same order; None if there is none.

    A run may lack one of the two: a budget, for example, may leave an iteration without rollouts.

    Args:
        after: One measurement, with the seeds of its runs.
        before: The other one.
    """
    if after.seeds == before.seeds:
        return after, before
    common = [seed for seed in after.seeds if seed in before.seeds]
    if not common:
        return None
    return _only(after, common), _only(before, common)


def _only(runs: Runs, seeds: list[int]) -> Runs:
    """The runs of some seeds, in their order."""
    places = [runs.seeds.index(seed) for seed in seeds]
    values = tuple(runs.values[place] for place in places)
    rollouts = runs.rollouts and tuple(runs.rollouts[place] for place in places)
    return Runs(values, rollouts, tuple(seeds))


def _no_narrower_than_rollouts(interval: Interval | None, a: Runs, b: Runs) -> Interval | None:
    """The interval of a difference; for shares, at least as wide as their rollouts' interval."""
    if a.rollouts is None or b.rollouts is None:
        return interval
    low, high = unpaired_difference(
        float(np.mean(a.values)),
        effective_rollouts(a.rollouts),
        float(np.mean(b.values)),
        effective_rollouts(b.rollouts),
    )
    if interval is None:
        return low, high
    return max(min(interval[0], low), -1.0), min(max(interval[1], high), 1.0)


def permutation_p(a: Sequence[float], b: Sequence[float]) -> float:
    """The p-value of the difference of two sets of runs, by a two-sided permutation test.

    Under the hypothesis that the sets do not differ, every way to divide all runs into sets of
    these sizes is equally probable. The p-value is twice the share of ways whose difference of
    means is at least as extreme on the observed side, and at most 1. It is exact up to `EXCHANGES`
    ways, and otherwise estimated from that many random ones, always the same for the same runs.

    Args:
        a: The value of each run of one set, at least two.
        b: The value of each run of the other set, at least two.
    """

    def difference(
        x: NDArray[np.float64], y: NDArray[np.float64], axis: int
    ) -> NDArray[np.float64]:
        return x.mean(axis=axis) - y.mean(axis=axis)

    test = permutation_test(
        (np.asarray(a, float), np.asarray(b, float)),
        difference,
        permutation_type="independent",
        vectorized=True,
        n_resamples=EXCHANGES,
        batch=10_000,
        alternative="two-sided",
        rng=np.random.default_rng(SEED),
    )
    return float(test.pvalue)


def smallest_p(n_a: int, n_b: int) -> float:
    """The smallest p-value that `permutation_p` can give for two sets of these sizes.

    With 3 against 3 runs it is 2/20, with 5 against 5 it is 2/252.

    Args:
        n_a: Number of runs of one set, at least 1.
        n_b: Number of runs of the other, at least 1.
    """
    return min(2.0 / comb(n_a + n_b, n_a), 1.0)


def holm(p: Sequence[float | None]) -> tuple[float | None, ...]:
    """Adjust p-values so the chance of any false finding among them, at 5 %, is at most 5 %.

    Holm's method: with m comparisons the smallest p is multiplied by m, the next by m - 1, and so
    on; an adjusted value is at least the one before it, and at most 1.

    Args:
        p: The p-value of each planned comparison; None for those not measured yet, which also count
            in m.

    Returns:
        The adjusted value of each, None for None.
    """
    adjusted: list[float | None] = [None] * len(p)
    measured = [(value, number) for number, value in enumerate(p) if value is not None]
    largest = 0.0
    for rank, (value, number) in enumerate(sorted(measured)):
        largest = max(largest, min((len(p) - rank) * value, 1.0))
        adjusted[number] = largest
    return tuple(adjusted)
