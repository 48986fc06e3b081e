"""A dataset: a folder of immutable HDF5 shards of recorded ticks, and a manifest.

Only the ticks that a method keeps to train on count as frames, in every number and in the hash. The
ticks before them are stored too, because policies with a history need the past.

A shard counts once the manifest lists it. A kill between writing the shard and the manifest leaves
a file that the next ``append`` of that name overwrites. One process appends at a time; any number
may read. Read ``frames.py`` first, and ``samples.py`` next.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from surefoot.config.json_io import from_json
from surefoot.config.json_text import parse_json, read_file
from surefoot.errors import shown
from surefoot.files import write_atomic, write_json
from surefoot.learning.frames import (
    Frames,
    combine_digests,
    digest_of_all,
    episode_digests,
    sorted_by_episode,
    uninitialized_arrays,
    whole_episode,
)
from surefoot.learning.manifest import (
    MANIFEST_FILE,
    DatasetError,
    Manifest,
    ShardEntry,
    check_entries,
    check_new_name,
)
from surefoot.learning.shard import FORMAT, STORED, check_size, read_shard, shard_content
from surefoot.types import BoolArray, IntArray


class Dataset:
    """An append-only folder of shards. Counts and hash are read from its manifest alone.

    The exception is the number of frames in a view that cuts through a shard, which is then read.

    Args:
        folder: Folder of the files; the first ``append`` creates it.
        before: Episodes with this id or a larger one are left out, with their parts; such a view
            is read-only.
        skip_damaged: Whether shards that are lost or damaged are left out, with a warning that
            names them, and do not count in counts and hash. All shards are read to find out. Such a
            view is read-only, too.
        only: Ids of the episodes to keep; such a view is read-only. None keeps all.
    """

    def __init__(
        self,
        folder: Path | str,
        before: int | None = None,
        skip_damaged: bool = False,
        only: Collection[int] | None = None,
    ) -> None:
        self.folder = Path(folder)
        self._before = before
        self._only = None if only is None else frozenset(only)
        self._skip_damaged = skip_damaged
        self._is_whole: dict[str, bool] = {}

    def before(self, episode: int) -> Dataset:
        """A view of the dataset as it was before that episode, provided that ids grow with time."""
        return Dataset(self.folder, episode, self._skip_damaged, self._only)

    def only(self, episodes: Collection[int]) -> Dataset:
        """A view of some of the episodes; ids that the dataset lacks are ignored."""
        return Dataset(self.folder, self._before, self._skip_damaged, episodes)

    def append(self, name: str, frames: Frames) -> None:
        """Add frames as a shard, whole or not at all; adding the same frames again has no effect.

        Args:
            name: Name of the shard: letters, digits, ``_``, ``-`` and dots; not ``manifest``.
            frames: Whole episodes, none of which lies in another shard, as `Rollout.recording`
                gives them; may be empty.

        Raises:
            DatasetError: The name is taken by other frames or by the manifest, or an episode is in
                another shard, or this is a view.
            WriteError: The disk is full, or read-only.
        """
        # Appending to a view would drop the shards that it leaves out from the manifest.
        if self._leaves_out or self._skip_damaged:
            raise DatasetError(f"a view of {self.folder} is only read: append to the whole")
        check_new_name(name)
        frames = sorted_by_episode(frames)
        digests = episode_digests(frames)
        shards = self._shards()
        if name in shards:
            if shards[name].episodes == digests:
                if not self.shard_path(name).exists():  # lost since then: write the same frames
                    self._write(name, frames, digests, shards)
                return
            raise DatasetError(
                f"{self.shard_path(name)} already holds other frames under the name {name!r}; "
                "shards are never changed: append under a new name, or start a new dataset folder"
            )
        for other, entry in shards.items():
            if shared := digests.keys() & entry.episodes.keys():
                raise DatasetError(
                    f"episode {min(shared, key=int)} of {name!r} is already in shard {other!r} of "
                    f"{self.folder}; give every episode of a dataset an id of its own"
                )
        self._write(name, frames, digests, shards)

    def _write(
        self, name: str, frames: Frames, digests: dict[str, str], shards: dict[str, ShardEntry]
    ) -> None:
        """Write the file of a shard, and then the manifest with its entry."""
        write_atomic(self.shard_path(name), shard_content(frames))
        kept = int(frames.kept.sum())
        total = combine_digests(digests)
        shards[name] = ShardEntry(kept, total, digests, len(frames), digest_of_all(frames))
        write_json(self._manifest, Manifest(FORMAT, dict(sorted(shards.items()))))

    def holds(self, name: str, frames: Frames) -> bool:
        """Whether the frames are those of a shard, even if its file is lost.

        Args:
            name: Name of the shard.
            frames: Whole episodes.
        """
        entry = self._shards().get(name)
        return entry is not None and entry.episodes == episode_digests(sorted_by_episode(frames))

    def episode_ids(self, shards: Sequence[str] | None = None) -> list[int]:
        """The sorted ids of the episodes of the named shards, or of all; this reads no shard.

        Args:
            shards: Names of the shards; None for all.

        Raises:
            DatasetError: There is no such shard.
        """
        entries = self._ordered(shards).values()
        return sorted(int(id) for entry in entries for id in self._kept_episodes(entry))

    def load(self, shards: Sequence[str] | None = None, all_ticks: bool = False) -> Frames:
        """Frames of the named shards, or of all, in the order of their episode ids.

        Every shard is checked against its hash in the manifest.

        Args:
            shards: Names of the shards; None for all.
            all_ticks: Whether to give all recorded ticks, not only the kept frames.

        Raises:
            DatasetError: There is no such shard, or a file is missing, cut short or changed.
        """
        frames = self._read(self._ordered(shards))
        return self._chosen(sorted_by_episode(frames), all_ticks)

    def parts(self, all_ticks: bool = False) -> Iterator[Frames]:
        """The frames shard by shard, one in memory at a time, in the order of first episodes.

        Every shard is checked against its hash in the manifest.

        Args:
            all_ticks: Whether to give all recorded ticks, not only the kept frames.

        Raises:
            DatasetError: A file is missing, cut short or changed.
        """
        for name, entry in self._ordered().items():
            yield self._chosen(self._read({name: entry}), all_ticks)

    @property
    def shards(self) -> tuple[str, ...]:
        """Names of the shards, sorted."""
        return tuple(sorted(self._shards()))

    @property
    def frames(self) -> int:
        """Number of frames."""
        total = 0
        for name, entry in self._shards().items():
            if len(self._kept_episodes(entry)) == len(entry.episodes):
                total += entry.frames
            else:
                # The manifest does not say how long an episode is.
                total += len(self.load([name]))
        return total

    @property
    def episodes(self) -> int:
        """Number of episodes."""
        return sum(len(self._kept_episodes(entry)) for entry in self._shards().values())

    @property
    def hash(self) -> str:
        """SHA-256 of the kept frames, episode by episode, so that sharding does not matter.

        It covers `frames.FRAME_FIELDS` and the gait, but not the ticks before the kept ones, nor
        the applied torques (see `ticks_hash`).
        """
        digests: dict[str, str] = {}
        for entry in self._shards().values():
            digests |= self._kept_episodes(entry)
        return combine_digests(digests)

    @property
    def ticks_hash(self) -> str:
        """SHA-256 of all arrays of all ticks of whole shards, from which histories are made.

        Shards of format 1 only have the kept ticks.
        """
        digests = [entry.ticks_sha256 or entry.sha256 for entry in self._shards().values()]
        return hashlib.sha256("\n".join(sorted(digests)).encode()).hexdigest()

    @property
    def _manifest(self) -> Path:
        """The file that lists the shards."""
        return self.folder / MANIFEST_FILE

    def shard_path(self, name: str) -> Path:
        """The file of a shard."""
        return self.folder / f"{name}.h5"

    def _shards(self) -> dict[str, ShardEntry]:
        """The manifest's entries, without shards that are left out as a whole."""
        shards = self._read_manifest()
        if self._skip_damaged:
            shards = self._undamaged(shards)
        return {
            name: entry
            for name, entry in shards.items()
            if self._kept_episodes(entry) or not entry.episodes
        }

    def _read_manifest(self) -> dict[str, ShardEntry]:
        """All entries of the manifest; none if there is no such file."""
        if not self._manifest.exists():
            return {}
        try:
            values = parse_json(read_file(self._manifest))
            version = values.get("format") if isinstance(values, dict) else FORMAT
            if type(version) is int and version in STORED:
                manifest = from_json(Manifest, values, "the manifest")
                check_entries(manifest.shards)
                return manifest.shards
        except ValueError as error:
            raise DatasetError(
                f"{self._manifest} is not readable ({error}); restore it from a copy, or "
                "delete it: `surefoot train ... --resume` collects again, to the same bits"
            ) from error
        raise DatasetError(
            f"{self._manifest} has format {shown(version)}, this version reads formats 1 to "
            f"{FORMAT}; use the version of surefoot that wrote it"
        )

    def _undamaged(self, shards: dict[str, ShardEntry]) -> dict[str, ShardEntry]:
        """The entries whose files are whole; each file is read only once, with one warning."""
        damaged = []
        for name in shards.keys() - self._is_whole.keys():
            try:
                self._read({name: shards[name]})
            except DatasetError:
                damaged.append(name)
            self._is_whole[name] = name not in damaged
        if damaged:
            lost = sum(shards[name].frames for name in damaged)
            frames = sum(entry.frames for entry in shards.values())
            warnings.warn(
                f"{self.folder}: shards {sorted(damaged)} are missing or damaged and are skipped, "
                f"with {lost} of {frames} frames",
                stacklevel=2,
            )
        return {name: entry for name, entry in shards.items() if self._is_whole[name]}

    def _kept_episodes(self, entry: ShardEntry) -> dict[str, str]:
        """The episodes of a shard that are not left out, with their digests."""
        if not self._leaves_out:
            return entry.episodes
        kept = self._keeps(np.array([int(episode) for episode in entry.episodes], dtype=np.int64))
        chosen = zip(entry.episodes.items(), kept, strict=True)
        return {episode: digest for (episode, digest), keep in chosen if keep}

    def _chosen(self, frames: Frames, all_ticks: bool) -> Frames:
        """The frames of the episodes that are not left out; without all_ticks, only kept ones."""
        if self._leaves_out:
            frames = frames[self._keeps(frames.episode)]
        return frames if all_ticks else frames.kept_frames

    @property
    def _leaves_out(self) -> bool:
        """Whether this view leaves out episodes."""
        return self._before is not None or self._only is not None

    def _keeps(self, episode: IntArray) -> BoolArray:
        """``(n,)`` True for ids of episodes that are not left out."""
        kept = np.ones(len(episode), dtype=bool)
        if self._before is not None:
            kept &= whole_episode(episode) < self._before
        if self._only is not None:
            kept &= np.isin(episode, list(self._only))
        return kept

    def _ordered(self, shards: Sequence[str] | None = None) -> dict[str, ShardEntry]:
        """Entries of the named shards, or of all, by their first episodes."""
        entries = self._shards()
        names = list(entries if shards is None else dict.fromkeys(shards))
        if missing := [name for name in names if name not in entries]:
            raise DatasetError(
                f"{self.folder} has no shards {missing}; it has {sorted(entries) or 'none'}"
            )
        names.sort(key=lambda name: min(map(int, entries[name].episodes), default=-1))
        return {name: entries[name] for name in names}

    def _read(self, entries: Mapping[str, ShardEntry]) -> Frames:
        """The frames of these shards, one after the other, checked.

        Raises:
            DatasetError: A file is missing, cut short or changed.
        """
        for name, entry in entries.items():
            with self._naming(name):
                check_size(self.shard_path(name), entry.rows, entry.format)
        arrays = uninitialized_arrays(sum(entry.rows for entry in entries.values()))
        start = 0
        for name, entry in entries.items():
            part = slice(start, start + entry.rows)
            start = part.stop
            of_shard = {key: array[part] for key, array in arrays.items()}
            with self._naming(name):
                read_shard(self.shard_path(name), of_shard, entry.format)
                frames = Frames(**of_shard)
                found = (int(frames.kept.sum()), episode_digests(frames), digest_of_all(frames))
                if found != (entry.frames, entry.episodes, entry.ticks_sha256 or found[2]):
                    raise OSError("its contents do not match their hash")
        return Frames(**arrays)

    @contextmanager
    def _naming(self, name: str) -> Iterator[None]:
        """A context that turns an `OSError` into a `DatasetError` that names the shard."""
        try:
            yield
        except OSError as error:
            raise DatasetError(
                f"shard {self.shard_path(name)} is missing or damaged ({error}); restore the file "
                "from a copy, or delete it and repeat what made it: `surefoot train ... --resume` "
                "collects it again, `surefoot import-data` imports it again, to the same bits; or "
                "read what is left with Dataset(folder, skip_damaged=True)"
            ) from error
