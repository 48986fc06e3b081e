"""Stored starts: every method, expert and version is tried from the same states.

A set is written once (``scripts/make_starts.py``) and never changed; its hash stands beside every
result taken on it. Four splits: ``nominal`` states of a settled gait cycle, and perturbed ones to
``train`` on, to ``select`` a policy on, and to ``test`` it on once.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib.resources import files
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import unknown
from surefoot.files import write_atomic
from surefoot.types import Array, IntArray

SPLITS = ("nominal", "train", "select", "test")
PACKAGED = ("solo12-trot-v1", "solo12-trot-v1-wide")
"""The sets that come with the package: Solo12, trot, 0 to 0.3 m/s forward, perturbed with the
paper's standard deviations; and with 1.5 times those."""


@dataclass(frozen=True)
class Starts:
    """n states to start from.

    Attributes:
        q: ``(n, 19)`` configuration, x = y = 0 [m, unit quaternion, rad].
        v: ``(n, 18)`` velocity [m/s, rad/s], base part in the base frame.
        tick: ``(n,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        id: ``(n,)`` row in the stored set.
    """

    q: Array
    v: Array
    tick: IntArray
    command: Array
    id: IntArray

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice | NDArray) -> Starts:
        """Some of the starts."""
        return Starts(*(getattr(self, field.name)[rows] for field in fields(self)))


def join(parts: Sequence[Starts]) -> Starts:
    """Starts one after another; of at least one part."""
    names = [field.name for field in fields(Starts)]
    return Starts(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def at_rest(q: Array, commands: Array) -> Starts:
    """Starts at rest in one configuration, at the beginning of the gait cycle; in no stored set.

    Args:
        q: ``(19,)`` configuration.
        commands: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s].
    """
    n = len(commands)
    zero = np.zeros(n, dtype=np.int64)
    return Starts(np.tile(q, (n, 1)), np.zeros((n, 18)), zero, np.array(commands, float), zero - 1)


@dataclass(frozen=True)
class StartSet:
    """A stored set of starts.

    Attributes:
        name: of the set; new states get a new name.
        grid: split -> Starts of shape (perturbations, phases, velocities), flattened in this order.
        shape: split -> that shape.
    """

    name: str
    grid: dict[str, Starts]
    shape: dict[str, tuple[int, int, int]]

    def __getitem__(self, split: str) -> Starts:
        """All starts of a split; the first phases x velocities of them are one perturbation each.

        Raises:
            KeyError: there is no such split.
        """
        if split not in self.grid:
            raise KeyError(f"starts {self.name!r} have no split {split!r}; there are {SPLITS}")
        return self.grid[split]

    def first(self, split: str, n: int) -> Starts:
        """The first n starts of a split.

        Raises:
            KeyError: there is no such split.
            ValueError: it holds fewer, or n is none.
        """
        some = self[split]
        if not 1 <= n <= len(some):
            raise ValueError(
                f"{n} episodes asked for, the starts {self.name!r} hold {len(some)} in {split!r}; "
                f"use 1 to {len(some)}"
            )
        return some[:n]

    def rows(self, split: str) -> IntArray:
        """``(perturbations, phases, velocities)`` indices into the split."""
        return np.arange(len(self[split])).reshape(self.shape[split])

    def velocities(self, split: str, n: int) -> IntArray:
        """Indices of n equally spaced velocities of a split, both ends included.

        Raises:
            KeyError: there is no such split.
            ValueError: it holds fewer, or n is none.
        """
        available = self.rows(split).shape[2]
        if not 1 <= n <= available:
            raise ValueError(
                f"{n} velocities asked for, the starts {self.name!r} hold {available} in "
                f"{split!r}; use 1 to {available}"
            )
        return np.round(np.linspace(0, available - 1, n)).astype(np.int64)

    @property
    def hash(self) -> str:
        """SHA-256 over the arrays of all splits; stands beside every result."""
        sha = hashlib.sha256()
        for split in SPLITS:
            for field in fields(Starts):
                sha.update(np.ascontiguousarray(getattr(self.grid[split], field.name)).data)
        return sha.hexdigest()


def load_starts(which: str | Path = PACKAGED[0]) -> StartSet:
    """Read a set of starts: one that comes with the package, by its name, or a file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is not a set of starts.
    """
    name = Path(which).stem
    if which in PACKAGED:
        content = files("surefoot.scenarios").joinpath(f"data/{name}.npz").read_bytes()
    elif Path(which).is_file():
        content = Path(which).read_bytes()
    else:
        raise FileNotFoundError(unknown("set of starts (or file)", str(which), PACKAGED))
    try:
        with np.load(BytesIO(content), allow_pickle=False) as stored:
            arrays = {key: stored[key] for key in stored.files}
        shapes = [(int(a), int(b), int(c)) for a, b, c in arrays["shapes"]]
        bounds = np.cumsum([0, *(np.prod(shapes, axis=1))])
        everything = Starts(
            arrays["q"],
            arrays["v"],
            arrays["tick"].astype(np.int64),
            arrays["command"],
            np.arange(bounds[-1]),
        )
        expected = {"q": (19,), "v": (18,), "tick": (), "command": (3,)}
        for key, shape in expected.items():
            if arrays[key].shape != (bounds[-1], *shape) or len(shapes) != len(SPLITS):
                raise ValueError(f"{key} has shape {arrays[key].shape}")
    except FileNotFoundError:
        raise
    except Exception as error:  # whatever zip, zlib and NumPy make of a damaged file
        raise ValueError(f"{which} is not a set of starts ({error}); write it again") from error
    grid = {
        split: everything[slice(start, stop)]
        for split, start, stop in zip(SPLITS, bounds[:-1], bounds[1:], strict=True)
    }
    return StartSet(name, grid, dict(zip(SPLITS, shapes, strict=True)))


def save_starts(starts: StartSet, path: Path) -> None:
    """Write a set, whole or not at all; an existing file is never overwritten.

    Raises:
        FileExistsError: a set of this name exists already; new states get a new name.
    """
    if path.exists():
        raise FileExistsError(f"{path} exists; a set of starts is never changed: use a new name")
    buffer = BytesIO()
    parts = [starts.grid[split] for split in SPLITS]
    np.savez_compressed(
        buffer,
        q=np.concatenate([part.q for part in parts]),
        v=np.concatenate([part.v for part in parts]),
        tick=np.concatenate([part.tick for part in parts]).astype(np.int16),
        command=np.concatenate([part.command for part in parts]),
        shapes=np.array([starts.shape[split] for split in SPLITS]),
    )
    write_atomic(path, buffer.getvalue())
