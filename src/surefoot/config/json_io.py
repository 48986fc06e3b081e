"""Dataclasses to and from JSON values: configurations and results alike.

`to_json` makes JSON of any record, `from_json` reads it back and checks it key by key: an unknown
key names the nearest one that exists, a missing key and a value of the wrong type are named too.
NaN, which JSON does not have, becomes null. A class with a `name` of its own (the methods'
parameters) is written with that name, which tells it from the others when it is read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from surefoot.errors import unknown

Record = TypeVar("Record")
Plain = None | bool | int | float | str | list[Any] | dict[str, Any]
"""What the json module reads and writes."""


def to_json(value: object) -> Any:
    """JSON values of a record, or of anything that a record may hold."""
    if is_dataclass(value) and not isinstance(value, type):
        named = {"name": value.name} if _is_named(type(value)) else {}
        return named | {f.name: to_json(getattr(value, f.name)) for f in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): to_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return to_json(value.tolist())
    if isinstance(value, list | tuple):
        return [to_json(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def from_json(kind: type[Record], values: object, where: str = "") -> Record:
    """A record from JSON values; what is absent keeps its default.

    Args:
        kind: the record's class.
        values: JSON object with the class's fields as keys.
        where: dotted path of the object, for messages.

    Raises:
        ValueError: an unknown or missing key, or a value of the wrong type or out of range.
    """
    given = _mapping(values, where or kind.__name__)
    path = f"{where}." if where else ""
    hints = get_type_hints(kind)
    known = {field.name: hints[field.name] for field in fields(kind)}  # type: ignore[arg-type]
    arguments = {}
    for key, value in given.items():
        if key == "name" and _is_named(kind):
            continue
        if key not in known:
            raise ValueError(unknown("key", path + key, (path + name for name in known)))
        arguments[key] = _value(known[key], value, path + key)
    missing = [name for name in _required(kind) if name not in arguments]
    if missing:
        raise ValueError(f"{where or kind.__name__} lacks {', '.join(missing)}")
    return kind(**arguments)


def read_json(path: Path) -> Any:
    """The JSON values of a file.

    Raises:
        ValueError: the file is not JSON.
    """
    try:
        return json.loads(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path} is not JSON ({error})") from error


def changes(record: Any, base: Any) -> Iterator[tuple[str, Plain, Plain]]:
    """What differs between two instances of one class: dotted name, and both JSON values."""
    for field in fields(record):
        mine = getattr(record, field.name)
        other = getattr(base, field.name)
        if is_dataclass(mine) and type(mine) is type(other):
            for name, *both in changes(mine, other):
                yield f"{field.name}.{name}", *both
        elif mine != other:
            yield field.name, to_json(mine), to_json(other)


def _required(kind: type) -> list[str]:
    """Names of the fields without a default."""
    return [
        field.name
        for field in fields(kind)
        if field.default is MISSING and field.default_factory is MISSING
    ]


def _is_named(kind: type) -> bool:
    """Whether a class carries its own name as a class variable."""
    return isinstance(vars(kind).get("name"), str)


def _mapping(value: object, path: str) -> Mapping[str, Any]:
    """The value itself, if it has keys."""
    if not isinstance(value, Mapping):
        raise ValueError(f"{path} is {value!r}, expected an object with keys")
    return value


def _value(hint: Any, value: Any, path: str) -> Any:
    """A JSON value as the type of its field."""
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        return _one_of(get_args(hint), value, path)
    if origin is tuple:
        return _tuple(get_args(hint), value, path)
    if origin is dict:
        kind = get_args(hint)[1]
        items = _mapping(value, path).items()
        return {key: _value(kind, item, f"{path}.{key}") for key, item in items}
    if origin is Literal:
        if value not in get_args(hint):
            raise ValueError(unknown(path, str(value), map(str, get_args(hint))))
        return value
    if is_dataclass(hint):
        return from_json(hint, value, path)  # type: ignore[arg-type]
    if hint is Path and isinstance(value, str):
        return Path(value)
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is not hint:
        raise ValueError(f"{path} is {value!r}, expected {hint.__name__}")
    return value


def _one_of(kinds: tuple[Any, ...], value: Any, path: str) -> Any:
    """A value of one of several types: null, or the class that the value names, or what fits."""
    if value is None and type(None) in kinds:
        return None
    kinds = tuple(kind for kind in kinds if kind is not type(None))
    named = {kind.name: kind for kind in kinds if isinstance(kind, type) and _is_named(kind)}
    if not named:
        # Of a number and a list of numbers, what the value is.
        listed = [kind for kind in kinds if (get_origin(kind) is tuple) == isinstance(value, list)]
        return _value([*listed, *kinds][0], value, path)
    name = str(_mapping(value, path).get("name"))
    if name not in named:
        raise ValueError(unknown(path, name, named))
    return from_json(named[name], value, path)


def _tuple(kinds: tuple[Any, ...], value: Any, path: str) -> tuple[Any, ...]:
    """A list as a tuple of the length and types that its field has."""
    if not isinstance(value, list | tuple):
        raise ValueError(f"{path} is {value!r}, expected a list")
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * len(value)
    if len(value) != len(kinds):
        raise ValueError(f"{path} is {value!r}, expected {len(kinds)} numbers")
    pairs = zip(kinds, value, strict=True)
    return tuple(_value(kind, item, f"{path}[{n}]") for n, (kind, item) in enumerate(pairs))
