"""Recorded frames in memory: arrays over ticks, with a hash by episodes, not by files.

A frame is what the robot measured at one tick and the expert's torque there. What the network sees
and what it should give are derived from frames when training (``samples.derive``), so that an
observation or a gain can change without new rollouts. Read next: ``dataset.py``, which keeps frames
on disk.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.types import Array, BoolArray, IntArray, State

FIELDS: dict[str, tuple[tuple[int, ...], str]] = {
    "q": ((19,), "<f8"),
    "v": ((18,), "<f8"),
    "com": ((3,), "<f8"),
    "feet": ((4, 3), "<f8"),
    "contacts": ((4,), "|b1"),
    "tick": ((), "<i8"),
    "command": ((3,), "<f8"),
    "torque": ((12,), "<f8"),
    "expert_drove": ((), "|b1"),
    "episode": ((), "<i8"),
    "outcome": ((), "|i1"),
}
"""Shape of one frame's part of each array, and the type on disk."""
PART = 1_000_000_000_000
"""Part n of an episode, from 1 on, has this many times n more than the episode as its id."""


def whole_episode(episode: IntArray) -> IntArray:
    """``(n,)`` ids of the whole episodes that parts belong to; a whole episode is its own.

    A part repeats states of its episode (LocoDAGGER's expert rollouts begin in them), so whatever
    keeps episodes apart has to keep these together.

    Args:
        episode: ``(n,)`` ids of whole episodes and of parts.
    """
    return episode % PART


@dataclass(frozen=True)
class Frames:
    """n recorded ticks of any robots, in the order of time within each episode.

    Attributes:
        q: ``(n, 19)`` configuration [m, unit quaternion, rad].
        v: ``(n, 18)`` velocity [m/s, rad/s], base part in the base frame.
        com: ``(n, 3)`` center of mass, world frame [m].
        feet: ``(n, 4, 3)`` centers of the foot spheres, world frame [m].
        contacts: ``(n, 4)`` True where a foot carries load.
        tick: ``(n,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        torque: ``(n, 12)`` the expert's joint torque [N m], clipped to the motor limit.
        expert_drove: ``(n,)`` True where that torque was applied, not only recorded.
        episode: ``(n,)`` id of the episode, or of a part of one (`whole_episode`).
        outcome: ``(n,)`` int8, how the frame's episode ended.

    Raises:
        ValueError: An array has the wrong shape, or a type that would lose digits.
    """

    q: Array
    v: Array
    com: Array
    feet: Array
    contacts: BoolArray
    tick: IntArray
    command: Array
    torque: Array
    expert_drove: BoolArray
    episode: IntArray
    outcome: NDArray[np.int8]

    def __post_init__(self) -> None:
        """Check shapes, and bring every array to its type on disk."""
        n = len(self.q)
        for name, (shape, dtype) in FIELDS.items():
            array = np.asarray(getattr(self, name))
            if array.shape != (n, *shape) or not np.can_cast(array.dtype, dtype):
                raise ValueError(
                    f"frames: {name} is {array.shape} {array.dtype}, "
                    f"expected {(n, *shape)} {np.dtype(dtype)}"
                )
            object.__setattr__(self, name, array.astype(dtype, copy=False))

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, index: slice | NDArray) -> Frames:
        """A part of the frames, by slice, mask or indices."""
        return Frames(*(getattr(self, name)[index] for name in FIELDS))

    @property
    def state(self) -> State:
        """The n states."""
        return State(self.q, self.v, self.com, self.feet, self.contacts)

    @property
    def hash(self) -> str:
        """SHA-256 of all arrays, episode by episode, as `Dataset.hash`."""
        return combine_digests(episode_digests(sorted_by_episode(self)))

    @property
    def command_range(self) -> Array:
        """``(2, 3)`` smallest and largest vx, vy [m/s] and yaw rate [rad/s] among the frames."""
        return np.stack([self.command.min(0), self.command.max(0)])


def uninitialized_arrays(n: int) -> dict[str, NDArray]:
    """Uninitialized arrays for n frames."""
    return {name: np.empty((n, *shape), dtype) for name, (shape, dtype) in FIELDS.items()}


def concatenate(parts: Sequence[Frames]) -> Frames:
    """Frames one after another; an empty list gives no frames."""
    parts = [Frames(**uninitialized_arrays(0)), *parts]
    return Frames(*(np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS))


def sorted_by_episode(frames: Frames) -> Frames:
    """The frames sorted by episode id, keeping the order within an episode."""
    if (np.diff(frames.episode) >= 0).all():
        return frames
    return frames[np.argsort(frames.episode, kind="stable")]


def episode_digests(frames: Frames) -> dict[str, str]:
    """Episode id -> SHA-256 of that episode's arrays; frames sorted by episode."""
    ids, starts, counts = np.unique(frames.episode, return_index=True, return_counts=True)
    digests = {}
    for episode, start, count in zip(ids.tolist(), starts, counts, strict=True):
        sha = hashlib.sha256()
        for name in FIELDS:
            array = np.ascontiguousarray(getattr(frames, name)[start : start + count])
            sha.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
            sha.update(array.data)
        digests[str(episode)] = sha.hexdigest()
    return digests


def combine_digests(digests: dict[str, str]) -> str:
    """SHA-256 over episodes in the order of their ids."""
    lines = (f"{episode} {digests[episode]}\n" for episode in sorted(digests, key=int))
    return hashlib.sha256("".join(lines).encode()).hexdigest()
