"""Statistics of results: 95 % intervals, paired differences, and the run as the unit.

A share of one policy has a Wilson interval, and a difference of shares on the same initial states
has Newcombe's score interval for pairs. Other outcomes are resampled in a bootstrap (`resamples`),
which would claim certainty of a sample without spread, so that such a sample has no interval. The
mean over several trainings has a t interval over run means (`run_interval`), and
`study.run_statistics` has differences of two sets of runs. All draws come from a fixed seed, so the
same data give the same interval. This module does not depend on robots. Next: `robustness`, `push`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.errors import shown

RESAMPLES = 2000
"""Number of draws of a bootstrap."""
SEED = 0
"""Seed of all draws."""
Z = 1.959963984540054
"""The middle 95 % of a normal distribution lie within this many standard deviations. It is
`scipy.stats.norm.ppf(0.975)`, which takes most of a second to load."""

Interval = tuple[float, float]
"""Lower and upper end of a 95 % interval, in the unit of its estimate."""


@dataclass(frozen=True)
class PairedDifference:
    """Mean of one arm minus the mean of another, on the same initial states.

    Attributes:
        difference: Mean of the differences, in the unit of the outcomes.
        interval: The difference's 95 % interval over initial states: Newcombe's score interval for
            outcomes of 0 and 1, otherwise a percentile bootstrap interval; None for a single pair,
            and for other outcomes whose differences are all equal and show no spread.
        pairs: Number of initial states with an outcome in both arms.
    """

    difference: float
    interval: Interval | None
    pairs: int


@dataclass(frozen=True)
class RunMeans:
    """Mean over training runs, with the mean of each.

    Attributes:
        mean: Mean of the runs' means, in the unit of the outcomes.
        interval: The mean's 95 % interval over runs, from `run_interval`; None for a single run,
            and if the outcomes show no spread.
        runs: Mean of each run, in the order in which the runs were given.
    """

    mean: float
    interval: Interval | None
    runs: tuple[float, ...]


def wilson(successes: float, n: float) -> Interval:
    """Wilson's 95 % score interval of a share.

    The numbers may be fractions, when dependent trials count as fewer independent ones; SciPy's
    ``binomtest`` has the same formula, but only for whole numbers.

    Args:
        successes: Number of successes, from 0 to n.
        n: Number of trials, more than 0.
    """
    share = successes / n
    center = (2 * n * share + Z**2) / (2 * (n + Z**2))
    half = Z / (2 * (n + Z**2)) * np.sqrt(4 * n * share * (1 - share) + Z**2)
    # If all trials agree, an end is exactly 0 or 1, without rounding errors.
    low = 0.0 if successes == 0 else float(center - half)
    high = 1.0 if successes == n else float(center + half)
    return low, high


def newcombe(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> Interval:
    """Newcombe's 95 % score interval of a difference of shares, for paired outcomes.

    The square-and-add interval from Wilson's two intervals, with the correlation of the pairs
    (Newcombe, Statistics in Medicine 17, 1998, method 10).

    Args:
        a: ``(n,)`` outcomes of one arm, n at least 1.
        b: ``(n,)`` outcomes of the other arm, which is subtracted, in the same order.
    """
    n = len(a)
    both = int((a & b).sum())
    neither = int((~a & ~b).sum())
    share_a = a.mean()
    share_b = b.mean()
    low_a, high_a = wilson(int(a.sum()), n)
    low_b, high_b = wilson(int(b.sum()), n)
    only_a = int(a.sum()) - both
    only_b = int(b.sum()) - both
    agreement = both * neither - only_a * only_b
    if agreement > 0:
        agreement = max(agreement - n / 2, 0.0)  # Newcombe's continuity correction
    margins = float(a.sum()) * float((~a).sum()) * float(b.sum()) * float((~b).sum())
    phi = agreement / np.sqrt(margins) if margins > 0 else 0.0
    below = _square_and_add(share_a - low_a, high_b - share_b, phi)
    above = _square_and_add(high_a - share_a, share_b - low_b, phi)
    difference = float(share_a - share_b)
    return max(difference - below, -1.0), min(difference + above, 1.0)


def _square_and_add(of_a: float, of_b: float, phi: float) -> float:
    """Distance of an interval's end from its estimate, given those distances of two shares."""
    return float(np.sqrt(max(of_a**2 - 2.0 * phi * of_a * of_b + of_b**2, 0.0)))


