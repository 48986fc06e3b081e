"""The push limit: the impulse at which a falling curve, fitted to the survivors, meets a share.

The number of survivors need not fall from level to level; isotonic regression pools neighbors until
it does. The curve is read by linear interpolation between levels.

Its 95 % interval has the middle 95 % of the limits of resampled robots. If all robots agree, all
resamples are equal, but that is not certainty. Let S(x) be the share of robots that survive x,
falling in x, and x* the limit: S(x*) = p. The interval is no narrower than the observations allow:

- It includes the two tried levels a < b between which the curve meets n p; nothing shows where x*
  lies between them.
- A score test refutes S(x) = p if of n robots more than n p + z sqrt(n p (1 - p)) survive x, and
  then x* > x; or if fewer than n p - z sqrt(n p (1 - p)) do, and then x* < x. With
  n <= z^2 p / (1 - p) robots, 15 for p = 0.8, even n survivors do not refute it, and the interval
  begins at 0. With n <= z^2 (1 - p) / p even 0 survivors do not refute it, and the interval ends at
  the strongest level.

`push_limits` has the records of the limits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from surefoot.evaluation.digits import from_digits
from surefoot.evaluation.statistics import Interval, Z, resamples
from surefoot.types import Array


def robots_needed(share: float, n: int) -> float:
    """Number of robots that have to survive: a share of n, rounded (0.55 * 100 is above 55)."""
    return round(share * n, 9)


def falling_fit(successes: ArrayLike) -> Array:
    """The falling curves nearest to the successes, by least squares (isotonic regression).

    The value at level k is min over i <= k of max over j >= k of the mean of levels i to j.

    Args:
        successes: ``(..., L)`` numbers of robots that survived each of L levels.

    Returns:
        ``(..., L)`` numbers of robots, rounded to nine digits so that equal means stay equal.
    """
    counts = np.asarray(successes)
    first, last = np.indices((counts.shape[-1],) * 2)
    is_run = first <= last
    sums = np.insert(counts.cumsum(axis=-1), 0, 0, axis=-1)
    totals = sums[..., None, 1:] - sums[..., :-1, None]
    means = np.where(is_run, totals / np.where(is_run, last - first + 1, 1), -np.inf)
    greatest = np.maximum.accumulate(means[..., ::-1], axis=-1)[..., ::-1]
    return np.where(is_run, greatest, np.inf).min(axis=-2).round(9)


def fitted_level(levels: Sequence[float], successes: ArrayLike, needed: float) -> Array:
    """Impulses at which falling curves, fitted to the successes, meet the number needed [N s].

    Args:
        levels: The L levels tried, in ascending order [N s].
        successes: ``(..., L)`` numbers of robots that survived each level.
        needed: Number of robots that have to survive.

    Returns:
        ``(...)`` impulses; 0 if a curve begins below the number needed, and the last level if it
        never falls below it.
    """
    tried = np.asarray(levels, float)
    curve = falling_fit(successes)
    after = (curve < needed).argmax(axis=-1, keepdims=True)
    before = np.maximum(after - 1, 0)
    above = np.take_along_axis(curve, before, axis=-1)
    drop = above - np.take_along_axis(curve, after, axis=-1)
    part = np.divide(above - needed, drop, out=np.zeros_like(drop), where=drop > 0.0)
    met = (tried[before] + part * (tried[after] - tried[before]))[..., 0]
    met = np.where(curve[..., 0] < needed, 0.0, met)
    return np.where(curve[..., -1] < needed, met, tried[-1])


def refuting_counts(share: float, n: int) -> tuple[float, float]:
    """The counts of survivors below and above which a share of n robots is refuted (95 %).

    Args:
        share: Share p of the robots that has to survive.
        n: Number of robots.
    """
    margin = Z * float(np.sqrt(n * share * (1.0 - share)))
    return n * share - margin, n * share + margin


def limit_interval(
    levels: Sequence[float], successes: Sequence[int], share: float, n: int, strongest: float
) -> Interval:
    """The narrowest interval of a limit that the levels and the number of robots allow [N s].

    Args:
        levels: The levels tried, in ascending order, from the unpushed control on [N s].
        successes: Number of robots that survived each level.
        share: Share p of the robots that has to survive.
        n: Number of robots.
        strongest: The strongest level of the search; the search cannot resolve limits beyond it
            [N s].

    Returns:
        The two levels between which the curve meets the share; an end is 0 or the strongest level
        if n robots are too few to refute the share on that side.
    """
    few, many = refuting_counts(share, n)
    below = np.flatnonzero(falling_fit(successes) < robots_needed(share, n))
    k = int(below[0]) if below.size else len(levels)
    low = float(levels[max(k - 1, 0)]) if many < n else 0.0
    high = float(levels[k]) if below.size and few > 0.0 else strongest
    return low, high


def resampled_impulses(
    levels: Sequence[Sequence[float]], survived: Sequence[Sequence[str]], needed: float
) -> Array:
    """Fitted impulses of resampled robots.

    Args:
        levels: For each of D directions, the levels tried, in ascending order [N s].
        survived: For each of these levels, one digit per robot: 1 if it survived.
        needed: Number of robots that have to survive.

    Returns:
        ``(RESAMPLES, D)`` impulses [N s].
    """
    draws = resamples(len(survived[0][0]))
    columns = []
    for levels_tried, digits in zip(levels, survived, strict=True):
        counts = draws @ np.array([from_digits(robots) for robots in digits]).T
        columns.append(fitted_level(levels_tried, counts, needed))
    return np.array(columns).T
