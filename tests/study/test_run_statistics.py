"""Statistics of runs: against SciPy, exact enumeration, published numbers, coverage, edges."""

from fractions import Fraction
from itertools import combinations
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import ttest_1samp, ttest_ind

from surefoot.evaluation.statistics import run_interval, wilson
from surefoot.study.run_statistics import (
    RunDifference,
    Runs,
    change_in_runs,
    difference_of_runs,
    holm,
    mean_of_runs,
    of_both,
    permutation_p,
    smallest_p,
)
from tests.fakes.results import shares

few_numbers = st.lists(st.integers(-9, 9), min_size=2, max_size=5)


def interval_of(estimate):
    """The interval of an estimate that has one."""
    assert estimate.interval is not None
    return estimate.interval


def exact_p(a, b):
    """The p-value by trying all ways to divide the runs, in whole numbers."""
    runs = [*a, *b]
    observed = Fraction(sum(a), len(a)) - Fraction(sum(b), len(b))
    differences = []
    for chosen in combinations(range(len(runs)), len(a)):
        of_a = sum(runs[number] for number in chosen)
        of_b = sum(runs) - of_a
        differences.append(Fraction(of_a, len(a)) - Fraction(of_b, len(b)))
    above = Fraction(sum(each >= observed for each in differences), len(differences))
    below = Fraction(sum(each <= observed for each in differences), len(differences))
    return min(2 * min(above, below), Fraction(1))


def test_mean_of_values_has_the_t_interval_of_scipy():
    runs = Runs((3.1, 2.8, 3.5, 3.3))
    means = mean_of_runs(runs)
    expected = ttest_1samp(runs.values, 0.0).confidence_interval(0.95)
    assert means.mean == pytest.approx(3.175)
    assert interval_of(means) == pytest.approx((expected.low, expected.high))
    assert means.runs == runs.values


def test_impulses_of_zero_are_not_taken_for_outcomes_of_zero():
    assert mean_of_runs(Runs((0.0, 0.0, 0.0))).interval is None
    assert mean_of_runs(Runs((2.0,))).interval is None


def test_mean_of_shares_is_that_of_their_rollouts():
    outcomes = [np.repeat([1.0, 0.0], [k, 40 - k]) for k in (2, 0, 5)]
    assert mean_of_runs(shares((2, 0, 5), (40, 40, 40))) == run_interval(outcomes)


def test_shares_that_all_agree_have_the_score_interval_of_all_rollouts():
    low, high = interval_of(mean_of_runs(shares((0, 0, 0), (40, 40, 40))))
    assert (low, high) == pytest.approx(wilson(0, 120))
    assert 100 * high == pytest.approx(3.1, abs=0.05)


@pytest.mark.parametrize(
    ("values", "rollouts"),
    [((), None), ((np.nan,), None), ((0.5,), (4, 4)), ((0.5,), (0,)), ((1.5,), (4,))],
)
def test_what_is_no_set_of_runs_is_refused(values, rollouts):
    with pytest.raises(ValueError, match=r"runs|shares"):
        Runs(values, rollouts)


def test_difference_of_values_has_welchs_interval():
    a = (3.1, 2.8, 3.5)
    b = (2.0, 2.9, 2.1, 2.2)
    found = difference_of_runs(Runs(a), Runs(b))
    expected = ttest_ind(a, b, equal_var=False).confidence_interval(0.95)
    assert found.difference == pytest.approx(np.mean(a) - np.mean(b))
    assert interval_of(found) == pytest.approx((expected.low, expected.high))


def test_a_set_without_spread_leaves_that_of_the_other():
    found = difference_of_runs(Runs((2.0, 2.0, 2.0)), Runs((1.0, 1.2, 1.4)))
    expected = ttest_1samp([1.0, 0.8, 0.6], 0.0).confidence_interval(0.95)
    assert interval_of(found) == pytest.approx((expected.low, expected.high))


def test_welchs_interval_of_a_published_example():
    # Welch's two-sample example of R's data set `sleep`: t.test(extra ~ group, data = sleep).
    a = (0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0)
    b = (1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4)
    low, high = interval_of(difference_of_runs(Runs(a), Runs(b)))
    assert (low, high) == pytest.approx((-3.3654832, 0.2054832), abs=1e-6)


def test_differences_without_any_spread_have_no_interval():
    assert difference_of_runs(Runs((2.0, 2.0)), Runs((1.0, 1.0))).interval is None
    assert difference_of_runs(Runs((2.0, 2.5)), Runs((1.0,))).interval is None
    assert change_in_runs(Runs((2.0, 3.0)), Runs((1.0, 2.0))).interval is None


def test_a_difference_of_shares_that_agree_has_newcombes_interval():
    # Newcombe 1998, table II, method 10: 0 of 10 against 0 of 10, and 10 of 10 against 0 of 20.
    zero = shares((0, 0), (5, 5))
    assert interval_of(difference_of_runs(zero, zero)) == pytest.approx((-0.2775, 0.2775), abs=5e-5)
    found = difference_of_runs(shares((5, 5), (5, 5)), shares((0, 0), (10, 10)))
    assert interval_of(found) == pytest.approx((0.6791, 1.0), abs=5e-5)
    assert interval_of(change_in_runs(zero, zero)) == pytest.approx((-0.2775, 0.2775), abs=5e-5)


