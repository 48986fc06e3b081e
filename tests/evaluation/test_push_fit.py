"""The monotone fit of the robots that survived, and where it meets the share that has to."""

import numpy as np
import pytest

from surefoot.evaluation.push_fit import fitted_level, resampled_impulses, robots_needed
from surefoot.evaluation.statistics import RESAMPLES, resamples


@pytest.mark.parametrize(
    ("levels", "successes", "expected"),
    [
        ([0, 1, 2], [10, 10, 6], 1.5),  # straight line from 100 % at 1 N s to 60 % at 2 N s
        ([0, 1, 2, 3], [10, 7, 9, 0], 2.0),  # 7 and 9 pool to 8 of 10
        ([0, 1, 2, 3, 4], [10, 8, 7, 9, 0], 3.0),  # three that pool to 8
        ([0, 5], [10, 9], 5.0),  # nothing failed
        ([0, 1], [5, 2], 0.0),  # even unpushed robots fail
    ],
)
def test_impulse_at_which_the_monotone_fit_meets_the_share(levels, successes, expected):
    assert fitted_level(levels, successes, robots_needed(0.8, 10)) == expected


def test_the_number_needed_is_not_raised_by_rounding():
    for tenths in range(1, 11):
        assert tenths >= robots_needed(tenths / 10, 10) > tenths - 1


def test_resampled_impulses_are_the_fits_of_the_robots_drawn():
    levels = ((0.0, 1.0, 2.0), (0.0, 3.0))
    survived = (("11111", "11101", "01000"), ("11110", "00110"))
    impulses = resampled_impulses(levels, survived, 4.0)
    assert impulses.shape == (RESAMPLES, 2)
    for row in (0, 17, RESAMPLES - 1):
        robots = np.repeat(np.arange(5), resamples(5)[row])
        for direction in range(2):
            counts = [
                sum(digits[robot] == "1" for robot in robots) for digits in survived[direction]
            ]
            assert impulses[row, direction] == fitted_level(levels[direction], counts, 4.0)
