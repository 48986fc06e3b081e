"""Files that are there whole or not at all, and records that come back from them to the bit."""

import json
import os
import stat
import subprocess
import sys
import tracemalloc
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import ClassVar
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_LZMA, ZipFile

import numpy as np
import pytest
from numpy.typing import NDArray

from surefoot.files import (
    Shape,
    WriteError,
    as_digits,
    check_output,
    from_digits,
    is_left_over,
    load_arrays,
    lock_file,
    parse_npz,
    save_arrays,
    write_atomic,
    write_json,
    writing,
)


@dataclass(frozen=True)
class Arrays:
    shapes: ClassVar[Mapping[str, Shape]] = {"values": ("n", 30)}

    name: NDArray[np.str_]
    values: NDArray[np.float64]
    flags: NDArray[np.bool_]


ARRAYS = Arrays(
    np.array(["a", "bc"]),
    np.random.default_rng(0).normal(size=(2, 30)),
    np.array([True, False]),
)


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "file"
    write_atomic(path, b"old")

    def fail(temporary):
        temporary.write_bytes(b"ne")
        raise OSError("disk full")

    with pytest.raises(WriteError, match=r"file cannot be written \(disk full\): free some space"):
        write_atomic(path, fail)
    assert path.read_bytes() == b"old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_bytes_and_functions_write_files_in_folders_that_are_made(tmp_path):
    write_atomic(tmp_path / "a" / "b" / "bytes", b"new")
    write_atomic(tmp_path / "c" / "function", lambda path: path.write_bytes(b"newer"))
    assert (tmp_path / "a" / "b" / "bytes").read_bytes() == b"new"
    assert (tmp_path / "c" / "function").read_bytes() == b"newer"


def test_the_file_has_its_name_only_when_it_is_whole(tmp_path):
    path = tmp_path / "file"

    def look(temporary):
        assert temporary.parent == path.parent
        assert not path.exists()
        temporary.write_bytes(b"whole")

    write_atomic(path, look)
    assert path.read_bytes() == b"whole"


def test_the_content_is_on_the_disk_before_its_name_and_that_before_the_end(
    tmp_path, monkeypatch, fsync
):
    path = tmp_path / "file"
    flushed = []

    def look(descriptor):
        flushed.append((os.fstat(descriptor).st_ino, path.exists()))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", look)
    write_atomic(path, b"whole")
    assert flushed == [(path.stat().st_ino, False), (tmp_path.stat().st_ino, True)]


KILLED = """
import os, sys
from pathlib import Path
from surefoot.files import write_atomic

def half(temporary):
    temporary.write_bytes(b"ha")
    os._exit(3)

write_atomic(Path(sys.argv[1]), half)
"""


def test_a_kill_in_the_middle_leaves_the_old_file_and_a_hidden_one(tmp_path):
    path = tmp_path / "file"
    write_atomic(path, b"old")
    assert subprocess.run([sys.executable, "-c", KILLED, str(path)]).returncode == 3
    assert path.read_bytes() == b"old"
    others = [entry.name for entry in tmp_path.iterdir() if entry != path]
    assert len(others) == 1
    assert others[0].startswith(".file.")
    assert is_left_over(tmp_path / others[0]) and not is_left_over(path)
    write_atomic(path, b"new")
    assert path.read_bytes() == b"new"


def test_errors_that_are_not_of_writing_pass_as_they_are(tmp_path):
    with pytest.raises(ZeroDivisionError), writing(tmp_path):
        1 / 0  # noqa: B018


def test_a_folder_that_is_a_file_is_named(tmp_path):
    (tmp_path / "run").touch()
    with pytest.raises(WriteError, match=r"run.*cannot be written"):
        write_atomic(tmp_path / "run" / "file", b"")


def test_a_link_stays_and_its_target_is_written(tmp_path):
    target = tmp_path / "elsewhere" / "precious.json"
    link = tmp_path / "link"
    target.parent.mkdir()
    link.symlink_to(target)
    for content in (b"first", b"second"):
        write_atomic(link, content)
        assert link.is_symlink()
        assert target.read_bytes() == content
    assert [path.name for path in target.parent.iterdir()] == ["precious.json"]


