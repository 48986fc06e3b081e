"""Files that are there whole or not at all, whenever the process is killed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class WriteError(OSError):
    """A file cannot be written: the disk is full, or the folder is not ours to write to."""


@contextmanager
def writing(what: Path | str) -> Iterator[None]:
    """Whatever goes wrong inside is an error that names the file and says what to do."""
    try:
        yield
    except OSError as error:
        raise WriteError(
            f"{what} cannot be written ({error}). Nothing that was complete is lost: free some "
            "space or mend the folder's permissions, then go on (train: with --resume)"
        ) from error


def write_atomic(path: Path | str, content: bytes | Callable[[Path], None]) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part.

    The content goes to a temporary name in the same folder and to the disk, then takes the name
    over. After a power cut the file is the old or the new one too; after a kill in the middle only
    a hidden ``.NAME.PID.tmp`` may stay behind.

    Args:
        path: the file; its folder is made if it is not there.
        content: the bytes, or a function that writes them to the path it is given.

    Raises:
        WriteError: the disk is full, or read-only.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            if callable(content):
                content(temporary)
            else:
                temporary.write_bytes(content)
            _flush(temporary)
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        _flush(path.parent)


def _flush(path: Path) -> None:
    """Wait until a file or a folder's entries are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_json(path: Path, figures: Mapping[str, Any]) -> None:
    """Write figures whole or not at all; NaN becomes null."""
    plain = json.loads(json.dumps(figures, default=float), parse_constant=lambda _: None)
    write_atomic(path, json.dumps(plain, indent=1, allow_nan=False).encode())
