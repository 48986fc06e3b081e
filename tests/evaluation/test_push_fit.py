"""The monotone fit of the robots that survived, and where it meets the share that has to."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import isotonic_regression
from scipy.stats import norm

from surefoot.evaluation import statistics
from surefoot.evaluation.digits import as_digits
from surefoot.evaluation.push_fit import (
    falling_fit,
    fitted_level,
    limit_interval,
    refuting_counts,
    resampled_impulses,
    robots_needed,
)
from surefoot.evaluation.statistics import RESAMPLES, resamples, wilson


@given(arrays(np.int64, st.tuples(st.just(3), st.integers(1, 9)), elements=st.integers(0, 20)))
def test_the_fit_is_that_of_isotonic_regression(successes):
    fits = [isotonic_regression(row, increasing=False).x.round(9) for row in successes]
    assert np.array_equal(falling_fit(successes), fits)


@pytest.mark.parametrize(
    ("levels", "successes", "expected"),
    [
        ([0, 1, 2], [10, 10, 6], 1.5),  # straight line from 100 % at 1 N s to 60 % at 2 N s
        ([0, 1, 2, 3], [10, 7, 9, 0], 2.0),  # 7 and 9 pool to 8 of 10
        ([0, 1, 2, 3, 4], [10, 8, 7, 9, 0], 3.0),  # three that pool to 8
        ([0, 5], [10, 9], 5.0),  # nothing failed
        ([0, 1], [5, 2], 0.0),  # even unpushed robots fail
        ([0], [5], 0.0),
        ([0], [8], 0.0),  # no push was tried
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


@pytest.mark.parametrize("n", [5, 10, 15, 16, 50, 100])
@pytest.mark.parametrize("share", [0.5, 0.8, 0.9, 1.0])
def test_counts_refute_a_share_where_wilsons_interval_leaves_it_out(n, share):
    few, many = refuting_counts(share, n)
    for count in range(n + 1):
        low, high = wilson(count, n)
        assert (count > many) == (low > share)
        assert (count < few) == (high < share)


@pytest.mark.parametrize(
    ("levels", "successes", "share", "n", "expected"),
    [
        ([0, 2.0, 2.2, 3.0], [100, 100, 0, 0], 0.8, 100, (2.0, 2.2)),  # all agree
        ([0, 2.0, 2.2, 3.0], [16, 16, 0, 0], 0.8, 16, (2.0, 2.2)),
        ([0, 2.0, 2.2, 3.0], [15, 15, 0, 0], 0.8, 15, (0.0, 2.2)),  # too few to tell
        ([0, 2.0, 2.2, 3.0], [100, 100, 0, 0], 1.0, 100, (0.0, 2.2)),  # no sample shows all
        ([0, 2.0, 2.2], [3, 3, 0], 0.2, 3, (2.0, 6.0)),  # none of three is not less than 20 %
        ([0, 6.0], [100, 100], 0.8, 100, (6.0, 6.0)),  # limits beyond 6 N s are not told apart
        ([0], [0], 0.8, 100, (0.0, 0.0)),  # even unpushed robots fail
        ([0, 1, 2, 3, 4], [100, 80, 70, 90, 0], 0.8, 100, (3.0, 4.0)),  # three that pool to 80
    ],
)
def test_what_robots_leave_open(levels, successes, share, n, expected):
    assert limit_interval(levels, successes, share, n, strongest=6.0) == expected


@pytest.mark.parametrize("n", [10, 20, 100])
@pytest.mark.parametrize("spread", [0.0, 0.02, 0.3])
def test_intervals_hold_the_limit_however_much_robots_differ(monkeypatch, n, spread):
    """Robots with normally distributed limits, searched in steps of 0.2 N s."""
    monkeypatch.setattr(statistics, "RESAMPLES", 200)
    rng = np.random.default_rng(9)
    levels = (0.2 * np.arange(31)).tolist()
    trials = 40
    held = 0
    for _ in range(trials):
        center = rng.uniform(1.5, 4.5)
        limits = center + spread * rng.normal(size=n)
        digits = [as_digits(limits >= level) for level in levels]
        successes = [text.count("1") for text in digits]
        drawn = resampled_impulses([levels], [digits], robots_needed(0.8, n))
        low, high = statistics.percentiles(drawn[:, 0])
        least, most = limit_interval(levels, successes, 0.8, n, strongest=6.0)
        assert least <= fitted_level(levels, successes, robots_needed(0.8, n)) <= most
        truth = center + spread * norm.ppf(0.2)
        held += min(low, least) <= truth <= max(high, most)
    assert held / trials >= 0.9
