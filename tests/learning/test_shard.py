"""One HDF5 file of frames: assembled in memory, and read only as far as it is what it should be."""

import os
from dataclasses import replace

import h5py
import numpy as np
import pytest

from surefoot.learning.frames import FIELDS, FRAME_FIELDS, Frames, uninitialized_arrays
from surefoot.learning.shard import check_size, read_shard, row_size, shard_content
from tests.fakes.learning import assert_same_frames, random_frames

FRAMES = random_frames([1, 2])


def read(path, frames=10) -> Frames:
    """The frames of a shard."""
    arrays = uninitialized_arrays(frames)
    read_shard(path, arrays)
    return Frames(**arrays)


def test_frames_come_back_to_the_bit(tmp_path):
    (tmp_path / "a.h5").write_bytes(shard_content(FRAMES))
    assert_same_frames(read(tmp_path / "a.h5"), FRAMES)
    (tmp_path / "none.h5").write_bytes(shard_content(FRAMES[:0]))
    assert_same_frames(read(tmp_path / "none.h5", 0), FRAMES[:0])


def test_a_shard_is_a_plain_file_of_hdf5(tmp_path):
    (tmp_path / "a.h5").write_bytes(shard_content(FRAMES))
    with h5py.File(tmp_path / "a.h5") as file:
        assert file.attrs["format"] == 2
        assert set(file) == set(FIELDS)
        for name, (shape, dtype) in FIELDS.items():
            np.testing.assert_array_equal(file[name], getattr(FRAMES, name))
            assert (file[name].shape, file[name].dtype) == ((10, *shape), dtype)  # pyright: ignore


def test_no_file_is_written_while_a_shard_is_assembled(tmp_path, monkeypatch):
    """HDF5 itself ends the process if the disk is full when it closes a file."""
    monkeypatch.chdir(tmp_path)
    content = shard_content(FRAMES)
    assert list(tmp_path.iterdir()) == []
    assert len(FRAMES) * row_size() < len(content) < len(FRAMES) * row_size() + 20_000


def test_a_file_that_older_versions_wrote_is_read(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["format"] = 1
        for name in FRAME_FIELDS:
            file.create_dataset(name, data=getattr(FRAMES, name))
    arrays = uninitialized_arrays(10)
    read_shard(tmp_path / "a.h5", arrays, format=1)
    drove = FRAMES.expert_drove[:, None]
    elapsed = np.full(10, -1, np.int32)
    applied = np.where(drove, FRAMES.torque, np.nan)
    assert_same_frames(Frames(**arrays), replace(FRAMES, elapsed=elapsed, applied=applied))


def test_bytes_of_a_tick():
    assert (row_size(1), row_size()) == (558, 660)


def test_more_frames_than_a_file_has_room_for_are_refused(tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(shard_content(FRAMES))
    check_size(path, 10)
    with pytest.raises(OSError, match="too few for 1000000000 ticks"):
        check_size(path, 10**9)
    with pytest.raises(OSError, match="q has shape"):
        read(path, 11)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.h5")
    with pytest.raises(OSError, match="not a regular file"):
        read(tmp_path / "a.h5")


def test_a_compressed_shard_is_refused_with_what_to_do(tmp_path):
    """Four million frames of zeros take 5 kB, and 2 GB of memory."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in FIELDS:
            file.create_dataset(name, data=getattr(FRAMES, name), compression="gzip")
    with pytest.raises(OSError, match=r"is compressed.*h5repack"):
        read(tmp_path / "a.h5")


def test_arrays_without_a_block_of_their_own_size_are_refused(tmp_path):
    """HDF5 would fill them with zeros."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in FIELDS:
            file.create_dataset(name, getattr(FRAMES, name).shape, getattr(FRAMES, name).dtype)
        file["padding"] = np.zeros(10 * row_size(), np.int8)
    with pytest.raises(OSError, match="q has no block of its size in the file"):
        read(tmp_path / "a.h5")
