"""Files that are written whole or not at all, whenever the process is killed.

`write_atomic` writes every file of the package: a reader sees the old content or the new, never a
part. `write_json` and `save_arrays` use it for records. `check_output` checks before the work that
a file could be written, `is_locked` tells whether another process has locked a file, and
`claim_file` keeps others away from it. Read `config.json_io` and `config.array_io` next, which read
the records back.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
import re
import struct
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import TYPE_CHECKING

import numpy as np

from surefoot.config.json_io import to_json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

STREAMS = {Path("/dev/stdin"): 0, Path("/dev/stdout"): 1, Path("/dev/stderr"): 2}
"""The streams of this process that have a path, and their descriptors."""
DESCRIPTORS = (Path("/dev/fd"), Path("/proc/self/fd"))
"""Folders that list the descriptors of this process as files."""
_locks: list[int] = []
"""Descriptors of locked files, never closed: closing any descriptor of a file releases its lock."""


class WriteError(OSError):
    """A file cannot be written: the disk is full, or the folder is read-only."""


@contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """A context that turns an `OSError` into one that names the file and says what to do.

    Args:
        path: The file or folder, or a description of it.

    Raises:
        WriteError: Writing failed in the context.
    """
    try:
        yield
    except OSError as error:
        raise WriteError(
            f"{path} cannot be written ({error}): free some space, or fix the folder's permissions"
        ) from error


def check_output(path: Path, *, suffixes: tuple[str, ...] = ()) -> None:
    """Check that `write_atomic` could write a file, before the work whose results go into it.

    No file or folder is left behind. Links, devices and pipes are allowed, since `write_atomic`
    writes to what they stand for; a device or a pipe has no format, so any name will do.

    Args:
        path: The file; its folder need not exist.
        suffixes: The file name endings that the format allows, such as ``(".png", ".svg")``, in
            lower case; if there are none, any ending is allowed.

    Raises:
        ValueError: The name has another ending.
        WriteError: The path is a folder or empty, its folder can be neither written to nor created,
            or the name is too long.
    """
    try:
        if is_stream(path):
            if path.is_socket() or not os.access(path, os.W_OK):
                raise WriteError(f"{path} cannot be written to; name a file, a device or a pipe")
            return
        if path.is_dir():
            given = "an empty name" if path == Path() else "a folder"
            raise WriteError(f"{str(path)!r} is {given}, and cannot be written; name a file")
        if suffixes and path.suffix.lower() not in suffixes:
            raise ValueError(f"{path} must end in {' or '.join(suffixes)}")
        target = _target(path)
        _temporary(target).exists()  # a name that is too long is an error
        folder = next(folder for folder in target.parents if os.path.lexists(folder))
        TemporaryFile(dir=folder).close()
    except WriteError:
        raise
    except OSError as error:
        raise WriteError(
            f"{path} cannot be written ({error.strerror}); name a file in a folder that you may "
            "write to"
        ) from error


def write_atomic(path: Path | str, content: bytes | Callable[[Path], object]) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part.

    The content is written under a temporary name in the same folder, flushed to the disk, and
    renamed. Even after a power cut the file is the old or the new one; after a kill in the middle,
    only a hidden ``.NAME.PID.tmp`` may stay behind. A link stays, and its target is written.
    Devices and pipes such as ``/dev/stdout``, which renaming would replace, are written directly.

    Args:
        path: The file; its folder is made if it does not exist.
        content: The bytes, or a function that writes them to the path that it is called with.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    path = Path(path)
    with writing(path):
        if is_stream(path):
            _write_through(path, content)
            return
        path = _target(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = _temporary(path)
        try:
            _write_content(temporary, content)
            _flush(temporary)
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        _flush(path.parent)


def _target(path: Path) -> Path:
    """The file that a path stands for: for a link, the file that it points to."""
    target = Path(os.path.realpath(path))
    if target.is_symlink():  # links that point to each other lead to no file
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    return target


def _temporary(path: Path) -> Path:
    """The name that a file has until it is whole."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def whole_name(path: Path) -> str | None:
    """The final name of a temporary file of `write_atomic`; None for any other file.

    The process that wrote it was killed, or is still writing.
    """
    if path.is_symlink() or not path.is_file():
        return None
    match = re.fullmatch(r"\.(.+)\.\d+\.tmp", path.name)
    return None if match is None else match[1]


def _write_content(path: Path, content: bytes | Callable[[Path], object]) -> None:
    """Write the content to a file that does not matter yet."""
    if callable(content):
        content(path)
    else:
        path.write_bytes(content)


