"""The impulse at which a falling curve, fitted to the robots that survived, meets a share of them.

The number of survivors need not fall from level to level; isotonic regression pools neighbors until
it does. The curve is read by linear interpolation between levels.

Its 95 % interval is that of the middle 95 % of the limits of robots drawn anew. Where robots agree,
all draws are alike, and that is not certainty. Let S(x) be the share of robots that survive x,
falling in x, and x* the limit: S(x*) = p. So the interval is no narrower than what was seen:

- It holds the two levels a < b tried between which the curve meets n p; where x* lies between them
  nothing shows.
- A score test refutes S(x) = p where of n robots more than n p + z sqrt(n p (1 - p)) survive x, and
  then x* > x; or fewer than n p - z sqrt(n p (1 - p)), and then x* < x. With n <= z^2 p / (1 - p)
  robots, 15 for p = 0.8, even n survivors do not refute it: the interval begins at 0. With
  n <= z^2 (1 - p) / p even none do not, and it ends at the strongest level.

`push_limits` makes records of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import isotonic_regression

from surefoot.evaluation.digits import from_digits
from surefoot.evaluation.statistics import Interval, Z, resamples
from surefoot.types import Array


def robots_needed(share: float, n: int) -> float:
    """Number of robots that have to survive: a share of n, rounded, since 0.7 * 10 is above 7."""
    return round(share * n, 9)


def fitted_level(levels: Sequence[float], successes: ArrayLike, needed: float) -> float:
    """Impulse at which a falling curve, fitted to the successes, meets the number needed [N s].

    Args:
        levels: The levels tried, rising [N s].
        successes: Number of robots that survived each level.
        needed: Number of robots that have to survive.
    """
    curve = isotonic_regression(np.asarray(successes), increasing=False).x.round(9)
    below = np.flatnonzero(curve < needed)
    if not below.size:
        return float(levels[-1])
    k = int(below[0])
    if k == 0:
        return 0.0
    part = (curve[k - 1] - needed) / (curve[k - 1] - curve[k])
    return float(levels[k - 1] + part * (levels[k] - levels[k - 1]))


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
    """What the robots pushed leave open of a limit, even if they all agree [N s].

    Args:
        levels: The levels tried, rising, from the unpushed control on [N s].
        successes: Number of robots that survived each level.
        share: Share p of the robots that has to survive.
        n: Number of robots.
        strongest: The strongest level of the search; limits beyond it are not told apart [N s].

    Returns:
        The two levels between which the curve meets the share; or 0 and the strongest level, where
        n robots are too few to refute it.
    """
    few, many = refuting_counts(share, n)
    curve = isotonic_regression(np.asarray(successes), increasing=False).x.round(9)
    below = np.flatnonzero(curve < robots_needed(share, n))
    k = int(below[0]) if below.size else len(levels)
    low = float(levels[max(k - 1, 0)]) if many < n else 0.0
    high = float(levels[k]) if below.size and few > 0.0 else strongest
    return low, high


def resampled_impulses(
    levels: Sequence[Sequence[float]], survived: Sequence[Sequence[str]], needed: float
) -> Array:
    """Fitted impulses of robots drawn anew.

    Args:
        levels: For each of D directions, the levels tried, rising [N s].
        survived: For each of these levels, one digit per robot: 1 if it survived.
        needed: Number of robots that have to survive.

    Returns:
        ``(RESAMPLES, D)`` impulses [N s].
    """
    draws = resamples(len(survived[0][0]))
    columns = []
    for levels_tried, digits in zip(levels, survived, strict=True):
        counts = draws @ np.array([from_digits(robots) for robots in digits]).T
        columns.append([fitted_level(levels_tried, row, needed) for row in counts])
    return np.array(columns).T
