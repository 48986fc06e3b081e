"""Logs of what a robot measured, row by row, and of what its policy answered: npz or CSV.

Any robot's software can write one, and `surefoot check` replays it. A runtime of this package
records more, a `Flight`, from which `sensor_log_of_flight` takes the part that a replay needs. A
log of torques to be learned is something else, an expert log (`interop.datasets.arrays`).

An npz file holds one array for each array of `SensorLog`; a CSV file has one column for each
number, named `field.component`, such as `joint_position.FL_HAA`. `docs/export.md` lists them. Read
`replay` next, which runs a policy on a log.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.config.array_io import parse_npz
from surefoot.config.json_text import read_file
from surefoot.deploy.recorder import Flight, load_flight
from surefoot.deploy.timing import TickClock
from surefoot.files import write_atomic
from surefoot.interop.logs.tables import nearest, parse_table, whole
from surefoot.learning.layouts import TARGET_SIZE, History
from surefoot.learning.memory import samples_of
from surefoot.learning.observation import Float32Array
from surefoot.types import JOINTS, LEGS, Array, BoolArray, IntArray, State

SUFFIXES = (".npz", ".csv")
"""The file name endings of logs."""
AXES = ("x", "y", "z")
UNIT = 0.05
"""A quaternion whose length differs from 1 by more is refused, much as by the runtime."""
_COMPONENTS: Mapping[str, tuple[str, ...]] = {
    "time_ns": (),
    "tick": (),
    "command": ("vx", "vy", "yaw_rate"),
    "joint_position": JOINTS,
    "joint_velocity": JOINTS,
    "orientation": (*AXES, "w"),
    "angular_velocity": AXES,
    "base_height": (),
    "linear_velocity": AXES,
    "joint_target": JOINTS,
    "gait": (),
}
"""The components of each field; those of `network_input` are numbered from 0."""
DRIVE = 2
"""The mode of a flight in which the robot is driven."""
_OPTIONAL = ("base_height", "linear_velocity", "joint_target", "network_input", "gait")
_ABOUT = ("begins", "robot", "ignored")
"""What a log says about itself; all else are arrays."""
_INTEGERS = ("time_ns", "tick", "gait")


def component_names(term: str, size: int) -> tuple[str, ...]:
    """The names of the components of a term, of a log or of the network's input.

    Args:
        term: Name of the term.
        size: The number of its components.
    """
    if term == "feet":
        return tuple(f"{leg} {axis}" for leg in LEGS for axis in "xy")
    names = _COMPONENTS.get(term, ())
    if len(names) == size:
        return names
    return AXES if size == len(AXES) else tuple(map(str, range(size)))


@dataclass(frozen=True)
class SensorLog:
    """T rows of what one robot measured, one for each tick in which its policy was asked.

    Attributes:
        time_ns: ``(T,)`` when the row was measured [ns].
        tick: ``(T,)`` gait clock [ms].
        command: ``(T, 3)`` vx, vy [m/s], yaw rate [rad/s].
        joint_position: ``(T, 12)`` joint angles [rad], in the order of `JOINTS`.
        joint_velocity: ``(T, 12)`` joint rates [rad/s].
        orientation: ``(T, 4)`` unit quaternions xyzw, base frame to world frame.
        angular_velocity: ``(T, 3)`` of the base, base frame [rad/s].
        base_height: ``(T,)`` height of the base [m], if something measured it.
        linear_velocity: ``(T, 3)`` of the base, base frame [m/s], if something measured it.
        joint_target: ``(T, 12)`` the joint targets that were commanded [rad], if they were kept.
        network_input: ``(T, n)`` what the network was given, if that was kept.
        gait: ``(T,)`` the number of the gait that was walked, if the policy has several; None, as
            in older files, stands for the first one throughout.
        begins: Whether an episode begins with the first row; None if unknown, as for a file.
        robot: Name of the robot, if it is known, as for a flight.
        ignored: Names of what the file has in addition, which no log has.

    Raises:
        ValueError: There are fewer than two rows, or an array has another shape, or numbers that
            are not finite.
    """

    time_ns: IntArray
    tick: IntArray
    command: Array
    joint_position: Array
    joint_velocity: Array
    orientation: Array
    angular_velocity: Array
    base_height: Array | None = None
    linear_velocity: Array | None = None
    joint_target: Array | None = None
    network_input: Float32Array | None = None
    gait: IntArray | None = None
    begins: bool | None = None
    robot: str | None = None
    ignored: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check all arrays."""
        if np.ndim(self.time_ns) != 1:
            raise ValueError(f"time_ns is {np.shape(self.time_ns)}, expected (T,)")
        T = len(self.time_ns)
        if T < 2:
            raise ValueError(f"a log of {T} rows; record at least two")
        for name, array in _present(self):
            expected = _shape(name, array, T)
            if np.shape(array) != expected:
                raise ValueError(f"{name} is {np.shape(array)}, expected {expected}")
            if not np.isfinite(array).all():
                row, column = np.argwhere(~np.isfinite(np.reshape(array, (T, -1))))[0].tolist()
                title = _column_names(name, array)[column]
                raise ValueError(f"{title} is not finite in row {row}; leave such rows out")
        wrong = np.abs(np.linalg.norm(self.orientation, axis=1) - 1.0) > UNIT
        if wrong.any():
            row = int(wrong.argmax())
            raise ValueError(f"orientation is no unit quaternion in row {row}")

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def gaits(self) -> IntArray:
        """``(T,)`` the number of the gait that was walked; zeros if that was not kept."""
        return np.zeros(len(self), np.int64) if self.gait is None else self.gait

    @property
    def elapsed(self) -> IntArray:
        """``(T,)`` ticks since the first row; ticks that were not measured leave gaps."""
        usual = float(np.median(np.diff(self.time_ns)))
        if usual <= 0.0:  # there are no times of measurement
            return np.arange(len(self))
        clock = TickClock(usual)
        return np.cumsum([1 + clock.unseen(time) for time in self.time_ns.tolist()]) - 1

    def at(self, rows: BoolArray | slice) -> SensorLog:
        """Some rows of the log, given by a mask or a slice."""
        begins = self.begins if 0 in np.arange(len(self))[rows] else False
        return replace(self, begins=begins, **{n: array[rows] for n, array in _present(self)})


