"""Files that are there whole or not at all, whenever the process is killed: bytes, JSON, arrays."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from surefoot.config.json_io import to_json
from surefoot.types import IntArray

Record = TypeVar("Record")


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


def write_json(path: Path, record: object) -> None:
    """Write a record as JSON, whole or not at all; NaN becomes null."""
    write_atomic(path, json.dumps(to_json(record), indent=1, allow_nan=False).encode())


def as_digits(values: ArrayLike) -> str:
    """One digit for each of ``(n,)`` truth values or numbers of 0 to 9: short in JSON."""
    return "".join(map(str, np.asarray(values, int).tolist()))


def from_digits(text: str) -> IntArray:
    """The other way round: ``(n,)`` numbers."""
    return np.array([int(digit) for digit in text], dtype=np.int64)


def save_arrays(path: Path, record: Any) -> None:
    """Write a dataclass of arrays to an npz file, whole or not at all."""
    buffer = BytesIO()
    np.savez(buffer, **vars(record))
    write_atomic(path, buffer.getvalue())


def load_arrays(path: Path, kind: type[Record]) -> Record:
    """Read a dataclass of arrays back, to the bit.

    Args:
        path: the file.
        kind: the dataclass.

    Raises:
        ValueError: the file is missing, damaged, or of another version.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            return kind(**{name: stored[name] for name in stored.files})
    except Exception as error:  # whatever zip, zlib and NumPy make of a damaged file
        raise ValueError(
            f"{path} is missing or damaged ({error}); delete it: `surefoot train ... --resume` "
            "collects it again, to the same bits"
        ) from error
