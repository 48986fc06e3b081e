"""A shard: one HDF5 file of frames, with each of their arrays as one uncompressed block.

HDF5 can do more than is wanted here: links into other files, arrays that are computed from others,
compression by which a small file fills the memory. `read_shard` accepts none of that, and reads no
more than the size of the file. Read next: ``dataset.py``, which names shards and keeps their
hashes.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from surefoot.learning.frames import FIELDS, FRAME_FIELDS, Fields, Frames

FORMAT = 2
"""Version of the shards and of the manifest. Format 1 has only the kept frames."""
STORED: dict[int, Fields] = {1: FRAME_FIELDS, 2: FIELDS}
"""The arrays of a shard, by its format."""


def row_size(format: int = FORMAT) -> int:
    """Size of one tick in a file of that format and in memory [B]."""
    fields = STORED[format].values()
    return sum(int(np.prod(shape, initial=1)) * np.dtype(dtype).itemsize for shape, dtype in fields)


def shard_content(frames: Frames) -> bytes:
    """The bytes of a shard.

    They are assembled in memory, because HDF5 can crash the process if the disk is full.
    """
    size = len(frames) * row_size() + 65_536
    with h5py.File("shard", "w", driver="core", backing_store=False, block_size=size) as file:
        file.attrs["format"] = FORMAT
        for name in FIELDS:
            file.create_dataset(name, data=getattr(frames, name))
        file.flush()
        return file.id.get_file_image()


def check_size(path: Path, rows: int, format: int = FORMAT) -> None:
    """Check that a file is large enough for its ticks, before memory is allocated for them.

    Args:
        path: The file.
        rows: Number of ticks that it should have.
        format: Version of the file.

    Raises:
        OSError: The file is missing, too small, or not a regular file.
    """
    if path.exists() and not path.is_file():  # reading a pipe would wait
        raise OSError("it is not a regular file")
    size = path.stat().st_size
    if rows * row_size(format) > size:
        raise OSError(f"it has {size} bytes, too few for {rows} ticks")


def read_shard(path: Path, arrays: Mapping[str, NDArray], format: int = FORMAT) -> None:
    """Fill arrays from a shard.

    A shard of format 1 has only the kept frames. Its applied torque is known where the expert
    drove, and NaN elsewhere.

    Args:
        path: The file.
        arrays: Arrays for all ticks of the shard, as `uninitialized_arrays` makes them.
        format: Version of the file.

    Raises:
        OSError: The file is missing or damaged, or an array has another shape, type or storage.
    """
    check_size(path, len(arrays["q"]), format)
    try:
        with h5py.File(path, "r") as file:
            for name in STORED[format]:
                array = arrays[name]
                stored = _block(file, name, path.stat().st_size)
                if stored.shape != array.shape or stored.dtype != array.dtype:
                    raise OSError(
                        f"{name} has shape {stored.shape} and type {stored.dtype}, "
                        f"expected {array.shape} and {array.dtype}"
                    )
                if array.size:
                    stored.read_direct(array)
    except OSError:
        raise
    except Exception as error:  # HDF5 raises many kinds of errors for a damaged file
        raise OSError(str(error)) from error
    if format == 1:
        arrays["gait"][:] = 0
        arrays["kept"][:] = True
        arrays["elapsed"][:] = -1
        arrays["applied"][:] = np.where(arrays["expert_drove"][:, None], arrays["torque"], np.nan)


def _block(file: h5py.File, name: str, size: int) -> h5py.Dataset:
    """An HDF5 dataset that is one plain block of bytes of this very file.

    Args:
        file: The file.
        name: Name of the dataset.
        size: Size of the file [B].

    Raises:
        OSError: There is no such dataset, or it is stored in another way.
    """
    if not isinstance(file.get(name, getlink=True), h5py.HardLink):
        raise OSError(f"{name} is missing, or a link to something else")
    stored = file[name]
    if not isinstance(stored, h5py.Dataset):
        raise OSError(f"{name} is not an array")
    properties = stored.id.get_create_plist()
    if properties.get_layout() != h5py.h5d.CONTIGUOUS or properties.get_external_count():
        raise OSError(
            f"{name} is compressed, in chunks or in another file; `h5repack -f NONE -l CONTI` "
            "makes it one block again"
        )
    begin = stored.id.get_offset()
    if stored.size and (begin is None or begin + stored.nbytes > size):
        raise OSError(f"{name} has no block of its size in the file")
    return stored
