"""Files that are there whole or not at all."""

import json
import os
import stat
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from surefoot.files import (
    WriteError,
    check_output,
    claim_file,
    is_locked,
    lock_file,
    whole_name,
    write_atomic,
    write_json,
    writing,
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
    assert whole_name(tmp_path / others[0]) == "file" and whole_name(path) is None
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


@pytest.mark.parametrize("mode", ["ab", "wb"])
def test_a_file_that_the_output_goes_to_keeps_what_it_has(tmp_path, mode):
    log = tmp_path / "log"
    log.write_text("old\n")
    names = ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "/dev/stderr"]
    code = f"""
from surefoot.files import write_atomic
for name in {names}:
    print("before")
    write_atomic(name, f"{{name}}\\n".encode())
print("after")
"""
    with log.open(mode) as stream:
        subprocess.run([sys.executable, "-c", code], stdout=stream, stderr=stream, check=True)
    old = ["old"] if mode == "ab" else []
    written = [line for name in names for line in ("before", name)]
    assert log.read_text().splitlines() == [*old, *written, "after"]


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


@contextmanager
def locked_by_another_process(path):
    """Another process holds the lock of a file; its answer, and the process."""
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
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


def test_a_lock_holds_for_other_processes_until_its_own_ends(tmp_path):
    path = tmp_path / "made" / ".lock"
    with locked_by_another_process(path) as answer:
        assert answer == "True"
        assert is_locked(path)
        assert not lock_file(path)
    assert not is_locked(path)
    assert lock_file(path)


def test_to_ask_whether_a_file_is_locked_takes_no_lock(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("fcntl.lockf", lambda *arguments: asked.append(arguments))
    (tmp_path / "free").write_bytes(b"")
    assert not is_locked(tmp_path / "free")
    assert not is_locked(tmp_path / "no-such-file")
    assert not asked


def test_to_ask_about_a_lock_of_ones_own_does_not_lose_it(tmp_path):
    path = tmp_path / ".lock"
    assert lock_file(path)
    assert not is_locked(path)
    with locked_by_another_process(path) as answer:
        assert answer == "False"


def test_a_file_of_results_is_claimed_by_one_process_at_a_time(tmp_path):
    path = tmp_path / "made" / "table.json"
    claim_file(path)
    claim_file(path)  # its own
    (tmp_path / "link.json").symlink_to(path)
    with locked_by_another_process(path.with_name(".table.json.lock")) as answer:
        assert answer == "False"
    other = tmp_path / "other.json"
    with locked_by_another_process(tmp_path / ".other.json.lock") as answer:
        assert answer == "True"
        for name in (other, linked(tmp_path / "link-2.json", other)):
            with pytest.raises(
                ValueError, match=r"another process is adding results to .*another file"
            ):
                claim_file(name)
    claim_file(other)
    claim_file(Path("/dev/null"))


def linked(link, target):
    """A link to a file."""
    link.symlink_to(target)
    return link
