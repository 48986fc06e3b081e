"""Statistics: against published numbers and SciPy, coverage on simulated data, edges."""

import json

import numpy as np
import pytest
from scipy.stats import binomtest, bootstrap, norm, ttest_1samp

from surefoot.config.json_io import from_json, to_json
from surefoot.evaluation.statistics import (
    RESAMPLES,
    PairedDifference,
    RunMeans,
    Z,
    effective_rollouts,
    mean_interval,
    paired_difference,
    percentiles,
    resamples,
    run_interval,
    unpaired_difference,
    wilson,
)


def interval_of(estimate):
    """The interval of an estimate that has one."""
    assert estimate.interval is not None
    return estimate.interval


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        # Percent, as published by the calculators that name Wilson.
        (2, 40, 1.4, 16.5),
        (0, 120, 0.0, 3.1),
        (6, 120, 2.3, 10.5),
        (90, 100, 82.6, 94.5),
        (900, 1000, 88.0, 91.7),
    ],
)
def test_wilson_interval_as_published(successes, n, low, high):
    interval = wilson(successes, n)
    assert [round(100 * end, 1) for end in interval] == [low, high]
    z = norm.ppf(0.975)
    p = successes / n
    # Its ends are where the score test just rejects.
    for end in interval:
        assert end == 0 or abs(p - end) == pytest.approx(z * np.sqrt(end * (1 - end) / n))


def test_wilson_interval_is_that_of_scipy():
    for n in (1, 10, 37, 400):
        for successes in range(n + 1):
            expected = binomtest(successes, n).proportion_ci(0.95, "wilson")
            assert wilson(successes, n) == (expected.low, expected.high)


def test_resamples_are_draws_with_replacement():
    draws = resamples(50)
    assert draws.shape == (RESAMPLES, 50)
    assert (draws.sum(axis=1) == 50).all()
    np.testing.assert_array_equal(draws, resamples(50))
    # Counts of one start are binomial: mean 1, variance 1 - 1/n.
    assert draws.var() == pytest.approx(0.98, abs=0.02)
    assert (draws == 0).mean() == pytest.approx((1 - 1 / 50) ** 50, abs=0.005)
    assert (resamples(1) == 1).all()
    with pytest.raises(ValueError, match="0 starts; use at least 1"):
        resamples(0)


def test_percentiles_hold_the_middle_95_percent():
    assert percentiles(np.arange(1001.0)) == (25.0, 975.0)


def test_paired_difference_is_the_bootstrap_of_scipy():
    rng = np.random.default_rng(3)
    a = rng.exponential(1.0, 200)
    b = a + rng.normal(0.1, 0.5, 200)
    paired = paired_difference(a, b)
    expected = bootstrap(
        (a - b,), np.mean, n_resamples=20_000, method="percentile", rng=rng
    ).confidence_interval
    assert paired.pairs == 200
    assert paired.difference == pytest.approx(a.mean() - b.mean())
    assert paired.interval == pytest.approx((expected.low, expected.high), abs=0.005)


def test_initial_states_that_one_arm_lacks_are_left_out():
    a = [1.0, np.nan, 3.0, 5.0, 4.0]
    b = [0.0, 1.0, np.nan, 2.0, 4.0]
    paired = paired_difference(a, b)
    assert paired == paired_difference([1.0, 5.0, 4.0], [0.0, 2.0, 4.0])
    assert (paired.difference, paired.pairs) == (pytest.approx(4 / 3), 3)
    reverse = paired_difference(b, a)
    assert reverse.difference == -paired.difference
    low, high = interval_of(paired)
    assert reverse.interval == pytest.approx((-high, -low))


def test_pairing_narrows_the_interval():
    rng = np.random.default_rng(4)
    hard = rng.random(100)
    a = hard < 0.8
    b = hard < 0.75
    low, high = interval_of(paired_difference(a, b))
    unpaired_low, unpaired_high = interval_of(paired_difference(a, rng.permutation(b)))
    assert high - low < 0.6 * (unpaired_high - unpaired_low)