def test_a_difference_of_shares_is_at_most_one():
    a = shares((10, 10, 0), (10, 10, 10))
    b = shares((0, 0, 10), (10, 10, 10))
    assert interval_of(difference_of_runs(a, b))[1] == 1.0
    assert interval_of(difference_of_runs(b, a))[0] == -1.0


def test_a_change_is_that_of_each_run():
    found = change_in_runs(Runs((2.0, 3.1, 4.2)), Runs((1.0, 2.0, 3.0)))
    expected = ttest_1samp([1.0, 1.1, 1.2], 0.0).confidence_interval(0.95)
    assert interval_of(found) == pytest.approx((expected.low, expected.high))


def test_a_change_is_that_of_the_runs_which_have_both_measurements():
    after = Runs((0.5, 0.4), (10, 10), seeds=(1, 2))
    before = Runs((0.1, 0.9, 0.2), (10, 20, 30), seeds=(2, 0, 1))
    both = of_both(after, before)
    assert both is not None
    assert both[0] == after
    assert both[1] == Runs((0.2, 0.1), (30, 10), seeds=(1, 2))
    assert change_in_runs(*both).difference == pytest.approx(0.3)
    assert of_both(after, Runs((0.1,), (10,), seeds=(3,))) is None
    with pytest.raises(ValueError, match="give the same ones"):
        change_in_runs(after, before)
    with pytest.raises(ValueError, match="give the same ones"):
        change_in_runs(Runs((0.1,)), Runs((0.1, 0.2)))


def test_welchs_intervals_of_few_runs_cover_the_truth():
    rng = np.random.default_rng(3)
    covered = 0
    for _ in range(400):
        a = Runs(tuple(rng.normal(1.0, 1.0, 3).tolist()))
        b = Runs(tuple(rng.normal(0.0, 3.0, 5).tolist()))
        low, high = interval_of(difference_of_runs(a, b))
        covered += low <= 1.0 <= high
    assert 0.93 <= covered / 400 <= 0.985


@given(few_numbers, few_numbers)
@settings(max_examples=40, deadline=None)
def test_permutation_test_is_the_enumeration_of_all_ways(a, b):
    assert permutation_p(a, b) == pytest.approx(float(exact_p(a, b)))


@given(few_numbers, few_numbers)
@settings(max_examples=20, deadline=None)
def test_permutation_test_knows_no_order_no_unit_and_no_sides(a, b):
    p = permutation_p(a, b)
    assert permutation_p(b, a) == pytest.approx(p)
    assert permutation_p(a[::-1], b) == pytest.approx(p)
    assert permutation_p([4 * x + 8 for x in a], [4 * x + 8 for x in b]) == pytest.approx(p)
    assert smallest_p(len(a), len(b)) - 1e-12 <= p <= 1.0


@pytest.mark.parametrize(("n_a", "n_b", "ways"), [(3, 3, 20), (5, 5, 252), (2, 5, 21)])
def test_the_smallest_p_is_that_of_sets_that_do_not_overlap(n_a, n_b, ways):
    assert smallest_p(n_a, n_b) == 2 / ways
    assert permutation_p(list(range(n_a)), [10 + k for k in range(n_b)]) == pytest.approx(2 / ways)


def test_many_runs_are_exchanged_at_random_with_the_same_answer_each_time():
    rng = np.random.default_rng(0)
    a = rng.normal(0.5, 1, 12).tolist()
    b = rng.normal(0.0, 1, 12).tolist()
    assert comb(24, 12) > 1_000_000
    p = permutation_p(a, b)
    assert permutation_p(a, b) == p
    assert p == pytest.approx(ttest_ind(a, b).pvalue, abs=0.02)


def test_holm_as_published():
    # Holm's method as R's p.adjust(c(0.01, 0.02, 0.03, 0.005), "holm") has it.
    assert holm([0.01, 0.02, 0.03, 0.005]) == pytest.approx((0.03, 0.04, 0.04, 0.02))
    assert holm([0.6, 0.7]) == (1.0, 1.0)
    assert holm([]) == ()


def test_comparisons_not_measured_yet_count_in_holms_method():
    assert holm([None, 0.01, None]) == (None, pytest.approx(0.03), None)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6))
def test_holm_keeps_the_order_and_is_between_none_and_bonferroni(p):
    adjusted = [value for value in holm(p) if value is not None]
    assert len(adjusted) == len(p)
    for value, raw in zip(adjusted, p, strict=True):
        assert raw <= value <= min(len(p) * raw, 1.0) + 1e-15
    ranked = [value for _, value in sorted(zip(p, adjusted, strict=True))]
    assert ranked == sorted(ranked)


def test_a_difference_is_that_of_its_means():
    found = difference_of_runs(shares((4, 8), (10, 10)), shares((1, 3), (10, 10)))
    assert isinstance(found, RunDifference)
    assert found.difference == pytest.approx(found.a.mean - found.b.mean) == pytest.approx(0.4)
