"""Reads files and JSON from any source, without hanging and without taking much memory.

`read_file` reads regular files only. `parse_json` adds up what a text would take in memory before
it reads it, and refuses what this package never writes: keys that appear twice, numbers that are
not finite or do not fit 64 bits, deep nesting. Read `json_io` next, which turns the values into
records.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from surefoot.errors import shown

MOST_BYTES = 2**30
"""[B] Maximum size of the package's files, except for shards of frames, which are not read here."""
MOST_LEVELS = 50
"""Maximum depth of nested JSON; the package writes nothing deeper."""
MEMORY_FACTOR = 9
"""Reading a file may take this many times its size in memory, plus `MEMORY_BASE`."""
MEMORY_BASE = 45_000_000
"""[B] Memory that reading any file may take."""
_JSON_COSTS = {b"{": 250, b"[": 90, b":": 240, b",": 60, b'"': 35}
"""[B] Maximum that Python allocates for a value that begins, or ends, with each of these."""


def read_file(path: Path) -> bytes:
    """The content of a regular file, or of one that a link points to.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is a folder, a pipe or a device, which may never end, or is too large.
    """
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is not a regular file")
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ValueError(f"{path} has {size} bytes; files of its kind have at most {MOST_BYTES}")
    return path.read_bytes()


def parse_json(content: bytes) -> Any:
    """The values of a JSON text: numbers are finite and fit 64 bits, and no key appears twice.

    Raises:
        ValueError: The text is not such JSON, or would take too much memory.
    """
    # The text and its values: with one character beyond ASCII, Python may use four bytes for each.
    needed = len(content) * (2 if content.isascii() else 9)
    needed += sum(content.count(mark) * cost for mark, cost in _JSON_COSTS.items())
    if needed > MEMORY_FACTOR * len(content) + MEMORY_BASE:
        raise ValueError(
            f"its many small values would take too much memory for {len(content)} bytes"
        )
    try:
        values = json.loads(
            content,
            object_pairs_hook=_object,
            parse_constant=_refuse_constant,
            parse_float=_finite,
            parse_int=_integer,
        )
    except RecursionError as error:
        raise ValueError(f"it is nested more than {MOST_LEVELS} levels deep") from error
    _check_depth(values)
    return values


def _object(pairs: list[tuple[str, Any]]) -> object:
    """A JSON object, after checking that no key appears twice."""
    values = dict(pairs)
    if len(values) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        twice = max(counts, key=lambda key: counts[key])
        raise ValueError(f"the key {shown(twice)} is there twice in one object")
    return values


def _refuse_constant(text: str) -> float:
    """Refuse NaN and Infinity: Python's json module reads and writes them, but JSON has neither."""
    raise ValueError(f"{text} is not a finite number")


def _finite(text: str) -> float:
    """A number that a float can hold."""
    value = float(text)
    return value if math.isfinite(value) else _refuse_constant(text[:40])


def _integer(text: str) -> int:
    """An integer that fits 64 bits, as all integers that the package writes do."""
    if len(text) > 20 or not -(2**63) <= int(text) < 2**63:
        raise ValueError(f"{text[:40]} does not fit 64 bits")
    return int(text)


def _check_depth(values: Any) -> None:
    """Check, level by level, how deep JSON values are nested.

    Raises:
        ValueError: They are nested too deeply to be shown in messages.
    """
    level = [values]
    for _ in range(MOST_LEVELS):
        level = [item for value in level for item in _items(value)]
        if not level:
            return
    raise ValueError(f"it is nested more than {MOST_LEVELS} levels deep")


def _items(value: Any) -> Iterable[Any]:
    """The items of a list or an object; none for other JSON values."""
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()