def resamples(n: int) -> NDArray[np.int64]:
    """Draw n initial states with replacement, many times.

    The same n gives the same draws, so that two results stay paired.

    Args:
        n: Number of initial states, at least 1.

    Returns:
        ``(RESAMPLES, n)`` how often each of them is drawn in each resample; every row sums to n.

    Raises:
        ValueError: n is less than 1.
    """
    if n < 1:
        raise ValueError(f"a bootstrap over {n} starts; use at least 1")
    return np.random.default_rng(SEED).multinomial(n, np.full(n, 1 / n), size=RESAMPLES)


def percentiles(values: NDArray[np.float64]) -> Interval:
    """The interval in which the middle 95 % of resampled values lie.

    Args:
        values: ``(n,)`` resampled estimates.
    """
    low, high = np.percentile(values, [2.5, 97.5]).tolist()
    return low, high


def paired_difference(a: ArrayLike, b: ArrayLike) -> PairedDifference:
    """Mean of a minus mean of b, two arms on the same initial states.

    Args:
        a: ``(n,)`` an outcome of each initial state, such as success as 0 and 1; NaN where it is
            missing.
        b: ``(n,)`` the other arm's outcomes of the same initial states in the same order.

    Raises:
        ValueError: The shapes are not ``(n,)`` twice, or no initial state has both outcomes.
    """
    a = np.asarray(a, float)
    b = np.asarray(b, float)
    if a.ndim != 1 or a.shape != b.shape:
        raise ValueError(
            f"outcomes {a.shape} and {b.shape}; give one number per start, in both arms"
        )
    has_both = ~np.isnan(a - b)
    if not has_both.any():
        raise ValueError(f"of {len(a)} starts none has an outcome in both arms")
    return PairedDifference(
        difference=float((a - b)[has_both].mean()),
        interval=_paired_interval(a[has_both], b[has_both]),
        pairs=int(has_both.sum()),
    )


def _paired_interval(a: NDArray[np.float64], b: NDArray[np.float64]) -> Interval | None:
    """The interval of a mean difference of pairs, as `PairedDifference` explains."""
    n = len(a)
    if n == 1:
        return None
    if _are_binary(a) and _are_binary(b):
        return newcombe(a == 1.0, b == 1.0)
    differences = a - b
    if np.ptp(differences) == 0.0:
        return None
    return percentiles(resamples(n) @ differences / n)


def _are_binary(outcomes: NDArray[np.float64]) -> bool:
    """Whether all outcomes are 0 or 1."""
    return bool(((outcomes == 0.0) | (outcomes == 1.0)).all())


def check_paired(a: object, b: object, fields: Sequence[str]) -> None:
    """Check that two results can be compared in pairs: the same trials, made the same way.

    Args:
        a: The result of one policy.
        b: The result of the other.
        fields: Names of the fields that describe the trials and how they were made.

    Raises:
        ValueError: One of these fields differs.
    """
    for name in fields:
        of_a = getattr(a, name)
        of_b = getattr(b, name)
        if of_a != of_b:
            raise ValueError(
                f"results of different {name}, {shown(of_a)} and {shown(of_b)}: only episodes from "
                "the same initial states, disturbed the same way, can be compared in pairs"
            )


