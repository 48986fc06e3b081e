"""Caches of compiled functions: where they go if neither package nor home can be written to."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import surefoot
from surefoot.caches import NUMBA, PICTURES, can_be_written, numba_folder, settle_caches

PACKAGE = Path(surefoot.__file__).parent


@pytest.fixture
def closed(monkeypatch, tmp_path):
    """A user who can write to nothing but the temporary directory, as in a container."""
    for name in (NUMBA, *PICTURES, "XDG_CACHE_HOME", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, "")  # undone after the test, also where the test sets it
        monkeypatch.delenv(name)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path).is_relative_to(temporary))
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    return temporary


def test_a_user_who_can_write_to_package_or_home_keeps_the_usual_folders(monkeypatch, caplog):
    monkeypatch.delenv(NUMBA, raising=False)
    before = dict(os.environ)
    monkeypatch.setattr(os, "access", lambda path, mode: True)
    settle_caches()
    assert numba_folder() == str(PACKAGE)
    monkeypatch.setattr(os, "access", lambda path, mode: PACKAGE not in Path(path).parents)
    monkeypatch.setenv("XDG_CACHE_HOME", "/caches")
    assert numba_folder() == "/caches/numba"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert dict(os.environ) == before
    assert caplog.text == ""


def test_a_user_who_can_write_to_neither_gets_a_private_folder_and_is_told_once(closed, caplog):
    settle_caches()
    private = closed / f"surefoot-{os.geteuid()}"
    assert private.stat().st_mode & 0o777 == 0o700
    assert os.environ[NUMBA] == str(private / "numba") == numba_folder()
    assert os.environ["MPLCONFIGDIR"] == str(private / "matplotlib")
    settle_caches()  # as in a worker, which inherits the variables
    [record] = caplog.records
    assert f"compiled functions go to {private}/numba" in record.getMessage()
    assert "set NUMBA_CACHE_DIR to choose another folder" in record.getMessage()


def test_folders_that_the_user_has_named_are_kept(closed, monkeypatch, caplog):
    for name in (NUMBA, *PICTURES):
        monkeypatch.setenv(name, str(closed / "mine"))
    settle_caches()
    assert {os.environ[name] for name in (NUMBA, *PICTURES)} == {str(closed / "mine")}
    assert caplog.text == ""


@pytest.mark.parametrize("prepared", ["open", "link", "file"])
def test_a_folder_that_others_may_have_prepared_is_not_used(closed, prepared):
    """Whoever writes to the cache decides what is run."""
    private = closed / f"surefoot-{os.geteuid()}"
    if prepared == "open":
        private.mkdir()
        private.chmod(0o777)
    elif prepared == "link":
        (closed / "target").mkdir(0o700)
        private.symlink_to(closed / "target")
    else:
        private.touch(0o600)
    settle_caches()
    used = Path(os.environ[NUMBA]).parent
    assert used.parent == closed and used != private
    assert used.stat().st_mode & 0o777 == 0o700


def test_without_any_folder_the_variable_is_named(closed, monkeypatch, caplog):
    monkeypatch.setattr("tempfile.tempdir", "/nonexistent/temporary")
    settle_caches()
    assert NUMBA not in os.environ
    assert "set NUMBA_CACHE_DIR to a folder that can be" in caplog.text


def test_a_folder_that_is_relative_or_a_file_cannot_be_written_to(tmp_path):
    (tmp_path / "file").touch()
    assert can_be_written(str(tmp_path / "a" / "b"))
    assert not can_be_written(str(tmp_path / "file"))
    assert not can_be_written(str(tmp_path / "file" / "b"))
    assert not can_be_written("~/.cache")


def test_numba_uses_the_folder_whether_it_is_loaded_before_or_after(tmp_path):
    code = "from surefoot.safety import gates\nprint(gates.outside._cache.cache_path)"
    for first in ("", "import numba\n"):
        arrange = "import os, tempfile\nfrom pathlib import Path\naccess = os.access\n"
        arrange += f"tempfile.tempdir = {str(tmp_path)!r}\n"
        arrange += f"os.access = lambda p, m: Path(p).is_relative_to({str(tmp_path)!r})\n"
        environment = {**os.environ, "HOME": "/nonexistent"}
        environment.pop(NUMBA, None)
        child = subprocess.run(
            [sys.executable, "-c", arrange + first + code],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        assert child.stdout.startswith(str(tmp_path / f"surefoot-{os.geteuid()}" / "numba"))
        assert child.stderr.count("compiled functions go to") == 1