@pytest.mark.parametrize("content", [b"text", lambda path: path.write_bytes(b"text")])
def test_a_pipe_is_written_through(tmp_path, content):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_atomic(pipe, content)
        assert os.read(reader, 100) == b"text"
    finally:
        os.close(reader)
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_standard_output_is_written_through(tmp_path):
    code = "from surefoot.files import write_json; write_json('/dev/stdout', {'a': 1})"
    for number, kind in enumerate((subprocess.PIPE, (tmp_path / "out").open("wb"))):
        child = subprocess.run([sys.executable, "-c", code], stdout=kind, check=True)
        output = child.stdout if number == 0 else (tmp_path / "out").read_bytes()
        assert json.loads(output) == {"a": 1}


def test_a_folder_is_refused(tmp_path):
    with pytest.raises(WriteError, match="cannot be written"):
        write_atomic(tmp_path, b"text")
    assert tmp_path.is_dir()


def test_checking_an_output_that_can_be_written_writes_nothing(tmp_path):
    (tmp_path / "old.json").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere" / "target")
    os.mkfifo(tmp_path / "pipe")
    names = ["new.json", "old.json", "link", "pipe", "a/b/c/new.json"]
    before = sorted(tmp_path.rglob("*"))
    for name in names:
        check_output(tmp_path / name)
    for stream in ("/dev/null", "/dev/stdout"):
        check_output(Path(stream), suffixes=(".png",))
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "old.json").read_text() == "old"


def test_outputs_that_cannot_be_written_are_refused_before_the_work(tmp_path):
    (tmp_path / "file").touch()
    (tmp_path / "circle").symlink_to(tmp_path / "circle")
    (tmp_path / "to_folder").symlink_to(tmp_path)
    refused = {
        tmp_path: "is a folder",
        tmp_path / "to_folder": "is a folder",
        Path(""): "is an empty name",
        tmp_path / "file" / "new.json": "cannot be written",
        tmp_path / "circle": "cannot be written",
        tmp_path / "circle" / "new.json": "cannot be written",
        tmp_path / ("n" * 250): "File name too long",
        tmp_path / ("n" * 300) / "new.json": "File name too long",
    }
    for path, message in refused.items():
        with pytest.raises(WriteError, match=message):
            check_output(path)
        with pytest.raises(WriteError):  # and it is so: `write_atomic` cannot write them
            write_atomic(path, b"text")


def test_outputs_without_permission_are_refused_before_the_work(tmp_path, monkeypatch):
    def denied(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("surefoot.files.TemporaryFile", denied)  # root may write anywhere
    with pytest.raises(WriteError, match=r"new.json cannot be written .*Permission denied"):
        check_output(tmp_path / "a" / "new.json")


def test_outputs_of_a_format_have_one_of_its_endings(tmp_path):
    suffixes = (".png", ".svg")
    check_output(tmp_path / "plot.SVG", suffixes=suffixes)
    for name in ("plot.jpg", "plot", "png"):
        with pytest.raises(ValueError, match=rf"{name} must end in .png or .svg"):
            check_output(tmp_path / name, suffixes=suffixes)


def test_json_of_a_record_has_its_fields_as_keys_and_null_for_nan(tmp_path):
    @dataclass(frozen=True)
    class Figures:
        successes: int
        mse: tuple[float, ...]

    write_json(tmp_path / "figures.json", Figures(3, (0.5, float("nan"))))
    values = json.loads((tmp_path / "figures.json").read_text())
    assert values == {"successes": 3, "mse": [0.5, None]}


def test_digits_come_back_as_numbers():
    assert as_digits(np.array([True, False, True])) == "101"
    assert as_digits([0, 3, 9, 1]) == "0391"
    assert from_digits("0391").tolist() == [0, 3, 9, 1]
    assert from_digits("").tolist() == []
    assert from_digits("10").dtype == np.int64


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


def test_a_lock_holds_for_other_processes_until_its_own_ends(tmp_path):
    path = tmp_path / "made" / ".lock"
    program = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from surefoot.files import lock_file\n"
        "print(lock_file(Path(sys.argv[1])), flush=True)\n"
        "sys.stdin.readline()\n"
    )
    command = [sys.executable, "-c", program, str(path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "True\n"
        assert not lock_file(path)
        process.kill()
        process.wait()
    assert lock_file(path)
