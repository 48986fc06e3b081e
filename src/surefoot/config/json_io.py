"""Dataclasses to and from JSON values: configurations and results alike.

`to_json` turns any record into JSON, and `from_json` reads it back and checks it key by key: the
message about an unknown key names the closest one that exists; a missing key or a value of the
wrong type is named, too. A class with a class variable `name` (the methods' parameters) is written
with that name, which identifies it when it is read; a class with a table `renamed` still reads its
former keys. A number that is not finite, which JSON cannot represent, becomes null; it is read back
as NaN, except in configurations, whose numbers are finite. `json_text` reads the files.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import UnionType
from typing import (
    TYPE_CHECKING,
    Any,
    Literal,
    TypeGuard,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from surefoot.config.checked import Checked, check_values
from surefoot.config.json_text import parse_json, read_file
from surefoot.errors import shown, unknown

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record")
Plain = None | bool | int | float | str | list[Any] | dict[str, Any]
"""What the json module reads and writes."""


def to_json(value: object) -> Any:
    """JSON values of a record, or of anything that a record may contain."""
    if _is_record(value):
        named = {"name": value.name} if _is_named(type(value)) else {}
        return named | {field.name: to_json(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_json(value.tolist())
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def from_json(kind: type[Record], values: object, where: str = "") -> Record:
    """A record from JSON values; what is absent keeps its default.

    Args:
        kind: The record's class.
        values: A JSON object with the class's fields as keys.
        where: The dotted path of the object, for messages.

    Raises:
        ValueError: A key is unknown, missing or given twice under two names, or a value has the
            wrong type or is out of range; the message names its whole dotted path.
    """
    path = f"{where}." if where else ""
    hints = _field_types(kind)
    former = _renamed(kind)
    arguments = {}
    for key, value in _mapping(values, where or kind.__name__).items():
        if key == "name" and _is_named(kind):
            continue
        name = former.get(key, key)
        if name not in hints:
            raise ValueError(unknown("key", path + _text(key), (path + known for known in hints)))
        if name in arguments:
            raise ValueError(f"{path}{name} is there twice: also under its former name")
        # The numbers of a configuration are finite: there, null is not NaN.
        arguments[name] = _value(hints[name], value, path + key, not issubclass(kind, Checked))
    missing = [name for name in _required(kind) if name not in arguments]
    if missing:
        raise ValueError(f"{where or kind.__name__} lacks {', '.join(missing)}")
    if issubclass(kind, Checked):
        # The object would check itself, but does not know its path.
        check_values(kind, arguments.items(), where or kind.section)
    return kind(**arguments)


def read_json(path: Path) -> Any:
    """The JSON values of a file; no key appears twice, and numbers are finite.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is not JSON, or not a regular file.
    """
    content = read_file(path)
    try:
        return parse_json(content)
    except ValueError as error:
        raise ValueError(f"{path} is not JSON ({error})") from error


def read_record(path: Path, kind: type[Record]) -> Record:
    """The record in a JSON file.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is not JSON, or not such a record; the message names the file and the
            dotted path of what is wrong.
    """
    values = read_json(path)
    try:
        return from_json(kind, values)
    except ValueError as error:
        raise ValueError(
            f"{path} is no {kind.__name__} that this version can read: {error}"
        ) from error


def changes(
    record: DataclassInstance, base: DataclassInstance
) -> Iterator[tuple[str, Plain, Plain]]:
    """What differs between two instances of one class: dotted name, and both JSON values."""
    for field in fields(record):
        value = getattr(record, field.name)
        other = getattr(base, field.name)
        if _is_record(value) and type(value) is type(other):
            for name, new, old in changes(value, other):
                yield f"{field.name}.{name}", new, old
        elif value != other:
            yield field.name, to_json(value), to_json(other)


def changes_text(record: DataclassInstance, base: DataclassInstance) -> str:
    """What differs between two instances of one class, as text: `gait.duty 0.7 instead of 0.6`."""
    return ", ".join(
        f"{name} {json.dumps(new)} instead of {json.dumps(old)}"
        for name, new, old in changes(record, base)
    )


@cache
def _field_types(kind: type) -> Mapping[str, Any]:
    """The types of a class's fields, by their names."""
    hints = get_type_hints(kind)
    return {field.name: hints[field.name] for field in fields(kind)}


