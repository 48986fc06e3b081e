"""Stored initial states: every method, expert and version is tested from the same states.

A set is made once (`surefoot.scenarios.make`) and never changed; its hash is stored with every
result that is measured on it. There are four splits: ``nominal`` states of a settled gait cycle,
and perturbed ones to ``train`` on, to ``select`` a policy on, and to ``test`` it on once.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cache, cached_property
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config, Gait, Split
from surefoot.config.array_io import parse_npz
from surefoot.config.expert_rules import STRAIGHT_TROT, straight_trot
from surefoot.config.gait_table import gait_name
from surefoot.config.json_text import read_file
from surefoot.config.robot_table import SOLO12
from surefoot.errors import unknown
from surefoot.files import write_atomic
from surefoot.mpc.gaits import gait_in_words, only_gait
from surefoot.scenarios.preparation import Preparation, read_preparation, text_of
from surefoot.scenarios.spread import along_one_axis, spread_cells
from surefoot.scenarios.starts_check import check_stored_arrays
from surefoot.types import Array, IntArray

ANOTHER = (
    "leave --config.start-set out, or make a set with the same options and `surefoot prepare --out "
    "FILE`"
)
"""The advice for a set that does not fit."""
UNKNOWN: Any = None
"""Stands for an array that follows from the others; `Starts` fills it in."""
HASHED = ("q", "v", "tick", "command", "id")
"""The arrays of a set that its hash covers. All of its states are in one gait."""
SPLITS: tuple[Split, ...] = get_args(Split)
PACKAGED = (STRAIGHT_TROT, "solo12-trot-v1-wide")
"""Sets in the package: Solo12 trots at 0 to 0.3 m/s, perturbed as in the paper or 1.5 times so."""


@dataclass(frozen=True)
class Starts:
    """n initial states of episodes.

    Attributes:
        q: ``(n, 19)`` configuration, x = y = 0 [m, unit quaternion, rad].
        v: ``(n, 18)`` velocity [m/s, rad/s], base part in the base frame.
        tick: ``(n,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        id: ``(n,)`` row in the stored set; -1 if the state belongs to no set.
        gait: ``(n,)`` the number of the gait that each robot is to walk, the first one by default.
    """

    q: Array
    v: Array
    tick: IntArray
    command: Array
    id: IntArray
    gait: IntArray = UNKNOWN

    def __post_init__(self) -> None:
        """Fill in the first gait where none is given."""
        if self.gait is UNKNOWN:
            object.__setattr__(self, "gait", np.zeros(len(self.q), dtype=np.int64))

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice | NDArray) -> Starts:
        """The initial states in these rows."""
        return Starts(*(getattr(self, each.name)[rows] for each in fields(self)))


def join_starts(parts: Sequence[Starts]) -> Starts:
    """The initial states of at least one part, one part after another."""
    names = [each.name for each in fields(Starts)]
    return Starts(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def at_rest(q: Array, commands: Array) -> Starts:
    """Initial states at rest in one configuration, at the beginning of the gait cycle.

    They belong to no stored set.

    Args:
        q: ``(19,)`` configuration [m, unit quaternion, rad].
        commands: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s].

    Raises:
        ValueError: The arrays have other shapes.
    """
    if np.shape(q) != (19,):
        raise ValueError(f"q has shape {np.shape(q)}, expected (19,)")
    if np.ndim(commands) != 2 or np.shape(commands)[1] != 3:
        raise ValueError(f"commands have shape {np.shape(commands)}, expected (n, 3)")
    n = len(commands)
    return Starts(
        np.tile(q, (n, 1)),
        np.zeros((n, 18)),
        np.zeros(n, dtype=np.int64),
        np.array(commands, float),
        np.full(n, -1, dtype=np.int64),
    )


@dataclass(frozen=True)
class StartSet:
    """A stored set of initial states.

    Attributes:
        name: The name of the set; new states get a new name.
        grid: The initial states of each split: (perturbations, phases, velocities), flattened in
            this order.
        shape: The numbers of perturbations, phases and velocities of each split.
        gait: The gait of the initial states, as far as its timing; its heights are not stored.
        robot: The name of the robot that they belong to.
        preparation: What was measured when they were made; None for older sets.
    """

    name: str
    grid: dict[str, Starts]
    shape: dict[str, tuple[int, int, int]]
    gait: Gait = field(default_factory=Gait)
    robot: str = SOLO12.name
    preparation: Preparation | None = None

    def __getitem__(self, split: str) -> Starts:
        """All initial states of a split.

        They come perturbation by perturbation, each with phases x velocities states.

        Raises:
            KeyError: There is no such split.
        """
        if split not in self.grid:
            raise KeyError(f"starts {self.name!r} have no split {split!r}; there are {SPLITS}")
        return self.grid[split]

    def first(self, split: str, n: int) -> Starts:
        """The first n initial states of a split, evenly spread over phases and speeds for any n.

        They are whole perturbations, and the first cells of the next one in the order of
        `spread_cells`. They are returned in the order in which they are stored. So the first n
        states are among those of any larger number.

        Raises:
            KeyError: There is no such split.
            ValueError: The split holds fewer, or n is not positive.
        """
        starts = self[split]
        if not 1 <= n <= len(starts):
            raise ValueError(
                f"{n} episodes asked for, the starts {self.name!r} hold {len(starts)} in "
                f"{split!r}; use 1 to {len(starts)}"
            )
        cells = spread_cells(*self.shape[split][1:])
        whole, rest = divmod(n, len(cells))
        begun = whole * len(cells)
        return starts[np.concatenate([np.arange(begun), begun + np.sort(cells[:rest])])]

    def rows(self, split: str) -> IntArray:
        """``(perturbations, phases, velocities)`` indices into the split.

        Raises:
            KeyError: There is no such split.
        """
        return np.arange(len(self[split])).reshape(self.shape[split])

    def commands(self, split: str) -> Array:
        """``(velocities, 3)`` the commands of a split: vx, vy [m/s] and yaw rate [rad/s].

        Raises:
            KeyError: There is no such split.
        """
        return self[split].command[self.rows(split)[0, 0]]

    def velocities(self, split: str, n: int) -> IntArray:
        """``(n,)`` indices of commands of a split that are spread over all of its commands.

        Commands along one axis are picked at equal distances, both ends included; in a box, they
        are the first ones (`CommandBox.spread`).

        Raises:
            KeyError: There is no such split.
            ValueError: The split holds fewer, or n is not positive.
        """
        available = self.rows(split).shape[2]
        if not 1 <= n <= available:
            raise ValueError(
                f"{n} velocities asked for, the starts {self.name!r} hold {available} in "
                f"{split!r}; use 1 to {available}"
            )
        if not along_one_axis(self.commands(split)):
            return np.arange(n)
        return np.round(np.linspace(0, available - 1, n)).astype(np.int64)

    @cached_property
    def hash(self) -> str:
        """SHA-256 over the arrays of all splits; it is stored with every result."""
        sha = hashlib.sha256()
        for split in SPLITS:
            starts = self.grid[split]
            for name in HASHED:
                sha.update(np.ascontiguousarray(getattr(starts, name)).data)
        return sha.hexdigest()

    def phases(self, id: IntArray) -> IntArray:
        """``(n,)`` indices of the phases at which initial states begin; -1 for those of no set.

        Args:
            id: ``(n,)`` ids of initial states, as in `Starts`.
        """
        phase = np.full(len(id), -1)
        for split in SPLITS:
            _, phases, velocities = self.shape[split]
            row = id - self[split].id[0]
            within = (row >= 0) & (row < len(self[split]))
            phase[within] = row[within] // velocities % phases
        return phase

    @property
    def seed(self) -> int:
        """Root seed of the disturbances in evaluations on this set.

        It is fixed by the set's content: every policy, whatever the seed of its training, meets the
        same friction, load, pushes and noise in an episode from the same initial state.
        """
        return int(self.hash[:8], 16)


def starts_of(config: Config) -> StartSet:
    """The set of initial states of a configuration of one gait.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: No set is named and none is packaged; the file is not a set of initial states,
            or belongs to another robot or gait; or there are several gaits (`gaits.all_starts_of`).
    """
    only_gait(config, "a set of initial states")
    # Imported here, so that the command line does not wait for Pinocchio.
    from surefoot.robots.identity import description_hash
    from surefoot.robots.load import find_spec

    name = config.start_set
    if name is None and straight_trot(config):
        name = STRAIGHT_TROT
    spec = find_spec(config.robot)
    if name is None:
        raise ValueError(
            f"there are no initial states for the robot {spec.name}, {gait_in_words(config.gait)} "
            "and these commands yet: `surefoot.scenarios.prepare.completed` makes them, as do the "
            "commands `surefoot prepare` and `surefoot train`"
        )
    stored = load_starts(name)
    if spec.name != stored.robot:
        raise ValueError(
            f"the initial states {stored.name!r} belong to the robot {stored.robot}, but the "
            f"configuration asks for {spec.name}: {ANOTHER}"
        )
    made = stored.preparation
    if made is not None and made.description != description_hash(spec):
        raise ValueError(
            f"the initial states {stored.name!r} belong to another description of the robot "
            f"{spec.name} than the configuration has: {ANOTHER}"
        )
    if config.gait.timing != stored.gait.timing:
        raise ValueError(
            f"the initial states {stored.name!r} belong to {gait_in_words(stored.gait)}, but the "
            f"configuration asks for {gait_in_words(config.gait)}: {ANOTHER}"
        )
    return stored


def load_starts(which: str | Path = PACKAGED[0]) -> StartSet:
    """Read a set: one that comes with the package, by its name, or a file.

    Packaged sets are read once and shared, so the arrays of a set are read-only.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is not a set of initial states: arrays of other shapes or types,
            numbers that are not finite, or quaternions that are not of length 1.
    """
    if isinstance(which, str) and which in PACKAGED:
        return _load_packaged(which)
    path = Path(which)
    if not path.exists():
        raise FileNotFoundError(unknown("set of starts (or file)", str(which), PACKAGED))
    return _parse(read_file(path), path.stem, str(which))


@cache
def _load_packaged(name: str) -> StartSet:
    """A set that comes with the package."""
    content = files("surefoot.scenarios").joinpath(f"data/{name}.npz").read_bytes()
    return _parse(content, name, name)


def _parse(content: bytes, name: str, source: str) -> StartSet:
    """The set in a file's bytes.

    Raises:
        ValueError: They are not a set.
    """
    try:
        arrays = parse_npz(content)
        shapes = check_stored_arrays(arrays)
        gait = _gait_from(arrays["gait"]) if "gait" in arrays else Gait()
        robot = str(arrays["robot"]) if "robot" in arrays else SOLO12.name
        made = read_preparation(str(arrays["prepared"])) if "prepared" in arrays else None
    except ValueError as error:
        raise ValueError(f"{source} is not a set of starts ({error}); write it again") from error
    bounds = np.cumsum([0, *(math.prod(shape) for shape in shapes)])
    everything = Starts(
        arrays["q"],
        arrays["v"],
        arrays["tick"].astype(np.int64),
        arrays["command"],
        np.arange(bounds[-1]),
    )
    for array in fields(Starts):
        getattr(everything, array.name).flags.writeable = False
    grid = {
        split: everything[slice(start, stop)]
        for split, start, stop in zip(SPLITS, bounds[:-1], bounds[1:], strict=True)
    }
    if made is not None:  # whatever the name of its file, which may be a run's copy
        name = f"{robot}-{gait_name(gait)}-{made.key[:8]}"
    return StartSet(name, grid, dict(zip(SPLITS, shapes, strict=True)), gait, robot, made)


def check_unused(path: Path) -> None:
    """Check that a new set would not replace an existing one.

    Raises:
        FileExistsError: There is a file of this name already.
    """
    if path.exists():
        raise FileExistsError(f"{path} exists; a set of starts is never changed: use a new name")


def save_starts(starts: StartSet, path: Path, overwrite: bool = False) -> None:
    """Write a set, whole or not at all.

    Args:
        starts: The set.
        path: The file.
        overwrite: Whether the set may replace an existing file.

    Raises:
        FileExistsError: A set of this name exists already, and must not be replaced; new states
            get a new name.
        ValueError: `load_starts` would refuse the states.
        WriteError: The disk is full, or read-only.
    """
    if not overwrite:
        check_unused(path)
    everything = join_starts([starts.grid[split] for split in SPLITS])
    arrays = {
        "q": everything.q,
        "v": everything.v,
        "tick": everything.tick,
        "command": everything.command,
        "shapes": np.array([starts.shape[split] for split in SPLITS]),
    }
    # As in earlier files: a gait and a robot that are not stored are those of the packaged sets.
    if starts.gait.timing != Gait().timing:
        arrays["gait"] = np.array(starts.gait.timing)
    if starts.robot != SOLO12.name:
        arrays["robot"] = np.array(starts.robot)
    if starts.preparation is not None:
        arrays["prepared"] = np.array(text_of(starts.preparation))
    try:
        check_stored_arrays(arrays)
    except ValueError as error:
        raise ValueError(f"{path} is not written: {error}") from error
    arrays["tick"] = arrays["tick"].astype(np.int16)
    buffer = BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomic(path, buffer.getvalue())


def _gait_from(numbers: Array) -> Gait:
    """The gait in a file's numbers ``(6,)``.

    Raises:
        ValueError: They are not those of a gait.
    """
    period, duty, front_left, front_right, hind_left, hind_right = numbers.tolist()
    return Gait(period, duty, (front_left, front_right, hind_left, hind_right))