def run_interval(values_by_run: Sequence[ArrayLike]) -> RunMeans:
    """Mean over training runs with a t interval; every run has the same weight.

    The run is the unit: with R runs of means m_r the interval is mean(m) +- t sd(m) / sqrt(R), with
    the 97.5 % quantile t of R - 1 degrees of freedom. It is valid for few runs too, where no
    bootstrap is. If runs agree by chance, it would be too narrow, down to zero width. So for
    outcomes of 0 and 1 it is never narrower than the score interval of all rollouts together, which
    count as

        n_eff = R^2 / sum_r 1 / n_r

    independent ones, for n_r rollouts of run r: with equal n_r, all of them. This assumes that runs
    differ no more than their rollouts do by chance.

    Args:
        values_by_run: For each run ``(n,)`` an outcome of each rollout, none of them missing.

    Raises:
        ValueError: There is no run, a run without rollouts, or an outcome that is NaN.
    """
    runs = _checked_runs(values_by_run)
    means = np.array([run.mean() for run in runs])
    if all(_are_binary(run) for run in runs):
        interval = mean_share_interval(means, [len(run) for run in runs])
    else:
        interval = mean_interval(means)
    return RunMeans(float(means.mean()), interval, tuple(means.tolist()))


def mean_share_interval(shares: ArrayLike, rollouts: Sequence[int]) -> Interval | None:
    """The interval of `run_interval` for a mean over runs of shares of rollouts.

    Args:
        shares: ``(R,)`` the share of each run, from 0 to 1.
        rollouts: ``(R,)`` the number of rollouts of each run, at least 1.

    Returns:
        Both ends, within 0 and 1; None for one run.
    """
    shares = np.asarray(shares, float)
    if len(shares) == 1:
        return None
    of_means = mean_interval(shares)
    n_eff = effective_rollouts(rollouts)
    low, high = wilson(float(shares.mean()) * n_eff, n_eff)
    if of_means is not None:
        low = min(low, of_means[0])
        high = max(high, of_means[1])
    return max(low, 0.0), min(high, 1.0)


def mean_interval(values: ArrayLike) -> Interval | None:
    """The t interval of a mean of independent values, such as one of each run.

    Args:
        values: ``(R,)`` the values.

    Returns:
        mean +- t sd / sqrt(R), with the 97.5 % quantile t of R - 1 degrees of freedom; None for a
        single value, and if all are equal, because then nothing shows the spread.
    """
    from scipy.stats import sem
    from scipy.stats import t as student_t

    values = np.asarray(values, float)
    if len(values) < 2 or np.ptp(values) == 0.0:
        return None
    mean = float(values.mean())
    half = float(student_t.ppf(0.975, len(values) - 1) * sem(values))
    return mean - half, mean + half


def effective_rollouts(rollouts: Sequence[int]) -> float:
    """The number of independent rollouts that those of several runs are worth (`run_interval`).

    Args:
        rollouts: Number of rollouts of each run, all at least 1.
    """
    counts = np.asarray(rollouts, float)
    return len(counts) ** 2 / float((1 / counts).sum())


def unpaired_difference(a: float, n_a: float, b: float, n_b: float) -> Interval:
    """Newcombe's 95 % score interval of a difference of shares, for independent outcomes.

    The square-and-add interval from Wilson's two intervals (Newcombe, Statistics in Medicine 17,
    1998, method 10 for unpaired shares).

    Args:
        a: Share of one arm, from 0 to 1.
        n_a: Its effective number of trials.
        b: Share of the other arm, which is subtracted.
        n_b: Its effective number of trials.
    """
    low_a, high_a = wilson(a * n_a, n_a)
    low_b, high_b = wilson(b * n_b, n_b)
    below = _square_and_add(a - low_a, high_b - b, 0.0)
    above = _square_and_add(high_a - a, b - low_b, 0.0)
    return a - b - below, a - b + above


def _checked_runs(values_by_run: Sequence[ArrayLike]) -> list[NDArray[np.float64]]:
    """The outcomes of each run.

    Raises:
        ValueError: There is no run, a run without rollouts, or an outcome that is NaN.
    """
    runs = [np.asarray(values, float) for values in values_by_run]
    if not runs or any(run.ndim != 1 or not run.size or np.isnan(run).any() for run in runs):
        raise ValueError(
            f"{len(runs)} runs of rollouts {[run.shape for run in runs]}; give at least one run, "
            "and of each at least one rollout, none of them NaN"
        )
    return runs
