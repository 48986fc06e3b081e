"""Files that are there whole or not at all, whenever the process is killed: bytes, JSON, arrays.

`write_atomic` is below every file of the package: a reader sees the old content or the new one,
never a part. `write_json` and `save_arrays` write records with it. Read `config.json_io` next for
how a record becomes JSON.
"""

from __future__ import annotations

import errno
import fcntl
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, Field, fields
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeVar, get_args, get_type_hints
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.config.json_io import to_json
from surefoot.config.json_text import MEMORY_BASE, MEMORY_FACTOR, read_file
from surefoot.errors import shown
from surefoot.types import IntArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Shape = tuple[int | str, ...]
"""Lengths of an array's axes; axes of one name have one length."""
_ARRAY_KINDS = "biufU"
"""Kinds of arrays in files: truth values, integers of both sorts, floats, and text."""


class ArrayRecord(Protocol):
    """A dataclass of arrays, for `load_arrays`.

    Attributes:
        shapes: Shapes of the fields that are not ``("n",)``.
    """

    __dataclass_fields__: ClassVar[dict[str, Field]]
    shapes: ClassVar[Mapping[str, Shape]]


Record = TypeVar("Record", bound=ArrayRecord)
_locks: list[int] = []
"""Descriptors of locked files, never closed: closing any descriptor of a file releases its lock."""


class WriteError(OSError):
    """A file cannot be written: the disk is full, or the folder is read-only."""


@contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """A context in which an `OSError` becomes one that names the file and says what to do.

    Args:
        path: The file or folder, or words for it.

    Raises:
        WriteError: Writing failed inside.
    """
    try:
        yield
    except OSError as error:
        raise WriteError(
            f"{path} cannot be written ({error}): free some space, or fix the folder's permissions"
        ) from error


def check_output(path: Path, *, suffixes: tuple[str, ...] = ()) -> None:
    """Check that `write_atomic` could write a file, before the work whose results it is to hold.

    Nothing is written or made. Links, devices and pipes are allowed, as `write_atomic` writes what
    they stand for; a device or a pipe has no format, so any name will do.

    Args:
        path: The file; its folder need not exist.
        suffixes: Endings of a name that the format allows, such as ``(".png", ".svg")``, in lower
            case; without any, all are allowed.

    Raises:
        ValueError: The name has another ending.
        WriteError: The path is a folder or empty, its folder can neither be written to nor be made,
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
    only a hidden ``.NAME.PID.tmp`` may stay behind. A link stays, and its target is written. What
    renaming would replace, devices and pipes such as ``/dev/stdout``, is written through.

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
    """The file that a path stands for: of a link, what it points to."""
    target = Path(os.path.realpath(path))
    if target.is_symlink():  # of links that point to each other, there is no such file
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    return target


def _temporary(path: Path) -> Path:
    """The name that a file has until it is whole."""
    return path.with_name(f".{path.name}.{os.getpid()}.tmp")


def is_left_over(path: Path) -> bool:
    """Whether a file is what a killed `write_atomic` has left behind, by its temporary name."""
    is_file = path.is_file() and not path.is_symlink()
    return is_file and re.fullmatch(r"\..+\.\d+\.tmp", path.name) is not None


def _write_content(path: Path, content: bytes | Callable[[Path], object]) -> None:
    """Write the content to a file that does not matter yet."""
    if callable(content):
        content(path)
    else:
        path.write_bytes(content)


def is_stream(path: Path) -> bool:
    """Whether a path is a device, a pipe or a stream of this process, which has no old content."""
    # Standard output may be a file: what reads it holds that very file, and not the name.
    own_stream = path.parent in (Path("/dev"), Path("/dev/fd"), Path("/proc/self/fd"))
    return own_stream or (path.exists() and not path.is_file() and not path.is_dir())


def _write_through(path: Path, content: bytes | Callable[[Path], object]) -> None:
    """Write the content into what is there already."""
    with TemporaryDirectory() as folder:
        whole = Path(folder) / "content"
        _write_content(whole, content)
        with path.open("wb") as stream:
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
        False if another process has locked it, which no longer holds once that has ended.

    Raises:
        WriteError: The file cannot be made.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_CREAT | os.O_RDWR)
    _locks.append(descriptor)
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):  # POSIX allows either
        return False
    return True


def write_json(path: Path, record: object) -> None:
    """Write a record as JSON, whole or not at all; NaN becomes null.

    Args:
        path: The file.
        record: A dataclass instance, or plain JSON values.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    write_atomic(path, json.dumps(to_json(record), indent=1, allow_nan=False).encode())


def as_digits(values: ArrayLike) -> str:
    """The values as a string of n digits, which is short in JSON.

    Args:
        values: ``(n,)`` truth values, or integers from 0 to 9.
    """
    return "".join(str(value) for value in np.asarray(values, int).tolist())


def from_digits(text: str) -> IntArray:
    """The numbers ``(n,)`` of a string of digits; undoes `as_digits`."""
    return np.array([int(digit) for digit in text], dtype=np.int64)


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