def _required(kind: type) -> list[str]:
    """Names of the fields without a default."""
    return [
        field.name
        for field in fields(kind)
        if field.default is MISSING and field.default_factory is MISSING
    ]


def _is_record(value: object) -> TypeGuard[DataclassInstance]:
    """Whether a value is an instance of a dataclass."""
    return is_dataclass(value) and not isinstance(value, type)


def _is_named(kind: type) -> bool:
    """Whether a class carries its own name as a class variable."""
    return isinstance(vars(kind).get("name"), str)


def _renamed(kind: type) -> Mapping[str, str]:
    """Former names of a class's fields, with the names that they have now."""
    return vars(kind).get("renamed", {})


def _mapping(value: object, path: str) -> Mapping[str, Any]:
    """The value itself, if it has keys."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{path} is {shown(value)}, expected an object with keys")
    return value


def _value(hint: Any, value: Any, path: str, has_nan: bool = False) -> Any:
    """A JSON value as the type of its field.

    Args:
        hint: The type.
        value: The JSON value.
        path: Its dotted path, for messages.
        has_nan: Whether null stands for NaN if a number is expected.
    """
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        return _one_of(get_args(hint), value, path, has_nan)
    if origin is tuple:
        return _tuple(get_args(hint), value, path, has_nan)
    if origin in (dict, Mapping):
        key_kind, kind = get_args(hint)
        return {
            _value(key_kind, key, f"key of {path}"): _value(
                kind, item, f"{path}.{_text(key)}", has_nan
            )
            for key, item in _mapping(value, path).items()
        }
    if origin is Literal:
        if value not in get_args(hint):
            raise ValueError(unknown(path, _text(value), map(str, get_args(hint))))
        return value
    if isinstance(hint, type) and is_dataclass(hint):
        return from_json(hint, value, path)
    if hint is float and value is None and has_nan:
        return math.nan
    return _plain(hint, value, path)


def _plain(hint: Any, value: Any, path: str) -> Any:
    """A JSON value that is neither a list nor an object, as the type of its field."""
    if hint is Any:
        return value
    if hint is Path and isinstance(value, str):
        return Path(value)
    if hint is float and type(value) is int and abs(value) <= sys.float_info.max:
        return float(value)
    if type(value) is not hint:
        raise ValueError(f"{path} is {shown(value)}, expected {hint.__name__}")
    return value


def _text(value: Any) -> str:
    """A name as it is; anything else, or a very long name, as a message shows it."""
    return value if isinstance(value, str) and len(value) <= 200 else shown(value)


def _one_of(kinds: tuple[Any, ...], value: Any, path: str, has_nan: bool) -> Any:
    """A value of one of several types: null, the class that the value names, or the first to fit.

    Raises:
        ValueError: None fits.
    """
    if value is None and type(None) in kinds:
        return None
    kinds = tuple(kind for kind in kinds if kind is not type(None))
    named = {kind.name: kind for kind in kinds if isinstance(kind, type) and _is_named(kind)}
    if named:
        name = _text(_mapping(value, path).get("name"))
        if name not in named:
            raise ValueError(unknown(path, name, named))
        return from_json(named[name], value, path)
    for kind in kinds[:-1]:
        try:
            return _value(kind, value, path, has_nan)
        except ValueError:
            continue
    return _value(kinds[-1], value, path, has_nan)


def _tuple(kinds: tuple[Any, ...], value: Any, path: str, has_nan: bool) -> tuple[Any, ...]:
    """A list as a tuple of the length and types that its field has."""
    if not isinstance(value, list | tuple):
        raise ValueError(f"{path} is {shown(value)}, expected a list")
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * len(value)
    if len(value) != len(kinds):
        raise ValueError(f"{path} is {shown(value)}, expected {len(kinds)} values")
    pairs = zip(kinds, value, strict=True)
    return tuple(
        _value(kind, item, f"{path}[{n}]", has_nan) for n, (kind, item) in enumerate(pairs)
    )