@pytest.mark.parametrize(
    ("both", "only_a", "only_b", "neither", "low", "high"),
    [
        # Percentage points; the first two are worked out by hand from Wilson's ends.
        (500, 0, 0, 0, -0.76, 0.76),
        (499, 0, 1, 0, -1.12, 0.58),
        # Newcombe's own examples (Statistics in Medicine 17, 1998, 2635), method 10.
        (36, 12, 2, 0, 5.69, 34.04),
        (53, 0, 1, 0, -9.77, 4.96),
        # His formula, with the continuity correction of a correlation that is positive.
        (20, 12, 2, 16, 5.62, 32.92),
    ],
)
def test_a_difference_of_shares_has_newcombes_interval(both, only_a, only_b, neither, low, high):
    a = np.repeat([1, 1, 0, 0], [both, only_a, only_b, neither])
    b = np.repeat([1, 0, 1, 0], [both, only_a, only_b, neither])
    interval = interval_of(paired_difference(a, b))
    assert [100 * end for end in interval] == pytest.approx([low, high], abs=0.005)


def test_newcombes_interval_holds_the_true_difference_where_pairs_hardly_differ():
    rng = np.random.default_rng(8)
    held = 0
    for _ in range(400):
        a = rng.random(500) < 0.998
        b = np.ones(500)
        low, high = interval_of(paired_difference(a, b))
        held += low <= -0.002 <= high
    assert held / 400 >= 0.95


def test_outcomes_without_spread_are_not_certain():
    assert paired_difference([2.0, 2.0, 2.0], [1.0, 1.0, 1.0]) == PairedDifference(1.0, None, 3)
    assert paired_difference([1], [0]) == PairedDifference(1.0, None, 1)


def test_pairs_without_an_outcome_are_an_error():
    for a, b, message in (
        ([1, 2], [1], "one number per start"),
        ([[1]], [[1]], "one number per start"),
        ([np.nan, 1.0], [1.0, np.nan], "of 2 starts none"),
        ([], [], "of 0 starts none"),
    ):
        with pytest.raises(ValueError, match=message):
            paired_difference(a, b)


def test_intervals_of_pairs_cover_the_truth():
    rng = np.random.default_rng(5)
    truth = 0.9 - (0.7 * 0.9 + 0.3 * 0.8)
    hits = 0
    for _ in range(300):
        a = rng.random(100) < 0.9
        b = np.where(rng.random(100) < 0.3, rng.random(100) < 0.8, a)
        low, high = interval_of(paired_difference(a, b))
        hits += low <= truth <= high
    assert 0.90 < hits / 300 < 0.98


def test_every_run_has_the_same_weight():
    means = run_interval([[1.0, 1.0, 1.0, 1.0], [0.0]])
    assert (means.mean, means.runs) == (0.5, (1.0, 0.0))


def test_runs_without_outcomes_are_an_error():
    for runs in ([], [[1.0], []], [[1.0, np.nan]], [[[1.0]]]):
        with pytest.raises(ValueError, match="at least one run"):
            run_interval(runs)


def test_few_runs_have_a_t_interval():
    runs = [[3.0, 5.0], [6.0], [8.0, 8.0, 8.0]]
    means = run_interval(runs)
    assert (means.mean, means.runs) == (6.0, (4.0, 6.0, 8.0))
    # t of two degrees of freedom is 4.3027; the standard error of 4, 6, 8 is 2 / sqrt(3).
    assert interval_of(means) == pytest.approx((6 - 4.96828, 6 + 4.96828), abs=1e-4)
    assert run_interval([[3.0, 5.0]]) == RunMeans(4.0, None, (4.0,))
    assert run_interval([[3.0, 5.0], [4.0]]).interval is None  # nothing shows the spread


def test_t_intervals_of_runs_cover_the_truth():
    rng = np.random.default_rng(7)
    for count in (3, 5):
        hits = 0
        for _ in range(400):
            runs = [rng.normal(mean, 1.0, 40) for mean in rng.normal(0, 1.0, count)]
            low, high = interval_of(run_interval(runs))
            hits += low <= 0 <= high
        assert 0.92 < hits / 400 < 0.98


