"""Files that are there whole or not at all."""

import pytest

from surefoot.files import WriteError, write_atomic


def test_write_atomic_keeps_the_old_file_when_the_new_one_fails(tmp_path):
    path = tmp_path / "file"
    write_atomic(path, b"old")

    def fail(temporary):
        temporary.write_bytes(b"ne")
        raise OSError("disk full")

    with pytest.raises(WriteError, match="disk full"):
        write_atomic(path, fail)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]

    def succeed(temporary):
        temporary.write_bytes(b"new")

    write_atomic(path, succeed)
    assert path.read_bytes() == b"new"
