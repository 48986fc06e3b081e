"""Training samples: inputs and targets of the network, in bounded memory.

A row has the inputs (``observation.network_input``, 47 in the layout `full`) and 12 targets
(``policy.target_of``), float32, derived from raw frames. Rows stay in memory up to a limit. Beyond
it they go to an unnamed temporary file, which vanishes with the process, and an epoch reads it in
random blocks: as many blocks as fit in memory are mixed row by row, then the next ones. So a
minibatch has rows of blocks from all over the data, and every row is read once per epoch. Read
next: ``train.py``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager
from io import BufferedRandom
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from surefoot.files import writing
from surefoot.learning.frames import Frames, whole_episode
from surefoot.learning.memory import RecordedPast
from surefoot.learning.observation import INPUT_SIZE, Float32Array, network_input
from surefoot.learning.policy import PolicySpec, target_of
from surefoot.types import JOINTS, BoolArray, IntArray

WIDTH = INPUT_SIZE + len(JOINTS)
"""Number of values in a row of the layout `full`: inputs, then targets."""
BLOCK = 256
"""Rows that are read together: a quarter of a second of one robot, 60 kB in the layout `full`."""
ROWS_AT_A_TIME = 16384
"""Rows that are derived, summed or validated together, to bound the memory."""


class TrainingSamples:
    """n rows ``(n, width)``, of which at most ``limit`` bytes are in memory at a time.

    Args:
        limit: Memory [bytes]; at least one block is kept in memory.
        folder: Folder of the temporary file, if one is needed; by default the system's.
        width: Number of values in a row.
    """

    def __init__(self, limit: int, folder: Path | None = None, width: int = WIDTH) -> None:
        self._block_size = BLOCK * width * 4
        blocks = max(1, limit // self._block_size)
        self._memory = torch.empty(blocks * BLOCK, width)  # takes up only what is written to it
        self._file: BufferedRandom | None = None
        self._folder = folder
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, rows: Float32Array) -> None:
        """Add rows ``(k, width)``.

        Raises:
            WriteError: The disk is full.
        """
        end = self._count + len(rows)
        if self._file is None and end > len(self._memory):
            with self._writing():
                self._file = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115
            self._write(self._file, self._memory[: self._count].numpy())
        if self._file is None:
            self._memory[self._count : end] = torch.from_numpy(rows)
        else:
            self._write(self._file, rows)
        self._count = end

    def _write(self, file: BufferedRandom, rows: Float32Array) -> None:
        """Append rows to the temporary file and flush it, so that a full disk is noticed here."""
        with self._writing():
            file.seek(0, 2)
            file.write(np.ascontiguousarray(rows).data)
            file.flush()

    def _writing(self) -> AbstractContextManager[None]:
        """A context that names the temporary file if the disk is full."""
        return writing(f"a temporary file in {self._folder or tempfile.gettempdir()}")

    def buffers(self, order: torch.Generator | None = None) -> Iterator[Tensor]:
        """Every row once, in buffers of as many rows as fit in memory; each overwrites the last.

        Args:
            order: Generator that puts the blocks of the file in random order; without it they stay
                in the order of time. Rows within a block always do, so shuffle each buffer.
        """
        if self._file is None:
            yield self._memory[: self._count]
            return
        whole, rest = divmod(self._count, BLOCK)
        blocks = list(range(whole))
        if order is not None:
            blocks = torch.randperm(whole, generator=order).tolist()
        # An incomplete block always comes last, so that every epoch has buffers of the same sizes.
        if rest:
            blocks.append(whole)
        capacity = len(self._memory) // BLOCK
        for first in range(0, len(blocks), capacity):
            end = 0
            for block in blocks[first : first + capacity]:
                start = end
                end += min(BLOCK, self._count - block * BLOCK)
                self._file.seek(block * self._block_size)
                self._file.readinto(self._memory[start:end].numpy().data)
            yield self._memory[:end]

    def batches(self, batch: int) -> int:
        """The number of whole minibatches in an epoch; each buffer drops an incomplete last one.

        Args:
            batch: Rows in a minibatch.
        """
        capacity = len(self._memory)
        full, rest = divmod(self._count, capacity)
        return full * (capacity // batch) + rest // batch

    def moments(self) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation ``(width,)`` of every column, float64."""
        # Sum in parts, because a sum in float64 first copies its input to float64.
        total = sum(
            part.sum(0, dtype=torch.float64)
            for rows in self.buffers()
            for part in rows.split(ROWS_AT_A_TIME)
        )
        mean = torch.as_tensor(total) / len(self)
        # Center before summing the squares; the rows are float32, so float32 rounding is enough.
        center = mean.float()
        squares = sum(
            part.sub(center).square_().sum(0, dtype=torch.float64)
            for rows in self.buffers()
            for part in rows.split(ROWS_AT_A_TIME)
        )
        return mean, (torch.as_tensor(squares) / len(self)).sqrt()


