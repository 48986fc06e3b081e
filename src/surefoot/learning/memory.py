"""The memory of a policy: samples of the last ticks, online in a ring and offline from recordings.

Both ways give the same bits. At the start of an episode the first sample stands for the whole past,
with joint angles in place of joint targets, because there are none yet: the target of that tick is
what the policy is about to compute. The memory is updated whoever drives: the target of a tick is
the one for which the policy's PD gives the commanded torque. Read ``policy.py`` next.
"""

from __future__ import annotations

import numpy as np

from surefoot.learning.frames import Frames
from surefoot.learning.layouts import TARGET_SIZE, History
from surefoot.learning.observation import Float32Array, observe
from surefoot.types import Array, IntArray, State


def samples_of(state: State, target: Array, history: History) -> Float32Array:
    """``(..., sample_size)`` the samples of states, with the joint targets applied there.

    Args:
        state: States with any leading axes.
        target: ``(..., 12)`` joint targets [rad].
        history: The parts of a sample.
    """
    out = np.empty((*state.q.shape[:-1], history.sample_size), np.float32)
    now = history.sample_size - TARGET_SIZE * history.targets
    observe(state, history.parts, out=out[..., :now])
    if history.targets:
        out[..., now:] = target
    return out


class Memory:
    """The last ticks of B robots, as a ring buffer: tick n is in row n modulo the reach.

    Args:
        history: What is remembered.
        batch: The number of robots B.

    Attributes:
        history: What is remembered.
        ring: ``(reach, B, sample_size)`` the samples of the last ticks.
    """

    def __init__(self, history: History, batch: int) -> None:
        self.history = history
        self._count = 0
        self.ring = np.empty((history.reach, batch, history.sample_size), np.float32)

    @property
    def batch(self) -> int:
        """The number of robots."""
        return self.ring.shape[1]

    @property
    def begins(self) -> bool:
        """Whether the episode begins: no tick has been stored yet."""
        return self._count == 0

    def rows(self) -> IntArray:
        """``(samples,)`` rows of the ring that have the samples now, the oldest first."""
        return (self._count - self.history.ages) % len(self.ring)

    def next_row(self) -> int:
        """The row of the ring for the sample of this tick, which counts as stored from now on."""
        row = self._count % len(self.ring)
        self._count += 1
        return row

    def repeat(self, ticks: int) -> None:
        """Repeat the last sample for ticks that were missed; without a sample, do nothing.

        Args:
            ticks: Number of missed ticks.
        """
        if self.begins or ticks == 0:
            return
        last = self.ring[(self._count - 1) % len(self.ring)].copy()
        for _ in range(min(ticks, len(self.ring))):
            self.ring[self.next_row()] = last

    def read(self, state: State) -> Float32Array:
        """``(B, size)`` the samples of the past.

        Args:
            state: The states of this tick, which stand for the past if the episode begins.
        """
        if self.begins:
            self._fill(state)
        return np.swapaxes(self.ring[self.rows()], 0, 1).reshape(self.batch, -1)

    def store(self, state: State, target: Array) -> None:
        """Remember a tick.

        Args:
            state: The states of B robots, as they measured them.
            target: ``(B, 12)`` the joint targets that were applied [rad].
        """
        if self.begins:
            self._fill(state)
        self.ring[self.next_row()] = samples_of(state, target, self.history)

    def _fill(self, state: State) -> None:
        """Fill the ring with the first states, which stand for all ticks before them."""
        self.ring[:] = samples_of(state, state.q[..., 7:], self.history)


class RecordedPast:
    """The samples that `Memory.read` would have returned at recorded ticks.

    Args:
        frames: Ticks in the order of time within each episode, including the past of every tick
            that `at` is called for.
        target: ``(n, 12)`` the joint targets that were applied [rad].
        history: What is remembered.
    """

    def __init__(self, frames: Frames, target: Array, history: History) -> None:
        self._frames = frames
        self._history = history
        self._samples = samples_of(frames.state, target, history)
        self._is_unknown = np.asarray(np.isnan(frames.applied).any(axis=1))

    def at(self, rows: IntArray) -> Float32Array:
        """``(k, size)`` the samples of the past of some ticks.

        Args:
            rows: ``(k,)`` rows of the ticks.

        Raises:
            ValueError: A tick of the past is missing, or the torque applied in it is unknown.
        """
        size = self._history.sample_size
        out = np.empty((len(rows), self._history.size), np.float32)
        for number, age in enumerate(self._history.ages.tolist()):
            elapsed = self._frames.elapsed[rows].astype(np.int64) - age
            source = self._rows_at(np.maximum(elapsed, 0), rows)
            sample = out[:, number * size : (number + 1) * size]
            sample[:] = self._samples[source]
            if self._history.targets:
                before = elapsed < 0
                sample[before, size - TARGET_SIZE :] = self._frames.q[source[before], 7:]
                self._check_applied(source[~before])
        return out

    def _check_applied(self, rows: IntArray) -> None:
        """Check that the torques applied at some ticks are known.

        Args:
            rows: ``(k,)`` rows of the ticks.

        Raises:
            ValueError: The torque of a tick is unknown.
        """
        unknown = self._is_unknown[rows]
        if unknown.any():
            row = rows[unknown.argmax()]
            raise ValueError(
                f"it is not known which torque was applied in tick {self._frames.tick[row]} of "
                f"episode {self._frames.episode[row]}, where the expert did not drive, but the "
                "layout remembers joint targets: import the log again with the array `applied`, "
                "the torque of whoever drove, or use policy.layout full"
            )

    def _rows_at(self, elapsed: IntArray, rows: IntArray) -> IntArray:
        """``(k,)`` rows of earlier ticks of the same episodes.

        Args:
            elapsed: ``(k,)`` the wanted ticks, counted from the beginning of the episodes.
            rows: ``(k,)`` rows of later ticks of these episodes.

        Raises:
            ValueError: A wanted tick is missing.
        """
        frames = self._frames
        source = np.clip(rows - (frames.elapsed[rows] - elapsed), 0, len(frames) - 1)
        found = (frames.elapsed[source] == elapsed) & (
            frames.episode[source] == frames.episode[rows]
        )
        if not found.all():
            raise ValueError(
                f"episode {frames.episode[rows][found.argmin()]} lacks ticks that a layout with a "
                "history needs, which are not only those that were kept: load them with "
                "Dataset.load(all_ticks=True) or take them from Rollout.recording. Data of format "
                "1 do not hold them, and logs that an earlier version imported do not number them: "
                "collect or import again, or use policy.layout full"
            )
        return source
