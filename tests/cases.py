"""Cases of a test of which `make test` runs a few; `make test-thorough` runs the others."""

from collections.abc import Iterable
from typing import Any

import pytest


def first_often(n: int, cases: Iterable[Any]) -> list[Any]:
    """The cases of `pytest.mark.parametrize`; those after the first n are only run thoroughly.

    Args:
        n: How many of them `make test` runs.
        cases: Plain values, or tuples of them.
    """
    cases = list(cases)
    return cases[:n] + [_thorough(case) for case in cases[n:]]


def _thorough(case: Any) -> Any:
    values = case if isinstance(case, tuple) else (case,)
    return pytest.param(*values, marks=pytest.mark.thorough)