def derive(frames: Frames, spec: PolicySpec) -> Float32Array:
    """Rows ``(n, width)``: inputs and targets [rad] of the n kept frames of a recording.

    Args:
        frames: Recorded ticks; for a layout with a history, including those before the kept ones.
        spec: How inputs and targets follow from frames: layout, gaits, phase, kp and kd.

    Raises:
        ValueError: A number is not finite, a tick or an applied torque is missing that a history
            needs, or a frame has a gait that the policies do not have.
    """
    seen = spec.observation
    history = seen.layout.history
    if len(frames) and frames.gait.max() >= len(seen.gaits):
        raise ValueError(
            f"frames of {frames.gait.max() + 1} gaits for a policy of {len(seen.gaits)}; give the "
            "policy all gaits of the data"
        )
    past = None
    if history is not None and len(frames):
        with np.errstate(over="ignore", invalid="ignore"):  # such frames are named below
            applied = target_of(frames.applied, frames.q, frames.v, spec)
            past = RecordedPast(frames, applied, history)
    kept = np.flatnonzero(frames.kept)
    frames = frames.kept_frames
    rows = np.empty((len(frames), seen.input_size + len(JOINTS)), np.float32)
    for start in range(0, len(frames), ROWS_AT_A_TIME):
        some = slice(start, start + ROWS_AT_A_TIME)
        part = frames[some]
        with np.errstate(over="ignore", invalid="ignore"):
            _fill(part, spec, rows[some], None if past is None else past.at(kept[some]))
        _check_finite(part, rows[some], start)
    return rows


def _fill(frames: Frames, spec: PolicySpec, out: Float32Array, past: Float32Array | None) -> None:
    """Write inputs and targets of frames into rows."""
    seen = spec.observation
    inputs = out[:, : seen.input_size]
    gait = frames.gait.astype(np.int64) if len(seen.gaits) > 1 else 0
    network_input(frames.state, frames.tick, frames.command, seen, inputs, past, gait)
    out[:, seen.input_size :] = target_of(frames.torque, frames.q, frames.v, spec)


def _check_finite(frames: Frames, rows: Float32Array, start: int) -> None:
    """Check that all numbers in frames and in the rows derived from them are finite.

    Args:
        frames: The frames.
        rows: The rows derived from them.
        start: Number of the first frame, for the message.

    Raises:
        ValueError: A number is not finite.
    """
    finite = np.ones(len(frames), bool)
    arrays = (frames.q, frames.v, frames.com, frames.feet, frames.command, frames.torque, rows)
    for array in arrays:
        finite &= np.isfinite(array).reshape(len(frames), -1).all(1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise ValueError(
            f"frame {start + bad} (episode {frames.episode[bad]}, tick {frames.tick[bad]}) holds "
            "numbers that are not finite; leave that episode out"
        )


def held_out(episode: IntArray, share: float) -> BoolArray:
    """``(n,)`` True for frames of episodes held out for validation, decided by the id alone.

    An episode and its parts (`frames.whole_episode`) are held out together: they share states, so
    otherwise a policy would be judged on states that it was trained on.

    Args:
        episode: ``(n,)`` episode ids.
        share: Share of the whole episodes that is held out, in the long run.
    """
    # The finalizer of SplitMix64 (Steele et al., 2014): neighboring ids land far apart.
    h = whole_episode(episode).astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h = h ^ (h >> np.uint64(31))
    return h / 2.0**64 < share