def load_arrays(path: Path, kind: type[Record]) -> Record:
    """Read a dataclass of arrays that `save_arrays` wrote, to the bit.

    Args:
        path: The file.
        kind: The dataclass. A field that has a default may be absent from the file.

    Raises:
        ValueError: The file is missing, damaged, or holds other arrays than the dataclass has.
    """
    try:
        arrays = parse_npz(read_file(path))
        _check_arrays(arrays, kind)
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{path} is missing or damaged ({error}); delete it: `surefoot train ... --resume` "
            "collects it again, to the same bits"
        ) from error
    return kind(**arrays)


def _check_arrays(arrays: Mapping[str, NDArray], kind: type[ArrayRecord]) -> None:
    """Check that arrays are those of a dataclass: names, types and shapes.

    Raises:
        ValueError: They are not.
    """
    known = {field.name: field for field in fields(kind)}
    if extra := sorted(arrays.keys() - known.keys()):
        raise ValueError(f"it has {shown(extra[0])}, which {kind.__name__} has not")
    hints = get_type_hints(kind)
    lengths: dict[str, int] = {}
    for name, field in known.items():
        if name not in arrays:
            if field.default is MISSING and field.default_factory is MISSING:
                raise ValueError(f"it lacks {name}")
            continue
        # NDArray[np.float64] is ndarray[shape, dtype[np.float64]].
        expected = np.dtype(get_args(get_args(hints[name])[1])[0])
        actual = arrays[name].dtype
        # Text has the length of the longest.
        if actual != expected and not actual.kind == expected.kind == "U":
            raise ValueError(f"{name} holds {actual}, expected {expected}")
        shape = kind.shapes.get(name, ("n",))
        _check_shape(name, arrays[name].shape, shape, lengths)


def _check_shape(
    name: str, actual: tuple[int, ...], expected: Shape, lengths: dict[str, int]
) -> None:
    """Check the shape of an array, and note the lengths of its named axes.

    Raises:
        ValueError: It has another shape, or an axis of another length than in an earlier array.
    """
    if len(actual) == len(expected):
        pairs = list(zip(expected, actual, strict=True))
        wanted = [
            lengths.setdefault(axis, length) if isinstance(axis, str) else axis
            for axis, length in pairs
        ]
        if wanted == list(actual):
            return
    known = tuple(lengths.get(axis, axis) if isinstance(axis, str) else axis for axis in expected)
    raise ValueError(f"{name} has shape {actual}, expected {known}")


def parse_npz(content: bytes) -> dict[str, NDArray]:
    """The arrays of an npz file, by their names.

    An array is read once its header agrees with the number of bytes that there are for it.

    Raises:
        ValueError: The content is no such file, or promises more than its size justifies.
    """
    try:
        with ZipFile(BytesIO(content)) as archive:
            members = archive.infolist()
            _check_members(members, len(content))
            return {
                member.filename.removesuffix(".npy"): _read_array(archive, member)
                for member in members
            }
    except Exception as error:  # whatever zip, zlib and NumPy make of a damaged file
        raise ValueError(str(error) or repr(error)) from error


def _check_members(members: list[ZipInfo], size: int) -> None:
    """Check the directory of an npz file of so many bytes.

    Raises:
        ValueError: A name is there twice, or there is too much to unpack, or in another format.
    """
    names = {member.filename for member in members}
    if len(names) < len(members):
        raise ValueError("an array is there twice")
    # The bytes of all arrays are in memory beside the content, and those of one a second time.
    if 2 * sum(member.file_size for member in members) > (MEMORY_FACTOR - 1) * size + MEMORY_BASE:
        raise ValueError(f"its arrays are too large for a file of {size} bytes")
    for member in members:
        # Other formats allocate by numbers that stand in the file.
        if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise ValueError(f"{shown(member.filename)} is packed in a way that NumPy never writes")


def _read_array(archive: ZipFile, member: ZipInfo) -> NDArray:
    """One array of an npz file.

    Raises:
        ValueError: Its header does not fit its bytes, or it holds something else than numbers,
            truth values or text.
    """
    with archive.open(member) as stream:
        # With the size, so that no more than this is unpacked.
        packed = BytesIO(stream.read(member.file_size))
    name = shown(member.filename)
    if np.lib.format.read_magic(packed) != (1, 0):
        raise ValueError(f"{name} has an unknown version")
    shape, _, dtype = np.lib.format.read_array_header_1_0(packed)
    if dtype.kind not in _ARRAY_KINDS or dtype.itemsize == 0:
        raise ValueError(f"{name} holds {dtype}, which is neither numbers nor text")
    expected = math.prod(shape) * dtype.itemsize
    present = member.file_size - packed.tell()
    if min(shape, default=0) < 0 or expected != present:
        raise ValueError(f"{name} needs {expected} bytes for {shape} {dtype}, and has {present}")
    packed.seek(0)
    return np.lib.format.read_array(packed, allow_pickle=False)
