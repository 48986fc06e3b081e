"""Stretches of frames without a gap, and folders that are whole or not there."""

import numpy as np
import pytest

from surefoot.files import WriteError
from surefoot.interop.datasets.segments import new_folder, segments


def test_a_stretch_ends_at_a_gap_and_at_an_episode(dataset):
    found = [(int(part.episode[0]), len(part)) for part in segments(dataset)]
    assert found == [(10, 250), (11, 100), (11, 149), (12, 250), (13, 1)]
    for part in segments(dataset):
        assert (np.diff(part.tick) == 1).all()


def test_short_stretches_are_left_out(dataset):
    assert [len(part) for part in segments(dataset, shortest=150)] == [250, 250]


def test_a_folder_gets_its_name_when_all_is_written(tmp_path):
    with new_folder(tmp_path / "new") as whole:
        (whole / "file").write_text("x")
        assert not (tmp_path / "new").exists()
    assert [path.name for path in tmp_path.rglob("*")] == ["new", "file"]


def test_nothing_is_left_of_a_folder_that_failed(tmp_path):
    with pytest.raises(WriteError, match="cannot be written"), new_folder(tmp_path / "new"):
        raise OSError("no space")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_is_never_changed(tmp_path):
    with pytest.raises(ValueError, match="name a new one"), new_folder(tmp_path):
        pass
