"""The manifest of a dataset: its shards, and the hashes of their contents.

The frames, which are the ticks that a method keeps to train on, are hashed by episode, so that the
hash does not depend on the shards. All ticks of a shard have a separate hash. Read next:
``dataset.py``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from surefoot.errors import shown
from surefoot.learning.frames import combine_digests
from surefoot.learning.shard import FORMAT

MANIFEST_FILE = "manifest.json"
"""File in a dataset's folder that lists its shards."""


class DatasetError(ValueError):
    """A dataset's files are damaged, or a request contradicts its contents."""


@dataclass(frozen=True)
class ShardEntry:
    """The manifest's entry of a shard.

    Attributes:
        frames: Number of kept frames.
        sha256: Hash of all kept frames.
        episodes: Hash of each episode's kept frames, by the episode's id as text.
        ticks: Number of all ticks; None in format 1, whose files only have the kept frames.
        ticks_sha256: Hash of all arrays of all ticks; None in format 1.
    """

    frames: int
    sha256: str
    episodes: dict[str, str]
    ticks: int | None = None
    ticks_sha256: str | None = None

    @property
    def rows(self) -> int:
        """Number of ticks in the file."""
        return self.frames if self.ticks is None else self.ticks

    @property
    def format(self) -> int:
        """Version of the file."""
        return 1 if self.ticks is None else FORMAT


@dataclass(frozen=True)
class Manifest:
    """The contents of a dataset, as in its ``manifest.json``.

    Attributes:
        format: Version of the shards and of the manifest.
        shards: The shards, by name.
    """

    format: int
    shards: dict[str, ShardEntry]


def check_entries(shards: Mapping[str, ShardEntry]) -> None:
    """Check that entries have valid names, are consistent, and share no episode.

    Raises:
        ValueError: An entry's name is invalid, its numbers or hashes do not agree, or an episode is
            not a number or is also in another entry.
    """
    shard_of = {}
    for name, entry in shards.items():
        check_name(name)
        if not min(entry.frames, 1) <= len(entry.episodes) <= entry.frames:
            raise ValueError(
                f"shard {name!r} has {entry.frames} frames and {len(entry.episodes)} episodes"
            )
        if entry.rows < entry.frames or (entry.ticks is None) != (entry.ticks_sha256 is None):
            raise ValueError(
                f"shard {name!r} has {entry.frames} frames and {entry.ticks} ticks with the hash "
                f"{shown(entry.ticks_sha256)}"
            )
        for episode in entry.episodes:
            if not re.fullmatch(r"0|-?[1-9]\d{0,18}", episode, re.ASCII):
                raise ValueError(f"shard {name!r} has an episode {shown(episode)}, not a number")
            if episode in shard_of:
                raise ValueError(f"episode {episode} is in {shard_of[episode]!r} and in {name!r}")
            shard_of[episode] = name
        if combine_digests(entry.episodes) != entry.sha256:
            raise ValueError(f"the hashes of the episodes of {name!r} do not match its own")


def check_name(name: str) -> None:
    """Check that a shard's name cannot lead out of the dataset's folder.

    Raises:
        DatasetError: The name has other characters than allowed.
    """
    if not re.fullmatch(r"\w[\w.-]*", name, re.ASCII):
        raise DatasetError(
            f"shard name {shown(name)}: use letters without accents, digits, '_', '-' and dots, "
            "the last two not at the beginning"
        )


def check_new_name(name: str) -> None:
    """Check that a name is allowed for a new shard.

    Raises:
        DatasetError: The name has other characters than allowed, or is that of the manifest.
    """
    check_name(name)
    if name == Path(MANIFEST_FILE).stem:
        raise DatasetError(f"shard name {name!r}: the manifest has it; use another one")
