"""Files that are there whole or not at all, and records that come back from them to the bit."""

import json
import os
import stat
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from surefoot.files import (
    Shape,
    WriteError,
    as_digits,
    from_digits,
    load_arrays,
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

    with pytest.raises(WriteError, match=r"file cannot be written \(disk full\).*then resume"):
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
    assert others[0].startswith(".file.") and others[0].endswith(".tmp")
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
