"""What all exports share: stretches of frames without a gap, and a folder that is whole or absent.

Methods keep only some of an episode's frames, so a dataset has gaps. The formats of other tools
have none: each stretch of consecutive ticks becomes an episode there, which records the id of the
episode that it comes from. Read `minari` and `lerobot` next.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from tqdm import tqdm

from surefoot.files import WriteError, writing
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames

SIMULATED = "in simulation"
"""Where the frames of a run were recorded, for the dataset card."""
ON_ROBOT = "on a robot, and in simulation before,"
"""The same for a run that has learned on a robot."""


@dataclass(frozen=True)
class Exported:
    """What an export has written.

    Attributes:
        folder: The folder of the exported dataset.
        episodes: The number of episodes in it, which are stretches without a gap.
        frames: The number of frames in it.
        left_out: The number of the dataset's frames that are not in it.
    """

    folder: Path
    episodes: int
    frames: int
    left_out: int


def segments(dataset: Dataset, shortest: int = 1) -> Iterator[Frames]:
    """The stretches of consecutive ticks of a dataset, with one shard in memory at a time.

    Args:
        dataset: The dataset.
        shortest: Stretches shorter than this are left out [ticks].

    Raises:
        DatasetError: A shard is damaged.
    """
    shards = len(dataset.shards)
    for frames in tqdm(dataset.parts(), "export", shards, leave=False, unit="shard"):
        gap = (np.diff(frames.episode) != 0) | (np.diff(frames.tick) != 1)
        edges = np.concatenate([[0], np.flatnonzero(gap) + 1, [len(frames)]]).tolist()
        for begin, end in pairwise(edges):
            if end - begin >= max(shortest, 1):
                yield frames[begin:end]


def check_new(folder: Path) -> None:
    """Check, before any work, that an export may use a folder.

    Args:
        folder: The folder.

    Raises:
        ValueError: The folder exists.
    """
    if folder.exists():
        raise ValueError(f"{folder} exists; an export never changes a folder: name a new one")


@contextmanager
def new_folder(folder: Path, needs: int = 0) -> Iterator[Path]:
    """A folder to write into, which gets its name once everything is written.

    Args:
        folder: The path, which must not exist.
        needs: How much will be written [B], if the space must be checked first: the HDF5 library
            crashes on a full disk.

    Raises:
        ValueError: The path exists.
        WriteError: The disk is full, or read-only.
    """
    check_new(folder)
    with writing(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        free = shutil.disk_usage(folder.parent).free
        if free < needs:
            raise OSError(f"it needs {needs / 1e6:.1f} MB, and {free / 1e6:.1f} MB are free")
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        whole = work / folder.name
        whole.mkdir()
        yield whole
        with writing(folder):
            os.rename(whole, folder)
    except WriteError:
        raise
    except OSError as error:
        raise WriteError(f"{folder} cannot be written ({error}): free some space") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)
