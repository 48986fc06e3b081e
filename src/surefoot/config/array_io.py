"""Reads records of arrays from npz files; no code is run, and the file's size bounds the memory.

`load_arrays` reads a dataclass of arrays that `files.save_arrays` wrote, to the bit: names, types
and shapes are those of the dataclass. `parse_npz` reads arrays with any names. Read `json_io` for
records of other values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import ClassVar, Protocol, TypeVar, get_args, get_origin, get_type_hints
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from surefoot.config.json_text import MEMORY_BASE, MEMORY_FACTOR, read_file
from surefoot.errors import shown

Shape = tuple[int | str, ...]
"""Lengths of an array's axes; axes with the same name have the same length."""
_ARRAY_KINDS = "biufU"
"""Kinds of arrays in files: truth values, signed and unsigned integers, floats, and text."""


class ArrayRecord(Protocol):
    """A dataclass of arrays, for `load_arrays`.

    Attributes:
        shapes: Shapes of the fields that are not ``("n",)``.
    """

    __dataclass_fields__: ClassVar[dict[str, Field]]
    shapes: ClassVar[Mapping[str, Shape]]


Record = TypeVar("Record", bound=ArrayRecord)


def load_arrays(path: Path, kind: type[Record]) -> Record:
    """Read a dataclass of arrays that `save_arrays` wrote, to the bit.

    Args:
        path: The file.
        kind: The dataclass. A field that has a default may be absent from the file.

    Raises:
        ValueError: The file is missing or damaged, or its arrays are not those of the dataclass.
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
    expected_types = _dtypes_of(kind)
    lengths: dict[str, int] = {}
    for name, field in known.items():
        if name not in arrays:
            if field.default is MISSING and field.default_factory is MISSING:
                raise ValueError(f"it lacks {name}")
            continue
        expected = expected_types[name]
        actual = arrays[name].dtype
        # The type of text contains the length of the longest string.
        if actual != expected and not actual.kind == expected.kind == "U":
            raise ValueError(f"{name} holds {actual}, expected {expected}")
        shape = kind.shapes.get(name, ("n",))
        _check_shape(name, arrays[name].shape, shape, lengths)


@cache
def _dtypes_of(kind: type[ArrayRecord]) -> Mapping[str, np.dtype]:
    """The dtype of each field of a dataclass of arrays."""
    hints = get_type_hints(kind)
    return {field.name: _dtype_of(hints[field.name]) for field in fields(kind)}


def _dtype_of(hint: object) -> np.dtype:
    """The dtype that a type hint such as ``NDArray[np.float64]`` names."""
    # Since NumPy 2.5 this is an alias with one argument; before, ndarray[shape, dtype[np.float64]].
    last = get_args(hint)[-1]
    return np.dtype(get_args(last)[0] if get_origin(last) is np.dtype else last)


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

    An array is only read if its header agrees with the number of bytes of its data.

    Raises:
        ValueError: The content is not an npz file, or would unpack to more than its size justifies.
    """
    try:
        with ZipFile(BytesIO(content)) as archive:
            members = archive.infolist()
            _check_members(members, len(content))
            return {
                member.filename.removesuffix(".npy"): _read_array(archive, member)
                for member in members
            }
    except Exception as error:  # whatever zip, zlib and NumPy raise about a damaged file
        raise ValueError(str(error) or repr(error)) from error


def _check_members(members: list[ZipInfo], size: int) -> None:
    """Check the directory of an npz file of a given size.

    Raises:
        ValueError: A name appears twice, there is too much to unpack, or the format is unknown.
    """
    names = {member.filename for member in members}
    if len(names) < len(members):
        raise ValueError("an array is there twice")
    # Besides the content, memory has the bytes of all arrays, and those of one a second time.
    if 2 * sum(member.file_size for member in members) > (MEMORY_FACTOR - 1) * size + MEMORY_BASE:
        raise ValueError(f"its arrays are too large for a file of {size} bytes")
    for member in members:
        # Other formats allocate memory by numbers in the file.
        if member.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise ValueError(f"{shown(member.filename)} is packed in a way that NumPy never writes")


def _read_array(archive: ZipFile, member: ZipInfo) -> NDArray:
    """One array of an npz file.

    Raises:
        ValueError: Its header does not fit its bytes, or it has something other than numbers, truth
            values or text.
    """
    with archive.open(member) as stream:
        # The size is given so that no more than this is unpacked.
        packed = BytesIO(stream.read(member.file_size))
    name = shown(member.filename)
    if np.lib.format.read_magic(packed) != (1, 0):
        raise ValueError(f"{name} has an unknown version")
    shape, by_column, dtype = np.lib.format.read_array_header_1_0(packed)
    if dtype.kind not in _ARRAY_KINDS or dtype.itemsize == 0:
        raise ValueError(f"{name} holds {dtype}, which is neither numbers nor text")
    expected = math.prod(shape) * dtype.itemsize
    present = member.file_size - packed.tell()
    if min(shape, default=0) < 0 or expected != present:
        raise ValueError(f"{name} needs {expected} bytes for {shape} {dtype}, and has {present}")
    order = "F" if by_column else "C"
    # A copy, because the bytes that were read are not kept.
    return np.ndarray(shape, dtype, packed.getbuffer(), packed.tell(), order=order).copy(order)
