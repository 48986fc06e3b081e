"""Checks of initial states as arrays: each fault has an error that names it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.scenarios.starts import SPLITS, at_rest, load_starts
from surefoot.scenarios.starts_check import (
    LARGEST,
    LATEST,
    UNIT_TOLERANCE,
    check_starts,
    check_stored_arrays,
    check_unit_quaternions,
)
from tests.scenarios.test_starts import parts_of, small

SHAPES = [(1, 2, 3), (2, 2, 3), (1, 1, 1), (1, 2, 1)]


def stored(**changes: Any) -> dict[str, np.ndarray]:
    """The arrays of a small set, some of them changed."""
    parts, shapes = parts_of(small())
    return {**parts, "shapes": shapes} | changes


def with_number(name: str, value: float) -> dict[str, np.ndarray]:
    """The arrays of a small set, with one other number in the last row of one of them."""
    arrays = stored()
    arrays[name][-1] = value
    return arrays


def test_a_whole_set_passes_with_the_shapes_of_its_splits():
    assert check_stored_arrays(stored()) == SHAPES


@pytest.mark.parametrize("name", ["q", "v", "tick", "command", "shapes"])
def test_an_array_that_is_missing_is_named(name):
    arrays = stored()
    del arrays[name]
    with pytest.raises(ValueError, match=f"it has the arrays .*, expected .*'{name}'"):
        check_stored_arrays(arrays)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"more": np.zeros(3)}, r"it has the arrays .*'more'"),
        ({"shapes": np.ones((3, 3), int)}, r"shapes must be \(4, 3\) integers"),
        ({"shapes": np.ones((4, 3))}, r"shapes must be \(4, 3\) integers"),
        ({"shapes": np.array([(1, 1, 1)] * 3 + [(1, 0, 1)])}, "must be positive"),
        ({"shapes": np.ones((4, 3), int)}, r"q has shape \(21, 19\) instead of \(4, 19\)"),
        ({"v": np.zeros((21, 17))}, r"v has shape \(21, 17\) instead of \(21, 18\)"),
        ({"v": np.zeros((21, 18), np.float32)}, "v holds float32 instead of float64"),
        ({"command": np.zeros((21, 3), int)}, "command holds int64 instead of float64"),
        ({"tick": np.zeros(21)}, f"tick must be integers from 0 to {LATEST}"),
    ],
)
def test_arrays_of_another_kind_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        check_stored_arrays(stored(**changes))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1.001 * LARGEST])
@pytest.mark.parametrize("name", ["q", "v", "command"])
def test_numbers_that_no_state_has_are_refused(name, value):
    with pytest.raises(ValueError, match=f"{name} holds numbers that are not finite, or beyond"):
        check_stored_arrays(with_number(name, value))
    if name != "q":
        check_stored_arrays(with_number(name, LARGEST))


@pytest.mark.parametrize("tick", [-1, LATEST + 1])
def test_ticks_that_a_set_cannot_hold_are_refused(tick):
    with pytest.raises(ValueError, match=f"tick must be integers from 0 to {LATEST}"):
        check_stored_arrays(with_number("tick", tick))
    check_stored_arrays(with_number("tick", min(max(tick, 0), LATEST)))


@pytest.mark.parametrize(
    ("length", "unit"),
    [
        (1.0 + 0.9 * UNIT_TOLERANCE, True),
        (1.0 - 0.9 * UNIT_TOLERANCE, True),
        (1.0 + 1.1 * UNIT_TOLERANCE, False),
        (1.0 - 1.1 * UNIT_TOLERANCE, False),
        (0.0, False),
    ],
)
def test_a_quaternion_has_length_1_up_to_its_tolerance(length, unit):
    q = small()["train"].q.copy()
    q[5, 3:7] *= length
    if unit:
        check_unit_quaternions(q)
        return
    with pytest.raises(ValueError, match=r"the quaternion of row 5 is .* of length .*; divide it"):
        check_unit_quaternions(q)


def test_a_stored_set_with_a_long_quaternion_is_refused():
    arrays = stored()
    arrays["q"][20, 3:7] *= 2.0
    with pytest.raises(ValueError, match=r"the quaternion of row 20 is .* of length 2;"):
        check_stored_arrays(arrays)


def test_robots_can_begin_in_every_stored_state_and_at_rest():
    packaged = load_starts()
    for split in SPLITS:
        check_starts(packaged[split])
    check_starts(at_rest(packaged["nominal"].q[0], np.zeros((2, 3))))


def test_robots_begin_in_no_gait_of_a_negative_number():
    starts = small()["train"][np.arange(2)]
    check_starts(replace(starts, gait=np.array([0, 3])))
    with pytest.raises(ValueError, match=r"initial states: gait\[1\] is -2; use 0 or more"):
        check_starts(replace(starts, gait=np.array([0, -2])))
