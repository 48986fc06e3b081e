"""Reads a record of a robot from a JSON or TOML file that a user has written.

Such a file is data: nothing in it is run. `robots.load` reads specs with it, `robots.profile`
hardware profiles.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from surefoot.config.json_io import from_json
from surefoot.config.json_text import parse_json, read_file

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Record = TypeVar("Record", bound="DataclassInstance")

SUFFIXES = (".json", ".toml")
"""The endings of such files."""


def read_data_file(path: Path, kind: type[Record], most_bytes: int, what: str) -> Record:
    """Read a record from a JSON or TOML file.

    Args:
        path: The file.
        kind: The class of the record.
        most_bytes: No file with such a record is larger [B].
        what: What the file holds, for errors: "spec of a robot".

    Raises:
        ValueError: The file is not there, too large, not JSON or TOML, or holds no such record; the
            message names the file and the key that is wrong.
    """
    if not path.exists():
        raise ValueError(f"there is no file {path} with a {what}")
    if path.is_file() and path.stat().st_size > most_bytes:
        raise ValueError(f"{path} is no {what}: it has more than {most_bytes} bytes")
    content = read_file(path)
    try:
        is_toml = path.suffix.lower() == ".toml"
        values = tomllib.loads(content.decode()) if is_toml else parse_json(content)
        return from_json(kind, values)
    except (ValueError, RecursionError) as error:  # of TOML and of UTF-8 too
        raise ValueError(f"{path} is no {what}: {error}") from error
