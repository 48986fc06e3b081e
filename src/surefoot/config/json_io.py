"""Configurations to and from JSON, checked key by key: an unknown key names the nearest one."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import MISSING, asdict, fields, is_dataclass, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

from surefoot.config import METHODS, Config, method_name
from surefoot.errors import unknown


def to_json(config: Config) -> dict[str, Any]:
    """The configuration as JSON values; `from_json` gives it back."""
    record = json.loads(json.dumps(asdict(config)))
    return {"method": {"name": method_name(config), **record.pop("method")}, **record}


def from_json(record: dict[str, Any]) -> Config:
    """The configuration of a JSON record; what is absent keeps its default.

    Raises:
        ValueError: an unknown key or method, or a value of the wrong type.
    """
    record = {"method": {"name": "loco_safe_dagger"}, **_mapping(record, "the configuration")}
    method = dict(_mapping(record.pop("method"), "method"))
    name = str(method.pop("name", None))
    if name not in METHODS:
        raise ValueError(unknown("method", name, METHODS))
    return replace(_fill(Config, record, ""), method=_fill(METHODS[name], method, "method."))


def _fill(kind: type, record: dict[str, Any], path: str) -> Any:
    """An instance of a config class from JSON values, checked key by key and type by type."""
    hints = get_type_hints(kind)
    values = {}
    for key, value in record.items():
        if key not in hints:
            raise ValueError(unknown("option", path + key, (path + name for name in hints)))
        hint = hints[key]
        if isinstance(hint, type) and is_dataclass(hint):
            values[key] = _fill(hint, _mapping(value, path + key), f"{path}{key}.")
        else:
            values[key] = _value(hint, value, path + key)
    required = {f.name for f in fields(kind) if f.default is f.default_factory is MISSING}
    if missing := sorted(required - values.keys()):
        raise ValueError(f"{path[:-1]} lacks {', '.join(missing)}")
    return kind(**values)


def _mapping(value: Any, path: str) -> dict[str, Any]:
    """The value itself, if it has keys."""
    if not isinstance(value, dict):
        raise ValueError(f"{path} is {value!r}, expected an object with keys")
    return value


def _value(hint: Any, value: Any, path: str) -> Any:
    """A JSON value as the type of its field: a scalar, or a tuple of them."""
    if get_origin(hint) is tuple:
        kinds = get_args(hint)
        if not isinstance(value, list | tuple):
            raise ValueError(f"{path} is {value!r}, expected a list")
        if kinds[-1] is Ellipsis:
            kinds = kinds[:1] * len(value)
        if len(value) != len(kinds):
            raise ValueError(f"{path} is {value!r}, expected {len(kinds)} numbers")
        pairs = enumerate(zip(kinds, value, strict=True))
        return tuple(_value(kind, item, f"{path}[{index}]") for index, (kind, item) in pairs)
    if get_origin(hint) is Literal:
        if value not in get_args(hint):
            raise ValueError(unknown(path, str(value), get_args(hint)))
        return value
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is not hint:
        raise ValueError(f"{path} is {value!r}, expected {hint.__name__}")
    return value


def changes(config: Any, base: Any) -> Iterator[tuple[str, Any, Any]]:
    """What differs between two instances of one config class: dotted name, and both JSON values."""
    for field in fields(config):
        values = getattr(config, field.name), getattr(base, field.name)
        if is_dataclass(values[0]) and type(values[0]) is type(values[1]):
            yield from ((f"{field.name}.{name}", *both) for name, *both in changes(*values))
        elif values[0] != values[1]:
            yield field.name, *json.loads(json.dumps(values, default=asdict))
