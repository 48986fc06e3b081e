"""Import of plain arrays: a log of your own expert, or of a robot, becomes frames to learn from.

Such an expert log is an npz file with the arrays q, v, torque, command and tick, or a CSV file with
a column for each of their numbers (q0 ... q18, v0 ... v17, torque0 ... torque11, vx, vy, yaw_rate,
tick). The torques are the expert's answer in each state, which the policy learns to give. Center of
mass and feet follow from the configuration. Mistakes in a log are found here, before any training:
shapes, order of the quaternion, joints out of range, velocities in another frame.
"""

from __future__ import annotations

import csv
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray
from tqdm import tqdm

from surefoot.config.array_io import parse_npz
from surefoot.errors import unknown
from surefoot.learning.frames import Frames
from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import center_of_mass, difference, feet, legs_of, masses_of
from surefoot.rollouts.outcome import Outcome
from surefoot.rotations import rotation
from surefoot.types import JOINTS, TICKS_PER_SECOND, Array, IntArray

SUFFIXES = (".npz", ".csv")
"""The file name endings of logs."""
REQUIRED = {"q": 19, "v": 18, "torque": 12, "command": 3, "tick": 0}
"""The arrays that a log must have, with the count of numbers in a row; 0 is a plain number."""
OPTIONAL = {"episode": 0, "outcome": 0, "contacts": 4, "expert_drove": 0, "applied": 12}
"""The arrays that a log may have."""
GROUNDED = 0.005
"""[m] If a log has no contacts, a foot is in contact up to this height of its sphere."""
WINDOW = 10
"""[ms] Velocities are compared with the motion over this time."""
UNIT = 1e-2
"""A quaternion whose length differs from 1 by more than this is refused; others are normalized."""
SPARE = 1.05
"""Torques may exceed the motors' limits by this factor, because of sensor noise."""
WHOLE_TURN = 2 * np.pi
"""[rad] Joints without limits turn no farther than this either way; angles in degrees mostly do."""
NEAR = 0.8
"""[1] A name this similar to that of an optional array is taken for a misspelling."""


