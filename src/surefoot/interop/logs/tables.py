"""CSV text of a log: columns of numbers, named `field.component`, and what is wrong with one.

Every message names the line, the row and the column, and says what to do. Read `sensor_log` next,
which makes a log of the columns.
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from difflib import get_close_matches
from io import StringIO
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import shown

LARGEST = 2**63
"""Whole numbers of this size and larger do not fit the integers of arrays."""
UNITS = {"time_ns": "nanoseconds", "tick": "milliseconds", "gait": "gaits"}
"""What the fields of whole numbers count."""


def parse_table(
    text: str, components: Mapping[str, tuple[str, ...]], integers: Collection[str]
) -> tuple[dict[str, NDArray], tuple[str, ...]]:
    """The arrays of a CSV text.

    Args:
        text: The text: a line with the names of the columns, and one line for each row.
        components: The components of each field that is known, and none for a field that is one
            column; those of `network_input` are numbers from 0 on.
        integers: The fields of whole numbers.

    Returns:
        The arrays by name, and the names of the columns that are not known, which are ignored.

    Raises:
        ValueError: A column appears twice, an array lacks some columns, or a row has another number
            of values, or a value that is not a number.
    """
    reader = csv.reader(StringIO(text))
    head = [title.strip() for title in next(reader, [])]
    _check_head(head)
    lines = []
    rows = []
    for row in reader:
        if not row:  # a blank line
            continue
        if len(row) != len(head):
            raise ValueError(
                f"line {reader.line_num} (row {len(rows)}) has {len(row)} values, and there are "
                f"{len(head)} columns; not every row has as many values as there are columns"
            )
        rows.append(row)
        lines.append(reader.line_num)
    if not rows:
        raise ValueError("there are no rows below the names of the columns; record at least two")
    found: dict[str, dict[str, NDArray]] = {}
    ignored = []
    for place, title in enumerate(head):
        name, _, component = title.partition(".")
        sizes = components.get(name)
        known = sizes is not None and component in (sizes or ("",))
        if known or (name == "network_input" and component.isdecimal()):
            cells = [row[place] for row in rows]
            found.setdefault(name, {})[component] = _numbers(cells, title, lines, name in integers)
        elif title:
            ignored.append(title)
    arrays = {
        name: _array(name, parts, components.get(name), ignored) for name, parts in found.items()
    }
    return arrays, tuple(ignored)


def nearest(name: str, names: Iterable[str]) -> str:
    """The hint at a name that is there and may be meant, for a message; empty if none is near.

    Args:
        name: The name that is missing.
        names: Those that are there and not known.
    """
    lower = {each.lower(): each for each in names}
    near = get_close_matches(name.lower(), lower, n=1, cutoff=0.75)
    return f" (it has {shown(lower[near[0]])}; rename that to {name!r})" if near else ""


def whole(name: str, array: NDArray) -> NDArray:
    """An array of whole numbers as integers, which may have been written as floats.

    Args:
        name: Its name.
        array: The numbers.

    Raises:
        ValueError: They are not all whole.
    """
    if array.dtype.kind != "f":
        return array
    wrong = ~((array == np.round(array)) & (np.abs(array) < LARGEST))
    if wrong.any():
        row = int(np.argwhere(wrong)[0, 0])
        raise ValueError(
            f"{name} is {array[row]} in row {row}, which is no whole number; it counts "
            f"{UNITS[name]}"
        )
    return array.astype(np.int64)


def _check_head(head: list[str]) -> None:
    """Check the names of the columns.

    Raises:
        ValueError: There are none, or there is another separator, or a name appears twice.
    """
    if not any(head):
        raise ValueError("it is empty; its first line must have the names of the columns")
    for separator, word in ((";", "semicolons"), ("\t", "tabs")):
        if separator in head[0]:
            raise ValueError(
                f"its columns are separated by {word}; write it with commas between the columns "
                "and points in the numbers"
            )
    if all(_is_number(title) for title in head):
        raise ValueError(
            "line 1 has numbers; the names of the columns must be there, such as time_ns, tick, "
            "command.vx, joint_position.FL_HAA"
        )
    twice = [title for title in head if title and head.count(title) > 1]
    if twice:
        raise ValueError(f"a column is there twice: {shown(twice[0])}; remove one")


def _is_number(text: str) -> bool:
    """Whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _numbers(cells: list[str], title: str, lines: list[int], integer: bool) -> NDArray:
    """The numbers of a column.

    Args:
        cells: ``(T,)`` their texts.
        title: The name of the column.
        lines: ``(T,)`` the lines that they are in.
        integer: Whether they must be whole.
    """
    kind = _integer if integer else _float
    numbers = []
    for row, cell in enumerate(cells):
        try:
            numbers.append(kind(cell))
        except ValueError:
            _refuse(cell, f"line {lines[row]} (row {row}), column {title}", title, integer)
    return np.array(numbers)


def _refuse(cell: str, where: str, title: str, integer: bool) -> NoReturn:
    """Say what is wrong with a cell.

    Raises:
        ValueError: Always.
    """
    if not cell.strip():
        raise ValueError(f"{where} is empty; write a number, or leave the whole row out")
    if integer and _is_number(cell) and "_" not in cell:
        raise ValueError(
            f"{where} is {shown(cell)}, which is no whole number of 64 bits; it counts "
            f"{UNITS[title]}"
        )
    raise ValueError(f"{where} is {shown(cell)}, which is no number; write one such as -1.5")


def _float(text: str) -> float:
    """A number; Python's underscores between digits are more likely a slip.

    Raises:
        ValueError: It is not a number.
    """
    if "_" in text:
        raise ValueError(text)
    return float(text)


def _integer(text: str) -> int:
    """A whole number, which may be written with a decimal point or an exponent.

    Raises:
        ValueError: It is not a whole number, or too large.
    """
    if "_" in text:
        raise ValueError(text)
    number = None
    with suppress(ValueError):
        number = int(text)
    if number is None and float(text).is_integer():
        number = int(float(text))
    if number is None or abs(number) >= LARGEST:
        raise ValueError(text)
    return number


def _array(
    name: str, parts: dict[str, NDArray], components: tuple[str, ...] | None, ignored: list[str]
) -> NDArray:
    """The array that some columns form, whatever their order.

    Raises:
        ValueError: One is missing.
    """
    if [*parts] == [""]:
        return parts[""]
    if components is None:
        components = tuple(str(place) for place in range(1 + max(int(each) for each in parts)))
    for component in components:
        if component not in parts:
            title = f"{name}.{component}"
            raise ValueError(f"it lacks the column {title}{nearest(title, ignored)}")
    return np.column_stack([parts[component] for component in components])