def is_stream(path: Path) -> bool:
    """Whether a path is a device, a pipe or a stream of this process, which has no old content."""
    # Standard output may be a file, but whoever reads it has that very file open, not its name.
    own_stream = path.parent in (Path("/dev"), *DESCRIPTORS)
    return own_stream or (path.exists() and not path.is_file() and not path.is_dir())


def _descriptor(path: Path) -> int | None:
    """The descriptor of this process that a path stands for; None if it stands for none."""
    if path in STREAMS:
        return STREAMS[path]
    is_number = re.fullmatch("[0-9]+", path.name) is not None
    return int(path.name) if path.parent in DESCRIPTORS and is_number else None


def _write_through(path: Path, content: bytes | Callable[[Path], object]) -> None:
    """Write the content to a device, a pipe or a stream of this process."""
    with TemporaryDirectory() as folder:
        whole = Path(folder) / "content"
        _write_content(whole, content)
        descriptor = _descriptor(path)
        if descriptor is None:
            path.write_bytes(whole.read_bytes())
            return
        # Opening by name would empty a file that the output is redirected to.
        sys.stdout.flush()
        sys.stderr.flush()
        with os.fdopen(os.dup(descriptor), "wb") as stream:
            stream.write(whole.read_bytes())


def _flush(path: Path) -> None:
    """Wait until a file or a folder's entries are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def lock_file(path: Path) -> bool:
    """Lock a file for the rest of this process; it is made if it does not exist.

    Args:
        path: The file.

    Returns:
        False if another process has locked it; the lock ends with that process.

    Raises:
        WriteError: The file cannot be made.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR)
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # POSIX allows either
        os.close(descriptor)  # which releases nothing: another process has the lock
        return False
    _locks.append(descriptor)
    return True


def claim_file(path: Path) -> None:
    """Keep other processes from adding to a file of results until this one ends.

    Each of two processes would write only what it has read and measured itself, and the
    measurements of the other would be lost. The lock is on a second file in the same folder, since
    each write replaces the file itself.

    Args:
        path: The file, which need not exist; a device or a pipe is free to everyone.

    Raises:
        ValueError: Another process has claimed it.
        WriteError: The folder cannot be written to.
    """
    if is_stream(path):
        return
    file = Path(os.path.realpath(path))
    if not lock_file(file.with_name(f".{file.name}.lock")):
        raise ValueError(
            f"another process is adding results to {path}, and each would overwrite what the other "
            "measures; wait until it has ended, or name another file"
        )


def is_locked(path: Path) -> bool:
    """Whether another process has locked a file; asking neither takes nor releases a lock.

    Args:
        path: The file; it need not exist, and may be read-only.

    Raises:
        PermissionError: The file cannot be read.
    """
    if not path.exists() or _is_locked_here(path):
        return False
    with path.open("rb") as file:
        answer = fcntl.fcntl(file, fcntl.F_GETLK, _lock_request())
    kind = struct.unpack_from("h", answer, _LOCK_KIND_AT)[0]
    return kind != fcntl.F_UNLCK


_IS_BSD = sys.platform == "darwin" or "bsd" in sys.platform
_LOCK_KIND_AT = struct.calcsize("qqi") if _IS_BSD else 0
"""Offset of the kind of a lock in C's ``struct flock``, whose order differs between systems."""


def _lock_request() -> bytes:
    """C's ``struct flock`` for a lock of a whole file, as `lock_file` takes it."""
    kind = fcntl.F_WRLCK
    whence = os.SEEK_SET
    if _IS_BSD:  # start, length (0: all), process, kind, whence
        return struct.pack("qqihh0q", 0, 0, 0, kind, whence)
    return struct.pack("hhqqi0q", kind, whence, 0, 0, 0)


def _is_locked_here(path: Path) -> bool:
    """Whether this process has locked a file; opening and closing it would release the lock."""
    status = path.stat()
    return any(os.path.samestat(status, os.fstat(descriptor)) for descriptor in _locks)


def write_json(path: Path, record: object) -> None:
    """Write a record as JSON, whole or not at all; NaN becomes null.

    Args:
        path: The file.
        record: A dataclass instance, or plain JSON values.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    write_atomic(path, json.dumps(to_json(record), indent=1, allow_nan=False).encode())


def sha256_of(path: Path) -> str:
    """SHA-256 of a file, as hexadecimal digits."""
    return sha256(path.read_bytes()).hexdigest()


def save_arrays(path: Path, record: DataclassInstance) -> None:
    """Write a dataclass of arrays to an npz file, whole or not at all.

    Args:
        path: The file.
        record: A dataclass instance whose fields are all arrays.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    arrays = {field.name: getattr(record, field.name) for field in fields(record)}
    buffer = BytesIO()
    np.savez(buffer, **arrays)
    write_atomic(path, buffer.getvalue())
