"""How two recordings of the same numbers differ: another order, sign, scale, frame, or time.

A wiring mistake on a robot is mostly one of these. `explain` tries them one after the other, and
says in words which one makes the two agree. Single rows, such as those of a damaged datagram, are
told as outliers and do not decide. Read `replay` for the recordings that are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from surefoot.learning.observation import Float32Array
from surefoot.types import Array

Numbers = Array | Float32Array
"""Numbers of either precision."""

MOST_DELAY = 5
"""[rows] Maximum shift between two recordings."""
DEGREES = 180.0 / np.pi
OUTLIERS = 0.02
"""The share of rows that may be outliers, which sizes of numbers and differences leave out."""


class Explanation(NamedTuple):
    """How two recordings differ.

    Attributes:
        kind: `order`, `sign`, `scale`, `frame`, `time`, `outlier` or `unknown`.
        text: The same in words.
        left: What remains of the difference then, as a fraction of the size of the numbers.
    """

    kind: str
    text: str
    left: float = 1.0


def largest(expected: Numbers, given: Numbers) -> tuple[float, int]:
    """The largest difference between two recordings ``(T, n)``, and its row."""
    error = np.abs(given - expected).max(axis=1)
    row = int(error.argmax())
    return float(error[row]), row


def first_beyond(expected: Numbers, given: Numbers, tolerance: float) -> int:
    """The first row in which two recordings ``(T, n)`` differ by more than a tolerance, or -1.

    Args:
        expected: One recording.
        given: The other.
        tolerance: How much each number may differ.
    """
    beyond = (np.abs(given - expected) > tolerance).any(axis=1)
    return int(beyond.argmax()) if beyond.any() else -1


def size_of(values: Array) -> float:
    """The root mean square of numbers ``(T, ...)``, without the rows in which it is largest.

    Args:
        values: The numbers.
    """
    of_rows = np.mean(np.reshape(values, (len(values), -1)) ** 2, axis=1)
    kept = np.sort(of_rows)[: len(of_rows) - int(np.ceil(OUTLIERS * len(of_rows)))]
    return float(np.sqrt(np.mean(kept))) if len(kept) else 0.0


def remaining(expected: Array, given: Array) -> float:
    """The size of a difference, as a fraction of that of the numbers.

    Args:
        expected: One recording.
        given: The other.
    """
    return size_of(given - expected) / max(size_of(given), 1e-3)


def explain(
    expected: Array,
    given: Array,
    names: Sequence[str],
    tolerance: float = 1e-4,
    rotation: Array | None = None,
) -> Explanation:
    """How one recording differs from another.

    Args:
        expected: ``(T, n)`` what the numbers should be.
        given: ``(T, n)`` what they are.
        names: ``(n,)`` the names of the columns.
        tolerance: The difference that may remain, as a fraction of the size of the numbers.
        rotation: ``(T, 3, 3)`` base frame to world frame, to try other frames if there are three
            columns.
    """
    if rotation is not None and expected.shape[1] == 3:
        for turn, text in (
            (rotation, "in the world frame instead of the base frame"),
            (np.swapaxes(rotation, -1, -2), "turned from the world frame to the base frame twice"),
        ):
            turned = (turn @ expected[..., None])[..., 0]
            if _agree(turned, given, tolerance) and not _agree(expected, given, tolerance):
                return Explanation("frame", f"it is {text}", remaining(turned, given))
    if _agree(expected, given, tolerance):
        return _outliers(expected, given, names, tolerance)
    matches = [_match(expected, given[:, i], i, tolerance) for i in range(len(names))]
    found = [match for match in matches if match is not None]
    if len(found) == len(names) and _is_order(found, given):
        changed = np.column_stack([expected[:, each.column] * each.factor for each in found])
        return _in_words(found, names)._replace(left=remaining(changed, given))
    for delay in (*range(1, MOST_DELAY + 1), *range(-1, -MOST_DELAY - 1, -1)):
        early = given[:delay] if delay < 0 else given[delay:]
        late = expected[-delay:] if delay < 0 else expected[:-delay]
        if len(early) > 1 and _agree(late, early, tolerance):
            when = "later" if delay > 0 else "earlier"
            text = f"it comes {abs(delay)} rows {when}"
            return Explanation("time", text, remaining(late, early))
    error, row = largest(expected, given)
    return Explanation("unknown", f"it differs by up to {error:.3g}, most in row {row}")


def _outliers(expected: Array, given: Array, names: Sequence[str], tolerance: float) -> Explanation:
    """The rows that differ, where nearly all agree."""
    error = np.abs(given - expected)
    row, column = np.unravel_index(error.argmax(), error.shape)
    beyond = error.max(axis=1) > tolerance * max(float(np.abs(expected).max()), 1e-3)
    if not beyond.any():
        return Explanation("unknown", "it differs by less than can be told")
    rows = "in this row only" if beyond.sum() == 1 else f"in {beyond.sum()} rows of {len(error)}"
    text = (
        f"{names[int(column)]} is {given[row, column]:.4g} in row {row}, where "
        f"{expected[row, column]:.4g} is due; it differs {rows}"
    )
    return Explanation("outlier", text, remaining(expected, given))


def _is_order(matches: Sequence[_Match], given: Array) -> bool:
    """Whether columns that seem to be elsewhere are: constant ones match others by chance."""
    columns = [match.column for match in matches]
    moved = [place for place, column in enumerate(columns) if place != column]
    exchanged = sorted(columns) == list(range(len(columns)))
    return exchanged or bool((np.ptp(given[:, moved], axis=0) > 0.0).all())


class _Match(NamedTuple):
    """The expected column that equals a given one, if multiplied by a factor."""

    column: int
    factor: float


def _match(expected: Array, given: Array, place: int, tolerance: float) -> _Match | None:
    """The column and factor that give a column: its own place first, then others by sign alone."""
    others = [column for column in range(expected.shape[1]) if column != place]
    for factor in (1.0, -1.0):
        if _agree(factor * expected[:, place], given, tolerance):
            return _Match(place, factor)
    scale = _factor(expected[:, place], given)
    if scale and _agree(scale * expected[:, place], given, tolerance):
        return _Match(place, scale)
    for column in others:
        for factor in (1.0, -1.0):
            if _agree(factor * expected[:, column], given, tolerance):
                return _Match(column, factor)
    for column in others:
        scale = _factor(expected[:, column], given)
        if scale and _agree(scale * expected[:, column], given, tolerance):
            return _Match(column, scale)
    return None


def _factor(expected: Array, given: Array) -> float:
    """The factor that best maps one column to the other; 0 if the column is zero."""
    square = float(expected @ expected)
    return float(expected @ given) / square if square > 0.0 else 0.0


def _agree(expected: Array, given: Array, tolerance: float) -> bool:
    """Whether two recordings differ by a small fraction of their size."""
    return remaining(expected, given) <= tolerance


def _in_words(matches: Sequence[_Match], names: Sequence[str]) -> Explanation:
    """The matches of all columns as an explanation."""
    moved = [i for i, match in enumerate(matches) if match.column != i]
    flipped = [i for i, match in enumerate(matches) if match.factor < 0.0]
    scaled = [i for i, match in enumerate(matches) if abs(abs(match.factor) - 1.0) > 1e-9]
    if moved:
        pairs = ", ".join(f"{names[i]} holds {names[matches[i].column]}" for i in moved[:4])
        return Explanation("order", f"its order differs: {pairs}{_rest(moved, 4)}")
    if scaled:
        factors = np.array([matches[i].factor for i in scaled])
        factor = float(np.median(factors))
        which = "" if len(scaled) == len(names) else f" of {_listed(scaled, names)}"
        if not np.allclose(factors, factor, rtol=0.1):
            return Explanation("scale", f"its scale{which} differs")
        return Explanation("scale", f"its scale{which} differs: {scale_in_words(factor)}")
    if flipped:
        return Explanation("sign", f"the sign of {_listed(flipped, names)} differs")
    return Explanation("unknown", "it differs by less than can be told")


def scale_in_words(factor: float) -> str:
    """A factor in words, and the units that it hints at."""
    text = f"it is {factor:.4g} times as large"
    for unit, hint in (
        (DEGREES, "degrees for radians"),
        (1.0 / DEGREES, "radians for degrees"),
        (1000.0, "millimeters for meters"),
        (0.001, "meters for millimeters"),
    ):
        if abs(factor / unit - 1.0) < 0.02:
            return f"{text} ({hint}?)"
    return text


def _listed(places: Sequence[int], names: Sequence[str]) -> str:
    """The names of some columns."""
    if len(places) == len(names):
        return "all of it"
    return ", ".join(names[place] for place in places[:4]) + _rest(places, 4)


def _rest(places: Sequence[int], shown: int) -> str:
    """How many more there are than are shown."""
    return f" and {len(places) - shown} more" if len(places) > shown else ""