def read_expert_log(path: Path | str) -> dict[str, NDArray]:
    """The arrays of a log with an expert's torques, by name; nothing in the file is executed.

    Args:
        path: An npz or CSV file.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is neither npz nor CSV, or does not hold such arrays.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{path} must end in {' or '.join(SUFFIXES)}")
    if path.exists() and not path.is_file():
        raise ValueError(f"{path} is not a regular file")
    try:
        if path.suffix.lower() == ".csv":
            return _read_csv(path)
        return parse_npz(path.read_bytes())
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{path} is no log of an expert: {error}") from error


def _read_csv(path: Path) -> dict[str, NDArray]:
    """The arrays of a CSV file; columns with other names may hold anything.

    Raises:
        ValueError: A column is missing or appears twice, a row has another number of columns, or
            something is not a number.
    """
    numbers = array("d")
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(_with_bar(file, path))
        names = [name.strip() for name in next(rows, [])]
        columns = _columns(names)
        places = [names.index(name) for parts in columns.values() for name in parts]
        for row in rows:
            if not row:
                continue
            if len(row) != len(names):
                raise ValueError(f"line {rows.line_num}: {len(names)} names for {len(row)} columns")
            try:
                numbers.extend([float(row[place]) for place in places])
            except ValueError as error:
                raise ValueError(f"line {rows.line_num}: {error}") from error
    if not numbers:
        raise ValueError("it has no rows; a log has one for each tick of 1 ms")
    table = np.array(numbers).reshape(-1, len(places))
    ends = np.cumsum([len(parts) for parts in columns.values()])
    values = dict(zip(columns, np.split(table, ends[:-1], axis=1), strict=True))
    sizes = REQUIRED | OPTIONAL
    return {name: part if sizes[name] else part[:, 0] for name, part in values.items()}


def _columns(names: Sequence[str]) -> dict[str, list[str]]:
    """The names of the columns of each array that a CSV file has.

    Args:
        names: The first line.

    Raises:
        ValueError: A column is missing, appears twice, or looks misspelled.
    """
    columns = {}
    for array_name, size in (REQUIRED | OPTIONAL).items():
        parts = [f"{array_name}{n}" for n in range(size)] if size else [array_name]
        if array_name == "command":
            parts = ["vx", "vy", "yaw_rate"]
        missing = [part for part in parts if part not in names]
        if missing == parts and array_name in OPTIONAL:
            continue
        if missing:
            raise ValueError(
                f"it has no columns {', '.join(missing[:4])}; the first line names the columns: "
                "q0 to q18, v0 to v17, torque0 to torque11, vx, vy, yaw_rate and tick; optional "
                "arrays have all of theirs or none"
            )
        if twice := [part for part in parts if names.count(part) > 1]:
            raise ValueError(f"it has more than one column {', '.join(twice[:4])}; leave one")
        columns[array_name] = parts
    _check_spelling(name.rstrip("0123456789") for name in names)
    return columns


def _check_spelling(names: Iterable[str]) -> None:
    """Check that no unknown name is close to that of an optional array, which would be left out.

    Raises:
        ValueError: One is.
    """
    known = REQUIRED | OPTIONAL
    for name in names:
        if name not in known and get_close_matches(name.lower(), OPTIONAL, n=1, cutoff=NEAR):
            raise ValueError(f"{unknown('array', name, known)}; rename it, or leave it out")


def _with_bar(file: TextIO, path: Path) -> Iterator[str]:
    """The lines of a file, one by one; a long file shows how much of it has been read."""
    size = path.stat().st_size
    with tqdm(total=size, desc=path.name, unit="B", unit_scale=True, leave=False) as bar:
        for line in file:
            bar.update(len(line))
            yield line


def frames_from_arrays(
    arrays: Mapping[str, NDArray], robot: RobotModel, first_episode: int = 0
) -> Frames:
    """Frames from plain arrays over n ticks of 1 ms, checked.

    Args:
        arrays: By name, possibly among others: ``q (n, 19)``, ``v (n, 18)``, ``torque (n, 12)``,
            ``command (n, 3)`` or ``(3,)`` and ``tick (n,)``, in the conventions of
            `surefoot.types`; optionally ``episode (n,)`` (without it, a new one begins wherever the
            tick does not rise by one), ``outcome (n,)``, ``contacts (n, 4)``, ``expert_drove (n,)``
            and ``applied (n, 12)``, the torque of whoever drove [N m] (without it, this is
            ``torque`` where the expert drove, and NaN elsewhere).
        robot: The robot.
        first_episode: The id of the first episode.

    Raises:
        ValueError: An array is missing, has another shape or impossible numbers, or its name looks
            misspelled; the message says which row, and what it looks like.
    """
    given = _shaped(arrays)
    tick = _whole("tick", given["tick"])
    number = _episodes(given, tick)
    q = given["q"].astype(float)
    length = np.linalg.norm(q[:, 3:7], axis=1)
    _refuse(np.abs(length - 1.0) > UNIT, "q", "has a quaternion (q3 to q6) that is not of length 1")
    q[:, 3:7] /= length[:, None]
    v = given["v"].astype(float)
    _check_posture(q, robot)
    _check_motion(q, v, tick, number)
    torque = _clipped("torque", given["torque"], robot)
    expert_drove = given.get("expert_drove", np.ones(len(q))).astype(bool)
    applied = np.where(expert_drove[:, None], torque, np.nan)
    if "applied" in given:
        applied = _clipped("applied", given["applied"], robot)
    position, _ = feet(q, legs_of(robot))
    grounded = position[..., 2] - robot.foot_radius <= GROUNDED
    n = len(q)
    outcome = _whole("outcome", given.get("outcome", np.zeros(n)))
    names = ", ".join(f"{each.value} {each.name}" for each in Outcome)
    _refuse(~np.isin(outcome, list(Outcome)), "outcome", f"is none of {names}")
    return Frames(
        q=q,
        v=v,
        com=center_of_mass(q, legs_of(robot), masses_of(robot)),
        feet=position,
        contacts=given["contacts"].astype(bool) if "contacts" in given else grounded,
        tick=tick,
        command=given["command"].astype(float),
        torque=torque,
        expert_drove=expert_drove,
        episode=first_episode + number,
        outcome=outcome.astype(np.int8),
        applied=applied,
        elapsed=_elapsed(number),
    )


def _shaped(arrays: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """The arrays, all of the same number of rows; those with other names are left out.

    Raises:
        ValueError: An array is missing, looks misspelled, has another shape, or is not finite.
    """
    if missing := [name for name in REQUIRED if name not in arrays]:
        raise ValueError(
            f"the log has no {', '.join(missing)}; it needs {', '.join(REQUIRED)}, and may have "
            f"{', '.join(OPTIONAL)}"
        )
    _check_spelling(arrays)
    n = len(arrays["q"]) if np.ndim(arrays["q"]) else 0
    if n == 0:
        raise ValueError("q has no rows; a log has at least one tick")
    given = {}
    for name, size in (REQUIRED | OPTIONAL).items():
        if name not in arrays:
            continue
        values = np.asarray(arrays[name])
        if name == "command" and values.shape == (3,):
            values = np.tile(values, (n, 1))
        expected = (n, size) if size else (n,)
        if values.shape != expected or values.dtype.kind not in "fiub":
            raise ValueError(
                f"{name} is {values.dtype} {values.shape}, expected numbers {expected}"
            )
        finite = np.isfinite(values.reshape(n, -1)).all(axis=1)
        _refuse(~finite, name, "holds a number that is not finite")
        given[name] = values
    return given


def _refuse(is_wrong: ArrayLike, name: str, why: str) -> None:
    """Refuse an array with wrong rows.

    Raises:
        ValueError: A row is wrong; the message names the first one.
    """
    wrong = np.asarray(is_wrong)
    if wrong.any():
        raise ValueError(f"{name}: row {int(wrong.argmax())} {why} ({int(wrong.sum())} such rows)")


def _clipped(name: str, torque: NDArray, robot: RobotModel) -> Array:
    """Torques clipped to the motors' limits, which measured ones may exceed a little.

    Raises:
        ValueError: A torque exceeds them by more.
    """
    over = (np.abs(torque) > SPARE * robot.torque_limit).any(axis=1)
    limit = ", ".join(f"{value:g}" for value in robot.torque_limit[:3])
    _refuse(over, name, f"exceeds the motor limits of {robot.name} ({limit} N m a leg)")
    return np.clip(torque.astype(float), -robot.torque_limit, robot.torque_limit)


def _whole(name: str, values: NDArray) -> IntArray:
    """Whole numbers.

    Raises:
        ValueError: One is not whole.
    """
    whole = np.round(np.asarray(values, float)).astype(np.int64)
    _refuse(whole != values, name, "is not a whole number; a tick is 1 ms")
    return whole


def _episodes(given: Mapping[str, NDArray], tick: IntArray) -> IntArray:
    """``(n,)`` number of the episode of each row, from 0 on.

    Raises:
        ValueError: The ticks of an episode do not rise by one, or it resumes after another one.
    """
    if "episode" not in given:
        jumps = np.diff(tick) != 1
        if len(jumps) and jumps.mean() > 0.5:
            raise ValueError(
                "tick: most rows do not follow the row before them by 1 ms; record at 1 kHz, or "
                "resample"
            )
        return np.concatenate([[0], np.cumsum(jumps)])
    episode = _whole("episode", given["episode"])
    changes = np.diff(episode) != 0
    begins = np.concatenate([[True], changes])
    _, first = np.unique(episode, return_index=True)
    begins[first] = False
    _refuse(begins, "episode", "goes on with an episode after another one; sort the rows")
    jumps = np.concatenate([[False], (np.diff(tick) != 1) & ~changes])
    _refuse(
        jumps,
        "tick",
        "does not follow the row before it by 1 ms in its episode; record at 1 kHz, or resample",
    )
    return np.concatenate([[0], np.cumsum(changes)])


def _elapsed(number: IntArray) -> NDArray[np.int32]:
    """``(n,)`` ticks since the episode of each row began; rows of an episode are 1 ms apart.

    Args:
        number: ``(n,)`` number of the episode of each row, from 0 on without gaps.
    """
    first = np.flatnonzero(np.diff(number, prepend=-1))
    return (np.arange(len(number)) - first[number]).astype(np.int32)


def _check_posture(q: Array, robot: RobotModel) -> None:
    """Check that the robot is mostly upright, and that its joints are within their limits.

    Raises:
        ValueError: It is not; the message says which numbers may be in another order.
    """
    if np.median(rotation(q[:, 3:7])[:, 2, 2]) < 0.0:
        raise ValueError(
            "q: the robot is upside down most of the time; quaternions are xyzw (q6 is w), and "
            "yours look like wxyz"
        )
    limits = robot.position_limit
    low, high = np.where(np.isfinite(limits), limits, np.sign(limits) * WHOLE_TURN).T
    outside = (q[:, 7:] < low - 0.05) | (q[:, 7:] > high + 0.05)
    if outside.any():
        row, joint = (int(index) for index in np.argwhere(outside)[0])
        raise ValueError(
            f"q: row {row} has {JOINTS[joint]} at {q[row, 7 + joint]:.3f} rad, outside its limits "
            f"{low[joint]:.3f} to {high[joint]:.3f}; joints are {', '.join(JOINTS[:4])} ... in "
            "this order, in radians, with the signs of the robot's description"
        )


def _check_motion(q: Array, v: Array, tick: IntArray, episode: IntArray) -> None:
    """Check that velocities match the motion, in the base frame.

    Over `WINDOW` ticks, the mean velocity must lead from one configuration to the next, except for
    0.3 of its usual size and some noise. If x and y were not measured (are all the same), the
    base's linear velocity is not checked.

    Raises:
        ValueError: They do not match; the message names the part.
    """
    same = (episode[WINDOW:] == episode[:-WINDOW]) if len(q) > WINDOW else np.zeros(0, bool)
    begins = np.flatnonzero(same)
    begins = begins[:: max(1, len(begins) // 2000)]
    if len(begins) < 3:
        return
    seconds = WINDOW / TICKS_PER_SECOND
    moved = np.array([difference(q[row], q[row + WINDOW]) for row in begins]) / seconds
    mean = np.array([v[row : row + WINDOW].mean(axis=0) for row in begins])
    world = (rotation(q[begins, 3:7]).swapaxes(1, 2) * mean[:, None, :3]).sum(axis=2)
    parts = (
        ("v0 to v2, the base's linear velocity", slice(0, 3), 0.05),
        ("v3 to v5, the base's angular velocity", slice(3, 6), 0.15),
        ("v6 to v17, the joint rates", slice(6, 18), 0.15),
    )
    for name, columns, floor in parts:
        if columns.start == 0 and not np.ptp(q[:, :2], axis=0).any():
            continue
        usual = np.median(np.abs(moved[:, columns]))
        error = np.median(np.abs(mean[:, columns] - moved[:, columns]))
        if error <= 0.3 * usual + floor:
            continue
        hint = ""
        if columns.start == 0 and np.median(np.abs(world - moved[:, :3])) < 0.5 * error:
            hint = "; it looks as if it were in the world frame: turn it into the base frame"
        raise ValueError(
            f"v: {name}, does not fit the motion of q: they differ by {error:.3g} in the median, "
            f"where the motion is {usual:.3g}{hint}. Rows are 1 ms apart, in SI units"
        )
