"""Configurations that check themselves when they are made.

A configuration is a frozen dataclass that inherits from `Checked`. The annotation of a field gives
the range of a number, as `Annotated[int, Within(2, 1_000_000)]`, its type, the names that a
`Literal` allows and the order of a pair; all are checked. NaN and infinity are refused everywhere.
So the command line, JSON files and Python users get the same errors, before any work. Checks that
need two configurations or the stored initial states are in `surefoot.runs.checks`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import Field, dataclass, fields
from functools import cache
from numbers import Integral, Real
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from surefoot.config.field_docs import unit_of
from surefoot.errors import unknown

Value = TypeVar("Value")
Annotation = Any
"""The annotation of a field: a type, or something made of types."""

MOST_ITEMS = 32
"""Maximum number of items in a tuple of any length, so that no file takes much memory."""


@dataclass(frozen=True)
class Within:
    """The range of a number, or of each number of a tuple.

    Attributes:
        least: The smallest value that is allowed.
        most: The largest value that is allowed.
    """

    least: float
    most: float


class RangeError(ValueError):
    """A number is out of its range; the message ends with the range."""


@dataclass(frozen=True)
class Rising:
    """Marks a pair whose first number must not exceed its second one."""


Share = Annotated[float, Within(0.0, 1.0)]
"""A share or a probability."""
Seconds = Annotated[float, Within(0.0, 3600.0)]
"""A time that may be zero [s]."""
Duration = Annotated[float, Within(0.001, 3600.0)]
"""A time of at least one tick [s]."""
Angle = Annotated[float, Within(0.0, 180.0)]
"""An angle that counts either way [deg]."""
Torques = Annotated[tuple[float, float, float], Within(0.01, 10_000.0)]
"""Torques of a leg's three joints [N m]."""
Rates = Annotated[tuple[float, float, float], Within(0.01, 1000.0)]
"""Rates of a leg's three joints [rad/s]."""
Travel = Annotated[tuple[float, float], Within(-1000.0, 1000.0), Rising()]
"""The smallest and the largest angle of a joint [rad]."""


def known(value: Value | None, option: str) -> Value:
    """The value of an option that may be None, which stands for the robot's own value.

    Args:
        value: The value.
        option: Its dotted name, for the error.

    Raises:
        ValueError: It is None.
    """
    if value is None:
        raise ValueError(
            f"{option} is None, which stands for the robot's own value; `sf.with_own_values` puts "
            "that in its place"
        )
    return value


class Checked:
    """Base class of the configurations: every field is checked when one is made.

    Attributes:
        section: The path of the class in the whole configuration, for messages.
        renamed: Names that fields had in older JSON files, with the names that they have now.

    Raises:
        ValueError: A field has the wrong type, an unknown name, or a value out of its range.
    """

    section: ClassVar[str] = ""
    renamed: ClassVar[Mapping[str, str]] = {}
    # Tells type checkers that every subclass is a dataclass.
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __post_init__(self) -> None:
        """Check all fields."""
        values = [(field.name, getattr(self, field.name)) for field in fields(self)]
        check_values(type(self), values, self.section)


def check_values(kind: type, values: Iterable[tuple[str, object]], path: str) -> None:
    """Check values against the annotations of a class's fields.

    Args:
        kind: The class.
        values: The name and the value of each field that is to be checked.
        path: The dotted path of the object, for messages; empty for the whole configuration.

    Raises:
        ValueError: A value has the wrong type, or is out of range, which is given with its unit.
    """
    hints = annotations_of(kind)
    for name, value in values:
        try:
            _check(value, hints[name], f"{path}.{name}" if path else name)
        except RangeError as error:
            unit = unit_of(kind, name)
            raise RangeError(f"{error} {unit}" if unit else str(error)) from None


@cache
def annotations_of(kind: type) -> Mapping[str, Annotation]:
    """The annotations of a dataclass's fields by their names, with what they say of them."""
    return get_type_hints(kind, include_extras=True)


def _check(value: Any, hint: Annotation, path: str, limits: Within | None = None) -> None:
    """Check one value against its annotation; limits of a tuple apply to each of its numbers."""
    origin = get_origin(hint)
    if origin is Annotated:
        _check_annotated(value, hint, path, limits)
    elif origin is tuple:
        _check_tuple(value, get_args(hint), path, limits)
    elif origin is Mapping:
        _check_mapping(value, get_args(hint)[1], path)
    elif origin is Literal:
        names = get_args(hint)
        if value not in names:
            raise ValueError(unknown(path, str(value), map(str, names)))
    elif origin in (Union, UnionType):
        _check_union(value, get_args(hint), path, limits)
    elif hint is int or hint is float:
        _check_number(value, hint, path, limits)
    elif not isinstance(value, hint):
        raise ValueError(f"{path} is {value!r}, expected {hint.__name__}")


def _check_annotated(value: Any, hint: Annotation, path: str, limits: Within | None) -> None:
    """Check a value whose annotation carries rules."""
    kind, *rules = get_args(hint)
    for rule in rules:
        if isinstance(rule, Within):
            limits = rule
    _check(value, kind, path, limits)
    if any(isinstance(rule, Rising) for rule in rules):
        low, high = value
        if low > high:
            raise ValueError(f"{path} is {low} to {high}; the first must not exceed the second")


def _check_tuple(
    value: Any, kinds: tuple[Annotation, ...], path: str, limits: Within | None
) -> None:
    """Check a tuple and each of its items."""
    if not isinstance(value, tuple):
        raise ValueError(f"{path} is {value!r}, expected a tuple")
    if kinds[-1] is Ellipsis:
        if len(value) > MOST_ITEMS:
            raise ValueError(f"{path} has {len(value)} items; use at most {MOST_ITEMS}")
        kinds = kinds[:1] * len(value)
    if len(value) != len(kinds):
        raise ValueError(f"{path} is {value!r}, expected {len(kinds)} values")
    for number, (kind, item) in enumerate(zip(kinds, value, strict=True)):
        _check(item, kind, f"{path}[{number}]", limits)


def _check_union(
    value: Any, kinds: tuple[Annotation, ...], path: str, limits: Within | None
) -> None:
    """Check a value that may have one of several types, or be None."""
    if value is None and type(None) in kinds:
        return
    others = [kind for kind in kinds if kind is not type(None)]
    if len(others) == 1:
        _check(value, others[0], path, limits)
    elif not isinstance(value, tuple(get_origin(kind) or kind for kind in others)):
        names = ", ".join(kind.__name__ for kind in kinds)
        raise ValueError(f"{path} is {value!r}, expected one of {names}")


def _check_mapping(value: Any, kind: Annotation, path: str) -> None:
    """Check a mapping with strings as keys, and each of its values."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{path} is {value!r}, expected names with values")
    for key, item in value.items():
        if not isinstance(key, str):
            raise ValueError(f"{path} has the key {key!r}, expected a string")
        _check(item, kind, f"{path}.{key}")


def _is_number(value: object, kind: type) -> bool:
    """Whether a value is a number of this kind; an integer serves as a float too."""
    number = Integral if kind is int else Real
    return isinstance(value, number) and not isinstance(value, bool)


def _check_number(value: Any, kind: type, path: str, limits: Within | None) -> None:
    """Check that a number has its type, is finite and lies within its limits."""
    if not _is_number(value, kind):
        raise ValueError(f"{path} is {value!r}, expected {kind.__name__}")
    if limits is not None and not limits.least <= value <= limits.most:
        raise RangeError(f"{path} is {value}; use {limits.least} to {limits.most}")
    if not math.isfinite(value):
        raise ValueError(f"{path} is {value}; use a finite number")
