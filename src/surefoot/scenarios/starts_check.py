"""Checks of initial states, when a set is read or written and before robots begin in them.

`starts` reads and writes the sets, and `rollouts.episodes` begins in them; both check first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.config import Split
from surefoot.types import Array, IntArray

if TYPE_CHECKING:
    from surefoot.scenarios.starts import Starts

UNIT_TOLERANCE = 1e-6
"""How much longer or shorter than 1 a quaternion of a stored state may be; in the packaged sets it
is 1e-15."""
LARGEST = 1e6
"""Maximum magnitude of any number of a state, in its unit."""
GAIT_NUMBERS = 6
"""The numbers of a gait in a stored set: period, duty factor and four offsets."""
LONGEST_NAME = 40
"""Maximum number of characters of a robot's name (`RobotSpec.name`)."""
LONGEST_TEXT = 100_000
"""Maximum number of characters of the record of a preparation; one of thirty commands takes 6000.
"""
LATEST = int(np.iinfo(np.int16).max)
"""[ms] The last tick that a stored set can represent."""


def check_stored_arrays(arrays: Mapping[str, NDArray]) -> list[tuple[int, int, int]]:
    """Check the arrays of a stored set.

    Args:
        arrays: The arrays by name, as in the file.

    Returns:
        The numbers of perturbations, phases and velocities of each split.

    Raises:
        ValueError: An array is missing, has another shape or type, or has numbers out of range.
    """
    names = ("q", "v", "tick", "command", "shapes")
    if arrays.keys() - {"gait", "robot", "prepared"} != set(names):
        raise ValueError(f"it has the arrays {sorted(arrays)}, expected {sorted(names)}"[:300])
    splits = len(get_args(Split))
    if arrays["shapes"].shape != (splits, 3) or arrays["shapes"].dtype.kind not in "iu":
        raise ValueError(f"shapes must be ({splits}, 3) integers: one row for each split")
    shapes = [(int(a), int(b), int(c)) for a, b, c in arrays["shapes"]]
    if min(map(min, shapes)) < 1:
        raise ValueError(f"shapes {shapes} must be positive")
    n = sum(math.prod(shape) for shape in shapes)
    expected = {"q": (n, 19), "v": (n, 18), "tick": (n,), "command": (n, 3)}
    for name, shape in expected.items():
        array = arrays[name]
        if array.shape != shape:
            raise ValueError(f"{name} has shape {array.shape} instead of {shape}")
        if name == "tick":
            continue
        if array.dtype != np.float64:
            raise ValueError(f"{name} holds {array.dtype} instead of float64")
        if not (np.abs(array) <= LARGEST).all():
            raise ValueError(f"{name} holds numbers that are not finite, or beyond {LARGEST:g}")
    tick = arrays["tick"]
    if tick.dtype.kind not in "iu" or tick.min() < 0 or tick.max() > LATEST:
        raise ValueError(f"tick must be integers from 0 to {LATEST} [ms]")
    gait = arrays.get("gait", np.zeros(GAIT_NUMBERS))
    if gait.shape != (GAIT_NUMBERS,) or gait.dtype != np.float64:
        raise ValueError(f"gait is {gait.dtype} {gait.shape} instead of float64 ({GAIT_NUMBERS},)")
    robot = arrays.get("robot", np.array("solo12"))
    if robot.shape != () or robot.dtype.kind != "U" or not 1 <= len(str(robot)) <= LONGEST_NAME:
        raise ValueError(f"robot is no name of 1 to {LONGEST_NAME} characters")
    prepared = arrays.get("prepared", np.array("{}"))
    if prepared.shape != () or prepared.dtype.kind != "U" or len(str(prepared)) > LONGEST_TEXT:
        raise ValueError(f"prepared is no text of at most {LONGEST_TEXT} characters")
    check_unit_quaternions(arrays["q"])
    return shapes


def check_starts(starts: Starts) -> None:
    """Check that robots can begin in these initial states.

    Args:
        starts: n initial states.

    Raises:
        ValueError: An array has the wrong shape or type, a number is not finite, a gait has a
            negative number, or a quaternion is not of length 1.
    """
    n = len(starts)
    shapes = {
        "q": (n, 19),
        "v": (n, 18),
        "tick": (n,),
        "command": (n, 3),
        "id": (n,),
        "gait": (n,),
    }
    for name, shape in shapes.items():
        array = np.asarray(getattr(starts, name))
        kinds = "iu" if name in ("tick", "id", "gait") else "fiu"
        if array.shape != shape or array.dtype.kind not in kinds:
            expected = "whole" if kinds == "iu" else "real"
            raise ValueError(
                f"initial states: {name} is {array.dtype} {array.shape}, expected {shape} "
                f"{expected} numbers"
            )
        if not np.isfinite(array).all():
            place = [int(index) for index in np.argwhere(~np.isfinite(array))[0]]
            raise ValueError(
                f"initial states: {name}{place} is {array[tuple(place)]}; use finite numbers"
            )
    if (np.asarray(starts.gait) < 0).any():
        row = int((np.asarray(starts.gait) < 0).argmax())
        raise ValueError(f"initial states: gait[{row}] is {starts.gait[row]}; use 0 or more")
    check_unit_quaternions(starts.q)


def checked_ids(ids: ArrayLike, n: int) -> IntArray:
    """The ids ``(n,)`` of episodes, as 64-bit integers.

    Raises:
        ValueError: There are not n, or they are not whole numbers from 0 on, as seeds have to be.
    """
    array = np.asarray(ids)
    if array.shape != (n,):
        raise ValueError(f"ids {array.shape} for {n} initial states; give one for each")
    if array.dtype.kind not in "iu":
        raise ValueError(f"ids are whole numbers, not {array.dtype}")
    whole = array.astype(np.int64, copy=False)
    if (whole < 0).any():
        raise ValueError(
            f"ids from {array.min()} to {array.max()}; use 0 to {np.iinfo(np.int64).max}, or leave "
            "them out, and the episodes are numbered from 0"
        )
    return whole


def with_whole_numbers(starts: Starts) -> Starts:
    """The same initial states with 64-bit ticks, ids and gaits, so that sums never overflow."""
    whole = {
        name: np.asarray(getattr(starts, name)).astype(np.int64, copy=False)
        for name in ("tick", "id", "gait")
    }
    has_them = all(array is getattr(starts, name) for name, array in whole.items())
    return starts if has_them else replace(starts, **whole)


def check_unit_quaternions(q: Array) -> None:
    """Check that the quaternions of configurations have length 1.

    MuJoCo normalizes a quaternion and PyBullet does not: with another length, the two would begin
    in different states.

    Args:
        q: ``(n, 19)`` configurations.

    Raises:
        ValueError: A quaternion has another length.
    """
    length = np.linalg.norm(q[:, 3:7], axis=1)
    wrong = np.abs(length - 1.0) > UNIT_TOLERANCE
    if wrong.any():
        row = int(wrong.argmax())
        raise ValueError(
            f"initial states: the quaternion of row {row} is {q[row, 3:7].tolist()} of length "
            f"{length[row]:.9g}; divide it by its length (scalar last: qx, qy, qz, qw)"
        )