def remembered(state: State, target: Array, elapsed: IntArray, history: History) -> Float32Array:
    """``(T, size)`` the samples of the past at every row of one episode, as `Memory` has them.

    A row also stands for the ticks after it that have no row.

    Args:
        state: The T states, from the first tick on.
        target: ``(T, 12)`` the joint targets that were applied [rad].
        elapsed: ``(T,)`` ticks since the first row.
        history: What is remembered.
    """
    samples = samples_of(state, target, history)
    past = []
    for age in history.ages.tolist():
        row = np.searchsorted(elapsed, elapsed - age, side="right") - 1
        sample = samples[np.maximum(row, 0)]
        if history.targets:
            sample[row < 0, -TARGET_SIZE:] = state.q[0, 7:]
        past.append(sample)
    return np.concatenate(past, axis=1)


def sensor_log_of_flight(flight: Flight) -> SensorLog:
    """What a runtime recorded in the longest stretch that the policy drove without the expert.

    Args:
        flight: The last seconds of a robot.

    Raises:
        ValueError: The policy did not drive.
    """
    driven = (flight.mode == DRIVE) & ~flight.expert_drove
    driven &= np.isfinite(flight.position).all(axis=1)
    if not driven.any():
        raise ValueError("it is a flight in which no policy drove; keep one in which it walked")
    stretches = np.flatnonzero(np.diff(driven, prepend=False, append=False)).reshape(-1, 2)
    first, end = stretches[np.diff(stretches, axis=1).argmax()].tolist()
    rows = slice(first, end)
    measured = bool(np.isfinite(flight.base[rows]).all())
    time_ns = flight.robot_time_ns[rows]
    return SensorLog(
        time_ns=time_ns,
        tick=flight.gait_tick[rows],
        command=flight.command[rows],
        joint_position=flight.joint_position[rows],
        joint_velocity=flight.joint_velocity[rows],
        orientation=flight.orientation[rows],
        angular_velocity=flight.angular_velocity[rows],
        base_height=flight.base[rows, 0] if measured else None,
        linear_velocity=flight.base[rows, 1:] if measured else None,
        joint_target=flight.position[rows],
        gait=flight.gait[rows],
        begins=bool(flight.gait_tick[first] == 0),  # when the policy's memory is emptied
        robot=str(flight.robot),
    )


