"""Outcomes of many episodes as a string of digits, which is short in a JSON file."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from surefoot.types import IntArray


def as_digits(values: ArrayLike) -> str:
    """The values as a string of n digits.

    Args:
        values: ``(n,)`` truth values, or integers from 0 to 9.
    """
    return "".join(str(value) for value in np.asarray(values, int).tolist())


def from_digits(text: str) -> IntArray:
    """The numbers ``(n,)`` of a string of digits; undoes `as_digits`."""
    return np.array([int(digit) for digit in text], dtype=np.int64)