def test_runs_that_agree_are_as_uncertain_as_their_rollouts():
    every = [np.ones(100)] * 5
    assert interval_of(run_interval(every)) == pytest.approx(wilson(500, 500))
    assert interval_of(run_interval([np.zeros(100)] * 5)) == pytest.approx(wilson(0, 500))
    # At any other share, too: 49 of 50 in each run.
    nearly = [np.repeat([1, 0], [49, 1])] * 4
    assert interval_of(run_interval(nearly)) == pytest.approx(wilson(196, 200))
    # Of runs of different length, the short ones limit it: 1 / (1/4 (1/10 + 1/1000)) trials.
    low, _ = interval_of(run_interval([np.ones(10), np.ones(1000)]))
    assert low == pytest.approx(1 / (1 + 1.959964**2 / (4 / (1 / 10 + 1 / 1000))))


def test_runs_that_differ_more_than_their_rollouts_keep_the_t_interval():
    runs = [np.repeat([1, 0], [count, 100 - count]) for count in (20, 50, 70)]
    low, high = interval_of(run_interval(runs))
    half = 4.302653 * np.std([0.2, 0.5, 0.7], ddof=1) / np.sqrt(3)
    assert low == pytest.approx(max(0.466667 - half, 0.0), abs=1e-5)
    assert high == pytest.approx(min(0.466667 + half, 1.0), abs=1e-5)
    apart = run_interval([np.zeros(9), np.ones(9)])
    assert apart.interval == (0.0, 1.0)  # shares stay between 0 and 1


def test_the_same_data_give_the_same_records_also_through_json():
    rng = np.random.default_rng(8)
    a = rng.random(30) < 0.8
    b = rng.random(30) < 0.7
    paired = paired_difference(a, b)
    means = run_interval([a, b])
    assert paired == paired_difference(a, b)
    assert means == run_interval([a, b])
    text = json.dumps([to_json(paired), to_json(means)])
    assert from_json(PairedDifference, json.loads(text)[0]) == paired
    assert from_json(RunMeans, json.loads(text)[1]) == means
    assert json.loads(text)[0].keys() == {"difference", "interval", "pairs"}
    assert json.loads(text)[1].keys() == {"mean", "interval", "runs"}


def test_t_interval_of_a_mean_is_that_of_scipy():
    values = [0.3, 0.9, 0.4, 0.8]
    expected = ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert mean_interval(values) == pytest.approx((expected.low, expected.high))
    assert mean_interval([0.3]) is None
    assert mean_interval([0.3, 0.3, 0.3]) is None


def test_effective_rollouts_are_all_of_them_if_runs_are_equally_long():
    assert effective_rollouts([40, 40, 40]) == pytest.approx(120)
    # Runs have the same weight, so that a short one costs more than its rollouts.
    assert effective_rollouts([10, 70]) < 80


def test_wilson_interval_takes_fractions_of_trials():
    low, high = wilson(0.25 * 39.5, 39.5)
    assert low < wilson(10, 40)[0]
    assert high > wilson(10, 40)[1]


@pytest.mark.parametrize(
    ("a", "n_a", "b", "n_b", "low", "high"),
    [
        # Newcombe 1998, table II, method 10.
        (56 / 70, 70, 48 / 80, 80, 0.0524, 0.3339),
        (9 / 10, 10, 3 / 10, 10, 0.1705, 0.8090),
        (10 / 10, 10, 0 / 20, 20, 0.6791, 1.0),
        (0 / 10, 10, 0 / 10, 10, -0.2775, 0.2775),
    ],
)
def test_unpaired_difference_as_published(a, n_a, b, n_b, low, high):
    assert unpaired_difference(a, n_a, b, n_b) == pytest.approx((low, high), abs=5e-5)
    mirrored = unpaired_difference(b, n_b, a, n_a)
    assert mirrored == pytest.approx((-high, -low), abs=5e-5)


def test_the_quantile_of_the_normal_distribution_is_that_of_scipy():
    assert pytest.approx(norm.ppf(0.975), rel=1e-15) == Z
