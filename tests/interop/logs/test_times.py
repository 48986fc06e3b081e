"""Rows that do not follow each other in time are named; what a runtime misses is normal."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.interop.logs.times import explain_times
from tests.fakes.exports import described, smooth_log

DESCRIPTION = described("full")
LOG = smooth_log(600)


def rows_of(log, rows):
    """Some rows of a log, in any order."""
    arrays = {name: array for name, array in vars(log).items() if isinstance(array, np.ndarray)}
    return replace(log, **{name: array[rows] for name, array in arrays.items()})


def later(values, row, by):
    """Numbers that are larger from a row on."""
    return values + by * (np.arange(len(values)) >= row)


STALE = np.where(np.arange(600) // 100 == 3, np.arange(600) // 2 * 2, np.arange(600))
MEASURED = ("joint_position", "joint_velocity", "orientation", "angular_velocity")


@pytest.mark.parametrize(
    ("text", "change"),
    [
        (
            "from row 399 to row 400, it goes on by 501 ms, and the gait clock by 1 ms",
            lambda log: replace(log, time_ns=later(log.time_ns, 400, 500_000_000)),
        ),
        (
            "from row 399 to row 400, it goes on by 1 ms, and the gait clock by -129 ms",
            lambda log: replace(log, tick=later(log.tick, 400, -130)),
        ),
        (
            "between row 299 and row 300, 100 rows are missing",
            lambda log: rows_of(log, np.r_[0:300, 400:600]),
        ),
        (
            "from row 200 on, rows with the same time are there more than once",
            lambda log: rows_of(log, np.sort(np.r_[0:600, 200:300])),
        ),
        (
            "from row 200 on, rows with the same time are there more than once",
            lambda log: rows_of(log, np.r_[0:200, [200] * 100, 200:600]),
        ),
        (
            "and the gait clock by",
            lambda log: replace(
                rows_of(log, np.sort(np.r_[0:600, 200:300])),
                time_ns=10**9 + 10**6 * np.arange(700),
            ),
        ),
        (
            "from row 301 on, rows have new times and the same measurements",
            lambda log: replace(log, **{name: getattr(log, name)[STALE] for name in MEASURED}),
        ),
        (
            "goes back by 500 ms from row 399 to row 400",
            lambda log: replace(log, time_ns=later(log.time_ns, 400, -501_000_000)),
        ),
        ("the rows are in reverse order", lambda log: rows_of(log, np.arange(600)[::-1])),
    ],
)
def test_rows_that_do_not_follow_each_other_are_named(text, change):
    (found,) = explain_times(change(LOG), DESCRIPTION)
    assert found.kind == "time"
    assert text in found.text


@pytest.mark.parametrize(
    "change",
    [
        lambda log: log,
        lambda log: rows_of(log, np.r_[0:300, 310:600]),
        lambda log: rows_of(log, np.arange(600) - np.arange(600) % 7 // 6),
        lambda log: replace(log, tick=log.tick % 500),
        lambda log: replace(log, time_ns=log.time_ns + np.arange(600) * 200),
        lambda log: replace(
            log, time_ns=log.time_ns + np.random.default_rng(0).integers(0, 900_000, 600)
        ),
    ],
    ids=["all", "missed ticks", "read again", "wrapped clock", "slow clock", "jitter"],
)
def test_what_is_usual_on_a_robot_is_no_finding(change):
    assert explain_times(change(LOG), DESCRIPTION) == []


def test_a_robot_that_stands_still_may_measure_the_same_again():
    still = {name: np.repeat(getattr(LOG, name)[:1], 600, axis=0) for name in MEASURED}
    still["joint_velocity"] = 0.0 * still["joint_velocity"]
    assert explain_times(replace(LOG, **still), DESCRIPTION) == []
