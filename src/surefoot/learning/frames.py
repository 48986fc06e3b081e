"""Recorded frames in memory: arrays over ticks, with a hash by episodes, not by files.

A frame is the state of the robot at one tick and the expert's torque there. The network's inputs
and targets are derived from frames when training (``samples.derive``), so that an observation or a
gain can change without new rollouts. A policy's memory at a frame comes from the ticks before it,
kept or not: a recording includes those too, as far back as a history may reach, and marks the ticks
that the method keeps to train on. Read next: ``dataset.py``, which keeps frames on disk.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.types import Array, BoolArray, IntArray, State

Fields = dict[str, tuple[tuple[int, ...], str]]
"""Arrays by name: the shape of each for a single frame, and the type on disk."""
FRAME_FIELDS: Fields = {
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
"""The arrays of a frame, which its hash covers; shards of format 1 have only these."""
FIELDS: Fields = FRAME_FIELDS | {
    "gait": ((), "|i1"),
    "kept": ((), "|b1"),
    "applied": ((12,), "<f8"),
    "elapsed": ((), "<i4"),
}
"""All arrays of a recording."""
UNKNOWN: Any = None
"""Placeholder for an array that is not given; `Frames` fills it in."""
PART = 1_000_000_000_000
"""The id of part n of an episode, from 1 on, is the episode's id plus n times this."""


def whole_episode(episode: IntArray) -> IntArray:
    """``(n,)`` ids of the whole episodes that parts belong to; a whole episode keeps its id.

    A part repeats states of its episode (LocoDAGGER's expert rollouts begin in them), so a split by
    episodes has to keep the parts together.

    Args:
        episode: ``(n,)`` ids of whole episodes and of parts.
    """
    return episode % PART


@dataclass(frozen=True)
class Frames:
    """n recorded ticks of any robots, in the order of time within each episode.

    By default the last four arrays mean that the gait is the first one, that all ticks are kept,
    that the expert drove, and that the elapsed time is unknown.

    Attributes:
        q: ``(n, 19)`` configuration [m, unit quaternion, rad].
        v: ``(n, 18)`` velocity [m/s, rad/s], base part in the base frame.
        com: ``(n, 3)`` center of mass, world frame [m].
        feet: ``(n, 4, 3)`` centers of the foot spheres, world frame [m].
        contacts: ``(n, 4)`` True where a foot carries load.
        tick: ``(n,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        torque: ``(n, 12)`` the expert's joint torque [N m], clipped to the motor limit.
        expert_drove: ``(n,)`` True where this torque was applied, not only recorded.
        episode: ``(n,)`` id of the episode, or of a part of one (`whole_episode`).
        outcome: ``(n,)`` int8, how the frame's episode ended.
        gait: ``(n,)`` int8, number of the run's gait that the robot was to walk.
        kept: ``(n,)`` True for ticks to train on; the others only provide the past of those.
        applied: ``(n, 12)`` the torque that was commanded by whoever drove [N m], clipped; NaN
            where it is unknown.
        elapsed: ``(n,)`` int32, ticks since the episode began, or for a query of LocoDAGGER, since
            the rollout that it continues began; -1 where unknown.

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
    gait: NDArray[np.int8] = UNKNOWN
    kept: BoolArray = UNKNOWN
    applied: Array = UNKNOWN
    elapsed: NDArray[np.int32] = UNKNOWN

    def __post_init__(self) -> None:
        """Fill in what is not given, check shapes, and convert every array to its type on disk."""
        n = len(self.q)
        for name, value in (
            ("gait", np.zeros(n, np.int8)),
            ("kept", np.ones(n, dtype=bool)),
            ("applied", self.torque),
            ("elapsed", np.full(n, -1, np.int32)),
        ):
            if getattr(self, name) is UNKNOWN:
                object.__setattr__(self, name, value)
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
    def kept_frames(self) -> Frames:
        """The ticks to train on."""
        return self if self.kept.all() else self[self.kept]

    @property
    def hash(self) -> str:
        """SHA-256 of the kept frames, episode by episode, as `Dataset.hash`."""
        return combine_digests(episode_digests(sorted_by_episode(self)))

    @property
    def ticks_hash(self) -> str:
        """SHA-256 of all arrays of all ticks, in the order of the episodes."""
        return digest_of_all(sorted_by_episode(self))

    @property
    def command_range(self) -> Array:
        """``(2, 3)`` smallest and largest vx, vy [m/s] and yaw rate [rad/s] among all ticks."""
        return np.stack([self.command.min(0), self.command.max(0)])


def uninitialized_arrays(n: int) -> dict[str, NDArray]:
    """Uninitialized arrays for n frames."""
    return {name: np.empty((n, *shape), dtype) for name, (shape, dtype) in FIELDS.items()}


def concatenate(parts: Sequence[Frames]) -> Frames:
    """Concatenate frames; an empty list gives no frames."""
    parts = [Frames(**uninitialized_arrays(0)), *parts]
    return Frames(*(np.concatenate([getattr(part, name) for part in parts]) for name in FIELDS))


def sorted_by_episode(frames: Frames) -> Frames:
    """The frames sorted by episode id, keeping the order within an episode."""
    if (np.diff(frames.episode) >= 0).all():
        return frames
    return frames[np.argsort(frames.episode, kind="stable")]


def episode_digests(frames: Frames) -> dict[str, str]:
    """Episode id -> SHA-256 of that episode's kept frames; the frames must be sorted by episode.

    The hash covers `FRAME_FIELDS`, as in versions without other fields, and also the gait if any
    frame of the episode is not in the first one.
    """
    frames = frames.kept_frames
    ids, starts, counts = np.unique(frames.episode, return_index=True, return_counts=True)
    digests = {}
    for episode, start, count in zip(ids.tolist(), starts, counts, strict=True):
        sha = hashlib.sha256()
        part = slice(start, start + count)
        names = [*FRAME_FIELDS, "gait"] if frames.gait[part].any() else [*FRAME_FIELDS]
        for name in names:
            _add(sha, name, getattr(frames, name)[part])
        digests[str(episode)] = sha.hexdigest()
    return digests


def digest_of_all(frames: Frames) -> str:
    """SHA-256 of all arrays of all ticks, in the order given."""
    sha = hashlib.sha256()
    for name in FIELDS:
        _add(sha, name, getattr(frames, name))
    return sha.hexdigest()


def _add(sha: Any, name: str, array: NDArray) -> None:
    """Add an array to a hash, with its name, type and shape."""
    array = np.ascontiguousarray(array)
    sha.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
    sha.update(array.data)


def combine_digests(digests: dict[str, str]) -> str:
    """SHA-256 over episodes in the order of their ids."""
    lines = (f"{episode} {digests[episode]}\n" for episode in sorted(digests, key=int))
    return hashlib.sha256("".join(lines).encode()).hexdigest()
