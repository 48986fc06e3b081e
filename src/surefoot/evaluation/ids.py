"""Ids of initial states as text such as ``700-798,850``, which replaces a long list in files."""

from __future__ import annotations

import re

import numpy as np

from surefoot.errors import shown
from surefoot.types import IntArray


def ids_as_text(ids: IntArray) -> str:
    """Ids as text, in the same order, with consecutive ids as a range: ``700-798,850``.

    Args:
        ids: ``(n,)`` ids.
    """
    if not len(ids):
        return ""
    ends = np.flatnonzero(np.diff(ids) != 1) + 1
    ranges = [part.tolist() for part in np.split(ids, ends)]
    return ",".join(f"{part[0]}-{part[-1]}" if len(part) > 1 else str(part[0]) for part in ranges)


def ids_from_text(text: str) -> IntArray:
    """The ids ``(n,)`` of a text; undoes `ids_as_text`.

    Raises:
        ValueError: The text is no list of ids and of ranges.
    """
    parts = [np.arange(part.start, part.stop) for part in _ranges(text)]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)


def count_ids(text: str) -> int:
    """The number of ids in a text, without listing them: a short text may name very many.

    Raises:
        ValueError: The text is no list of ids and of ranges.
    """
    return sum(len(part) for part in _ranges(text))


def _ranges(text: str) -> list[range]:
    """The ids and ranges of ids that a text names.

    Raises:
        ValueError: The text is no list of ids and of ranges.
    """
    ranges = []
    for part in text.split(",") if text else ():
        match = re.fullmatch(r"(-?\d{1,18})(?:-(\d{1,18}))?", part, re.ASCII)
        if match is None:
            raise ValueError(f"{shown(text)} is no list of ids such as 700-798,850")
        first, last = match.groups()
        ranges.append(range(int(first), int(last or first) + 1))
    return ranges