def write_sensor_log(log: SensorLog, path: Path) -> None:
    """Write a log, whole or not at all, as npz or as CSV, by the file's ending.

    Raises:
        ValueError: The file name has another ending.
        WriteError: The disk is full, or read-only.
    """
    if path.suffix.lower() == ".npz":
        buffer = BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **dict(_present(log)))
        write_atomic(path, buffer.getvalue())
    elif path.suffix.lower() == ".csv":
        write_atomic(path, _as_csv(log).encode())
    else:
        raise ValueError(f"{path} must end in {' or '.join(SUFFIXES)}")


def read_sensor_log(path: Path) -> SensorLog:
    """Read a log, or the flight that a runtime recorded.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is not a log; the message names the file and what is wrong.
    """
    if not path.exists():
        raise FileNotFoundError(
            f"there is no log {path}; `surefoot play --log FILE` writes one, and `surefoot run "
            "--keep` a flight"
        )
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path} is no log: give one that ends in {' or '.join(SUFFIXES)}")
    content = read_file(path)
    try:
        arrays, ignored = _arrays_of(content, path.suffix.lower())
        if "robot_time_ns" in arrays:
            return sensor_log_of_flight(load_flight(path))
        missing = [
            f"{name}{nearest(name, [each.partition('.')[0] for each in ignored])}"
            for name in _array_names()
            if name not in arrays and name not in _OPTIONAL
        ]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}")
        for name, array in arrays.items():
            if array.dtype.kind not in "fiu":
                raise ValueError(f"{name} holds {array.dtype}, and must hold numbers")
        arrays |= {name: whole(name, arrays[name]) for name in _INTEGERS if name in arrays}
        return SensorLog(**arrays, ignored=ignored)  # pyright: ignore[reportArgumentType]
    except ValueError as error:
        raise ValueError(f"{path} is no log of sensors: {error}") from error


def _arrays_of(content: bytes, suffix: str) -> tuple[dict[str, NDArray], tuple[str, ...]]:
    """The arrays of a file by name, and the names of what no log has.

    Raises:
        ValueError: It is no file of this kind.
    """
    if suffix == ".csv":
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise ValueError(f"it is no text in UTF-8; save it as such ({error})") from error
        return parse_table(text, _COMPONENTS, _INTEGERS)
    if not content.startswith(b"PK"):
        raise ValueError("it is no npz file, as `numpy.savez` writes it; a text must end in .csv")
    arrays = parse_npz(content)
    if "robot_time_ns" in arrays:  # a flight
        return arrays, ()
    known = _array_names()
    ignored = tuple(name for name in arrays if name not in known)
    return {name: array for name, array in arrays.items() if name in known}, ignored


def _shape(name: str, array: ArrayLike, rows: int) -> tuple[int | str, ...]:
    """The required shape of an array of a log; the width of the network's input is not known."""
    components = _COMPONENTS.get(name)
    if components is None:
        return rows, np.shape(array)[1] if np.ndim(array) == 2 else "n"
    return (rows, len(components)) if components else (rows,)


def _present(log: SensorLog) -> Iterator[tuple[str, NDArray]]:
    """The arrays of a log with their names, without those that were not kept."""
    for name in _array_names():
        array = getattr(log, name)
        if array is not None:
            yield name, array


def _array_names() -> list[str]:
    """The names of all arrays that a log may have."""
    return [field.name for field in fields(SensorLog) if field.name not in _ABOUT]


def _as_csv(log: SensorLog) -> str:
    """A log as CSV text: numbers at full precision, one row for each tick."""
    names: list[str] = []
    columns: list[NDArray] = []
    for name, array in _present(log):
        names += _column_names(name, array)
        columns += [array] if array.ndim == 1 else list(array.T)
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        writer.writerow([repr(value) for value in row])
    return text.getvalue()


def _column_names(name: str, array: NDArray) -> list[str]:
    """The names of the columns of an array."""
    if array.ndim == 1:
        return [name]
    components = _COMPONENTS.get(name) or range(array.shape[1])
    return [f"{name}.{component}" for component in components]
