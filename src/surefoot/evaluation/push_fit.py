"""The impulse at which a falling curve, fitted to the robots that survived, meets a share of them.

The number of survivors need not fall from level to level; isotonic regression pools neighbors until
it does. The curve is read by linear interpolation between levels. `push` makes the data.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import isotonic_regression

from surefoot.evaluation.statistics import resamples
from surefoot.files import from_digits
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
