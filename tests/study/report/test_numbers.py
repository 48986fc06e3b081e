"""Numbers with their sources, and intervals over runs against known answers."""

import math

import pytest

from surefoot.study.report.numbers import (
    Number,
    difference,
    interval_over_runs,
    over_runs,
    share,
    stored,
    total,
)


def test_a_number_says_where_it_stands():
    number = stored(3, "bc/seed-0/metrics.jsonl", 4, "falls")
    assert number == Number(3.0, "bc/seed-0/metrics.jsonl#/4/falls")
    assert not stored(None, "f", "a").is_known


def test_formulas_name_their_parts():
    a = Number(3.0, "A")
    b = Number(4.0, "B")
    assert share(a, b) == Number(0.75, "div(A;B)", 4)
    assert total((a, b)) == Number(7.0, "add(A;B)")
    assert difference(b, a) == Number(1.0, "sub(B;A)")
    assert not share(a, Number(0.0, "N")).is_known


def test_the_interval_of_three_runs_is_the_t_interval():
    # t(0.975, 2) = 4.302653; the standard deviation of 1, 2, 3 is 1.
    assert interval_over_runs([1.0, 2.0, 3.0], [None] * 3) == pytest.approx(
        (2 - 4.302653 / math.sqrt(3), 2 + 4.302653 / math.sqrt(3)), abs=1e-5
    )


def test_the_interval_of_a_share_ends_at_0_and_1():
    assert interval_over_runs([0.0, 1.0], [10, 10]) == (0.0, 1.0)


@pytest.mark.parametrize(("value", "known"), [(1.0, (0.886, 1.0)), (0.0, (0.0, 0.114))])
def test_runs_that_all_succeed_or_all_fail_have_wilsons_interval(value, known):
    # 30 of 30: 1 / (1 + 1.96^2 / 30) = 0.8865
    assert interval_over_runs([value] * 3, [10] * 3) == pytest.approx(known, abs=1e-3)


@pytest.mark.parametrize(
    ("values", "trials"), [([0.5], [10]), ([0.5, 0.5], [None, None]), ([1.0, 1.0], [0, 0])]
)
def test_runs_that_say_nothing_about_their_spread_have_no_interval(values, trials):
    assert interval_over_runs(values, trials) is None


def test_runs_that_agree_by_chance_have_the_score_interval_of_all_trials():
    # Wilson's interval of 10 of 20.
    known = pytest.approx((0.2993, 0.7007), abs=1e-4)
    assert interval_over_runs([0.5, 0.5], [10, 10]) == known


def test_a_run_without_a_number_does_not_enter_the_mean():
    estimate = over_runs([Number(1.0, "A"), Number(math.nan, "B"), Number(2.0, "C")])
    assert estimate is not None
    assert (estimate.mean.value, estimate.mean.source, estimate.runs) == (1.5, "mean(A;C)", 2)
    assert over_runs([Number(math.nan, "B")]) is None
