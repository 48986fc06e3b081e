"""Recorded frames: arrays in memory, and a folder of immutable HDF5 shards with a manifest on disk.

A frame is what the robot measured at one tick and the expert's torque there. What the network sees
and what it should answer are derived from frames when training (``examples.derive``), so that an
observation or a gain can change without new rollouts.

A shard counts once the manifest names it. A kill between the two leaves a file that the next
``append`` of that name overwrites. One process appends at a time; any number may read.
"""

from __future__ import annotations

import hashlib
import json
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from surefoot.files import write_atomic
from surefoot.types import Array, BoolArray, IntArray, State

FORMAT = 1
"""Version of the shards and of the manifest."""

_FIELDS: dict[str, tuple[tuple[int, ...], str]] = {
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


class DatasetError(ValueError):
    """A dataset's files are damaged, or a request contradicts what it holds."""


@dataclass(frozen=True)
class Frames:
    """n recorded ticks of any robots, in the order of time within each episode.

    Attributes:
        q: ``(n, 19)`` configuration [m, unit quaternion, rad].
        v: ``(n, 18)`` velocity [m/s, rad/s], base part in the base frame.
        com: ``(n, 3)`` centre of mass, world frame [m].
        feet: ``(n, 4, 3)`` centres of the foot spheres, world frame [m].
        contacts: ``(n, 4)`` True where a foot carries load.
        tick: ``(n,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        torque: ``(n, 12)`` the expert's joint torque [Nm], clipped to the motor limit.
        expert_drove: ``(n,)`` True where that torque was applied, not only recorded.
        episode: ``(n,)`` episode id.
        outcome: ``(n,)`` int8, how the frame's episode ended.

    Raises:
        ValueError: an array has the wrong shape, or a type that would lose digits.
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
        for name, (shape, dtype) in _FIELDS.items():
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
        """Some of the frames, by slice, mask or indices."""
        return Frames(*(getattr(self, name)[index] for name in _FIELDS))

    @property
    def state(self) -> State:
        """The n states."""
        return State(self.q, self.v, self.com, self.feet, self.contacts)

    @property
    def hash(self) -> str:
        """SHA-256 of all arrays, episode by episode, as `Dataset.hash`."""
        return _combine(_digests(_by_episode(self)))

    @property
    def command_range(self) -> Array:
        """``(2, 3)`` smallest and largest vx, vy [m/s] and yaw rate [rad/s] among the frames."""
        return np.stack([self.command.min(0), self.command.max(0)])


def _blank(n: int) -> dict[str, NDArray]:
    """Uninitialised arrays for n frames."""
    return {name: np.empty((n, *shape), dtype) for name, (shape, dtype) in _FIELDS.items()}


def concatenate(parts: Sequence[Frames]) -> Frames:
    """Frames one after another; none at all of an empty list."""
    parts = [Frames(**_blank(0)), *parts]
    return Frames(*(np.concatenate([getattr(part, name) for part in parts]) for name in _FIELDS))


class Dataset:
    """An append-only folder of shards. Counts and hash are read from its manifest alone.

    Only the frames of a view that ends within a shard are counted in that shard's file.

    Args:
        folder: is created by the first ``append``.
        before: leave out episodes of this id or above; such a view is only read.
        skip_damaged: leave out shards that are lost or damaged, with a warning that names them:
            counts and hash are those of what is left. All shards are read to find out. Such a view
            is only read, too.
    """

    def __init__(
        self, folder: Path | str, before: int | None = None, skip_damaged: bool = False
    ) -> None:
        self.folder = Path(folder)
        self._before = before
        self._skip_damaged = skip_damaged
        self._whole: dict[str, bool] = {}

    def before(self, episode: int) -> Dataset:
        """The dataset as it was before that episode, if ids grow with time."""
        return Dataset(self.folder, episode, self._skip_damaged)

    def append(self, name: str, frames: Frames) -> None:
        """Add frames as a shard, whole or not at all; the same frames again change nothing.

        Args:
            name: of the shard: letters, digits, ``_``, ``-`` and dots.
            frames: whole episodes, none of which lies in another shard; may be empty.

        Raises:
            DatasetError: the name is taken by other frames, or an episode by another shard, or
                this is a view.
        """
        # The manifest would lose the shards that a view leaves out.
        if self._before is not None or self._skip_damaged:
            raise DatasetError(f"a view of {self.folder} is only read: append to the whole")
        if not re.fullmatch(r"\w[\w.-]*", name, re.ASCII):
            raise DatasetError(f"shard name {name!r}: use letters, digits, '_', '-' and dots")
        frames = _by_episode(frames)
        digests = _digests(frames)
        shards = self._shards()
        if name in shards:
            if shards[name]["episodes"] == digests:
                if not self.file(name).exists():  # lost since; nothing else changes
                    write_atomic(self.file(name), lambda path: _write(path, frames))
                return
            raise DatasetError(
                f"{self.file(name)} already holds other frames under the name {name!r}; shards "
                "are never changed: append under a new name, or start a new dataset folder"
            )
        for other, entry in shards.items():
            if shared := digests.keys() & entry["episodes"].keys():
                raise DatasetError(
                    f"episode {min(shared, key=int)} of {name!r} is already in shard {other!r} of "
                    f"{self.folder}; give every episode of a dataset an id of its own"
                )
        write_atomic(self.file(name), lambda path: _write(path, frames))
        shards[name] = {"frames": len(frames), "sha256": _combine(digests), "episodes": digests}
        manifest = {"format": FORMAT, "shards": dict(sorted(shards.items()))}
        write_atomic(self._manifest, json.dumps(manifest, indent=1).encode())

    def load(self, shards: Sequence[str] | None = None) -> Frames:
        """Frames of the named shards, or of all, in the order of their episode ids.

        Every shard is checked against its hash in the manifest.

        Raises:
            DatasetError: no such shard, or a file is missing, cut short or changed.
        """
        entries = self._ordered(shards)
        arrays = _blank(sum(entry["frames"] for entry in entries.values()))
        start = 0
        for name, entry in entries.items():
            part = slice(start, start + entry["frames"])
            start = part.stop
            self._read(name, entry, {key: array[part] for key, array in arrays.items()})
        return self._within(_by_episode(Frames(**arrays)))

    def parts(self) -> Iterator[Frames]:
        """The frames shard by shard, one in memory at a time, in the order of first episodes.

        Every shard is checked against its hash in the manifest.

        Raises:
            DatasetError: a file is missing, cut short or changed.
        """
        for name, entry in self._ordered().items():
            arrays = _blank(entry["frames"])
            self._read(name, entry, arrays)
            yield self._within(Frames(**arrays))

    @property
    def shards(self) -> tuple[str, ...]:
        """Names of the shards, sorted."""
        return tuple(sorted(self._shards()))

    @property
    def frames(self) -> int:
        """Number of frames."""
        return sum(
            entry["frames"]
            if len(self._ids(entry)) == len(entry["episodes"])
            # The manifest does not say how long an episode is.
            else len(self.load([name]))
            for name, entry in self._shards().items()
        )

    @property
    def episodes(self) -> int:
        """Number of episodes."""
        return sum(len(self._ids(entry)) for entry in self._shards().values())

    @property
    def hash(self) -> str:
        """SHA-256 of all arrays, episode by episode: the same however the frames are sharded."""
        return _combine({k: d for e in self._shards().values() for k, d in self._ids(e).items()})

    @property
    def _manifest(self) -> Path:
        return self.folder / "manifest.json"

    def file(self, name: str) -> Path:
        """File of a shard."""
        return self.folder / f"{name}.h5"

    def _shards(self) -> dict[str, dict[str, Any]]:
        """The manifest's entries: frames, sha256, and episode id -> sha256 of its arrays."""
        try:
            manifest = json.loads(self._manifest.read_bytes())
        except FileNotFoundError:
            return {}
        except ValueError as error:
            raise DatasetError(
                f"{self._manifest} is not readable JSON ({error}); restore it from a copy, or "
                "delete it: `surefoot train ... --resume` collects again, to the same bits"
            ) from error
        if manifest.get("format") != FORMAT:
            raise DatasetError(
                f"{self._manifest} has format {manifest.get('format')}, this version reads format "
                f"{FORMAT}; use the version of surefoot that wrote it"
            )
        shards = manifest["shards"]
        if self._skip_damaged:
            shards = self._undamaged(shards)
        return {
            name: entry
            for name, entry in shards.items()
            if self._ids(entry) or not entry["episodes"]
        }

    def _undamaged(self, shards: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        """The entries whose files are whole; each file is read once, and warned of once."""
        damaged = {}
        for name in shards.keys() - self._whole.keys():
            try:
                self._read(name, shards[name], _blank(shards[name]["frames"]))
            except DatasetError:
                damaged[name] = shards[name]["frames"]
            self._whole[name] = name not in damaged
        if damaged:
            frames = sum(entry["frames"] for entry in shards.values())
            warnings.warn(
                f"{self.folder}: shards {sorted(damaged)} are missing or damaged and are skipped, "
                f"with {sum(damaged.values())} of {frames} frames",
                stacklevel=2,
            )
        return {name: entry for name, entry in shards.items() if self._whole[name]}

    def _ids(self, entry: dict[str, Any]) -> dict[str, str]:
        """Of a shard's episodes those that are not left out, with their digests."""
        digests, before = entry["episodes"], self._before
        return digests if before is None else {k: d for k, d in digests.items() if int(k) < before}

    def _within(self, frames: Frames) -> Frames:
        """Of frames sorted by episode those that are not left out."""
        if self._before is None:
            return frames
        return frames[: int(np.searchsorted(frames.episode, self._before))]

    def _ordered(self, shards: Sequence[str] | None = None) -> dict[str, dict[str, Any]]:
        """Entries of the named shards, or of all, by their first episodes."""
        entries = self._shards()
        names = list(entries if shards is None else dict.fromkeys(shards))
        if missing := [name for name in names if name not in entries]:
            raise DatasetError(
                f"{self.folder} has no shards {missing}; it has {sorted(entries) or 'none'}"
            )
        names.sort(key=lambda name: min(map(int, entries[name]["episodes"]), default=-1))
        return {name: entries[name] for name in names}

    def _read(self, name: str, entry: dict[str, Any], arrays: dict[str, NDArray]) -> None:
        """Fill the arrays from a shard and check them."""
        path = self.file(name)
        try:
            with h5py.File(path, "r") as file:
                for key, array in arrays.items():
                    stored = file[key]
                    if not isinstance(stored, h5py.Dataset) or stored.shape != array.shape:
                        raise OSError(f"{key} has the wrong shape")
                    if array.size:
                        stored.read_direct(array)
            if _combine(_digests(Frames(**arrays))) != entry["sha256"]:
                raise OSError("its contents do not match their hash")
        except (OSError, KeyError, RuntimeError) as error:
            raise DatasetError(
                f"shard {path} is missing or damaged ({error}); restore the file from a copy, or "
                "delete it: `surefoot train ... --resume` collects it again, to the same bits; or "
                "read what is left with Dataset(folder, skip_damaged=True)"
            ) from error


def _write(path: Path, frames: Frames) -> None:
    """Write a shard: one HDF5 dataset per array, uncompressed."""
    try:
        with h5py.File(path, "w") as file:
            file.attrs["format"] = FORMAT
            for name in _FIELDS:
                file.create_dataset(name, data=getattr(frames, name))
    except RuntimeError as error:  # what HDF5 says when a full disk keeps it from closing a file
        raise OSError(str(error)) from error


def _by_episode(frames: Frames) -> Frames:
    """The frames sorted by episode id, keeping the order within an episode."""
    if (np.diff(frames.episode) >= 0).all():
        return frames
    return frames[np.argsort(frames.episode, kind="stable")]


def _digests(frames: Frames) -> dict[str, str]:
    """Episode id -> SHA-256 of that episode's arrays; frames sorted by episode."""
    ids, starts, counts = np.unique(frames.episode, return_index=True, return_counts=True)
    digests = {}
    for episode, start, count in zip(ids.tolist(), starts, counts, strict=True):
        sha = hashlib.sha256()
        for name in _FIELDS:
            array = np.ascontiguousarray(getattr(frames, name)[start : start + count])
            sha.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
            sha.update(array.data)
        digests[str(episode)] = sha.hexdigest()
    return digests


def _combine(digests: dict[str, str]) -> str:
    """SHA-256 over episodes in the order of their ids."""
    lines = (f"{episode} {digests[episode]}\n" for episode in sorted(digests, key=int))
    return hashlib.sha256("".join(lines).encode()).hexdigest()
