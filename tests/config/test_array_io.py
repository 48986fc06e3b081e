"""Records of arrays come back from their files to the bit, and damaged files are refused."""

import os
import tracemalloc
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any, ClassVar, TypeVar, get_args, get_type_hints
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_LZMA, ZipFile

import numpy as np
import pytest
from numpy.typing import NDArray
from typing_extensions import TypeAliasType

from surefoot.config.array_io import Shape, load_arrays, parse_npz
from surefoot.files import save_arrays

Scalar = TypeVar("Scalar", bound=np.generic)
Alias = TypeAliasType("Alias", np.ndarray[tuple[Any, ...], np.dtype[Scalar]], type_params=(Scalar,))
"""What NDArray is since NumPy 2.5."""


@dataclass(frozen=True)
class Arrays:
    shapes: ClassVar[Mapping[str, Shape]] = {"values": ("n", 30)}

    name: NDArray[np.str_]
    values: NDArray[np.float64]
    flags: NDArray[np.bool_]


@dataclass(frozen=True)
class Aliased(Arrays):
    flags: Alias[np.bool_]


ARRAYS = Arrays(
    np.array(["a", "bc"]),
    np.random.default_rng(0).normal(size=(2, 30)),
    np.array([True, False]),
)


def test_arrays_come_back_to_the_bit(tmp_path):
    path = tmp_path / "arrays.npz"
    save_arrays(path, ARRAYS)
    again = load_arrays(path, Arrays)
    for name, array in vars(ARRAYS).items():
        stored = getattr(again, name)
        assert (stored.dtype, stored.shape) == (array.dtype, array.shape)
        assert stored.tobytes() == array.tobytes()
    assert os.listdir(tmp_path) == ["arrays.npz"]


@pytest.mark.parametrize("damage", ["half", "empty", "other", "missing", "lacks", "flipped"])
def test_arrays_that_are_damaged_are_named_with_what_to_do(tmp_path, damage):
    path = tmp_path / "arrays.npz"
    save_arrays(path, ARRAYS)
    content = bytearray(path.read_bytes())
    if damage == "half":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "empty":
        path.write_bytes(b"")
    elif damage == "other":
        path.write_bytes(b"not arrays")
    elif damage == "missing":
        path.unlink()
    elif damage == "lacks":
        np.savez(path, values=ARRAYS.values)
    else:
        content[content.find(ARRAYS.values.tobytes()) + 100] ^= 1
        path.write_bytes(content)
    with pytest.raises(ValueError, match=r"arrays.npz is missing or damaged .*--resume"):
        load_arrays(path, Arrays)


def test_arrays_of_objects_are_refused(tmp_path):
    """They would be pickled, and what is loaded could run code."""
    path = tmp_path / "objects.npz"
    np.savez(path, name=np.array([print]), values=ARRAYS.values, flags=ARRAYS.flags)
    with pytest.raises(ValueError, match="missing or damaged"):
        load_arrays(path, Arrays)


def npz(**arrays) -> bytes:
    buffer = BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


PARTS = {"name": ARRAYS.name, "values": ARRAYS.values, "flags": ARRAYS.flags}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"more": np.zeros(2)}, "it has 'more', which Arrays has not"),
        ({"values": np.zeros((2, 29))}, r"values has shape \(2, 29\), expected \(2, 30\)"),
        ({"values": np.zeros(30)}, r"values has shape \(30,\), expected \(2, 30\)"),
        ({"flags": np.ones(3, bool)}, r"flags has shape \(3,\), expected \(2,\)"),
        ({"flags": np.ones(2)}, "flags holds float64, expected bool"),
        ({"values": ARRAYS.values.astype(np.float32)}, "values holds float32, expected float64"),
        ({"values": ARRAYS.values + 0j}, "'values.npy' holds complex128"),
        ({"name": np.array([b"a", b"b"])}, r"'name.npy' holds \|S1"),
    ],
)
def test_other_arrays_than_those_of_the_record_are_named(tmp_path, change, message):
    path = tmp_path / "arrays.npz"
    path.write_bytes(npz(**PARTS | change))
    with pytest.raises(ValueError, match=rf"arrays.npz is missing or damaged \({message}"):
        load_arrays(path, Arrays)


def test_a_type_of_arrays_may_be_an_alias(tmp_path):
    """NDArray is one, of a single argument, since NumPy 2.5."""
    path = tmp_path / "arrays.npz"
    save_arrays(path, ARRAYS)
    assert get_args(get_type_hints(Aliased)["flags"]) == (np.bool_,)
    np.testing.assert_array_equal(load_arrays(path, Aliased).flags, ARRAYS.flags)
    path.write_bytes(npz(**PARTS | {"flags": np.ones(2)}))
    with pytest.raises(ValueError, match="flags holds float64, expected bool"):
        load_arrays(path, Aliased)


def test_a_field_that_later_versions_added_may_be_absent_if_it_has_a_default(tmp_path):
    @dataclass(frozen=True)
    class Later(Arrays):
        added: NDArray[np.int64] = field(default_factory=lambda: np.full(2, -1))

    save_arrays(tmp_path / "arrays.npz", ARRAYS)
    assert load_arrays(tmp_path / "arrays.npz", Later).added.tolist() == [-1, -1]


def test_a_pipe_holds_no_arrays(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ValueError, match="pipe is not a regular file"):
        load_arrays(tmp_path / "pipe", Arrays)


# --- headers that promise more than there is


def with_header(shape: str, data: bytes = b"", descr: str = "'<f8'") -> bytes:
    """An npz file whose only array has this shape in its header."""
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    header = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
    buffer = BytesIO()
    with ZipFile(buffer, "w") as archive:
        archive.writestr("values.npy", header + data)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (with_header("(10000000000,)"), r"needs 80000000000 bytes .* and has 0"),
        (with_header("(10000000000, 0)", b"12345678"), "needs 0 bytes .* and has 8"),
        (with_header("(-1,)"), "needs -8 bytes"),
        (with_header("(-1, -1)", b"12345678"), "needs 8 bytes"),
        (with_header("(4611686018427387904, 4)"), "needs 147573952589676412928 bytes"),
        (with_header("(1000000000,)", descr="'<U0'"), "holds <U0, which is neither"),
        (with_header("(1,)", b"12345678", descr="'|O'"), "holds object, which is neither"),
        (with_header("(1,)", b"12345678", descr="[('a', '<f8')]"), "which is neither"),
        (with_header("1"), "shape is not valid"),
    ],
)
def test_a_header_that_does_not_fit_its_bytes_is_refused_before_memory_is_taken(content, message):
    tracemalloc.start()
    with pytest.raises(ValueError, match=message):
        parse_npz(content)
    assert tracemalloc.get_traced_memory()[1] < 2e6
    tracemalloc.stop()


def packed(content: bytes, method: int) -> bytes:
    buffer = BytesIO()
    with ZipFile(buffer, "w", method) as archive:
        archive.writestr("values.npy", content)
    return buffer.getvalue()


def test_what_unpacks_to_very_much_is_refused_before_memory_is_taken():
    bomb = packed(bytes(100_000_000), ZIP_DEFLATED)
    assert len(bomb) < 200_000
    # The directory may also promise less than there is.
    liar = bomb.replace((100_000_000).to_bytes(4, "little"), (1000).to_bytes(4, "little"))
    assert liar != bomb
    for content in (bomb, liar):
        tracemalloc.start()
        with pytest.raises(ValueError):
            parse_npz(content)
        assert tracemalloc.get_traced_memory()[1] < 5e6
        tracemalloc.stop()


def test_packings_that_numpy_never_uses_are_refused():
    for method in (ZIP_BZIP2, ZIP_LZMA):
        with pytest.raises(ValueError, match=r"'values.npy' is packed in a way that NumPy never"):
            parse_npz(packed(b"content", method))


def test_an_array_that_is_there_twice_is_refused():
    buffer = BytesIO(npz(values=np.zeros(2)))
    with ZipFile(buffer, "a") as archive, pytest.warns(UserWarning, match="Duplicate name"):
        archive.writestr("values.npy", b"")
    with pytest.raises(ValueError, match="an array is there twice"):
        parse_npz(buffer.getvalue())
