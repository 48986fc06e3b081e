"""Statistics: against published numbers and SciPy, coverage on simulated data, edges."""

import json

import numpy as np
import pytest
from scipy.stats import binomtest, bootstrap, norm

from surefoot.evaluation.statistics import (
    RESAMPLES,
    paired_difference,
    percentiles,
    resamples,
    run_bootstrap,
    wilson,
)


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
def test_wilson(successes, n, low, high):
    found = wilson(successes, n)
    assert [round(100 * end, 1) for end in found] == [low, high]
    z, p = norm.ppf(0.975), successes / n
    # Its ends are where the score test just rejects.
    for end in found:
        assert end == 0 or abs(p - end) == pytest.approx(z * np.sqrt(end * (1 - end) / n))


def test_wilson_is_scipy_s():
    for successes in range(11):
        expected = binomtest(successes, 10).proportion_ci(0.95, "wilson")
        assert wilson(successes, 10) == [expected.low, expected.high]


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


def test_percentiles_cut_a_fortieth_off_each_end():
    assert percentiles(np.arange(1001.0)) == [25.0, 975.0]


def test_paired_difference_is_scipy_s_bootstrap():
    rng = np.random.default_rng(3)
    a = rng.random(200) < 0.9
    b = a & (rng.random(200) < 0.95)
    found = paired_difference(a, b)
    expected = bootstrap(
        (a.astype(float) - b,), np.mean, n_resamples=20_000, method="percentile"
    ).confidence_interval
    assert found["pairs"] == 200
    assert found["difference"] == pytest.approx(a.mean() - b.mean())
    # Steps are of one robot in two hundred.
    assert found["interval"] == pytest.approx([expected.low, expected.high], abs=0.0051)
    assert found["interval"] != [0.0, 0.0]


def test_pairs_that_miss_one_are_left_out():
    a, b = [1.0, np.nan, 3.0, 5.0, 4.0], [0.0, 1.0, np.nan, 2.0, 4.0]
    found = paired_difference(a, b)
    assert found == paired_difference([1.0, 5.0, 4.0], [0.0, 2.0, 4.0])
    assert (found["difference"], found["pairs"]) == (pytest.approx(4 / 3), 3)
    back = paired_difference(b, a)
    assert back["difference"] == -found["difference"]
    assert back["interval"] == pytest.approx([-end for end in found["interval"][::-1]])


def test_pairs_make_it_narrower():
    rng = np.random.default_rng(4)
    hard = rng.random(100)
    a, b = hard < 0.8, hard < 0.75
    low, high = paired_difference(a, b)["interval"]
    apart_low, apart_high = paired_difference(a, rng.permutation(b))["interval"]
    assert high - low < 0.6 * (apart_high - apart_low)


def test_degenerate_pairs():
    assert paired_difference([1, 1, 1], [0, 0, 0]) == {
        "difference": 1.0,
        "interval": [1.0, 1.0],
        "pairs": 3,
    }
    assert paired_difference([1], [0]) == {"difference": 1.0, "interval": None, "pairs": 1}
    for a, b, message in (
        ([1, 2], [1], "one number a start"),
        ([[1]], [[1]], "one number a start"),
        ([np.nan, 1.0], [1.0, np.nan], "of 2 starts none"),
        ([], [], "of 0 starts none"),
    ):
        with pytest.raises(ValueError, match=message):
            paired_difference(a, b)


def test_intervals_of_pairs_cover_the_truth():
    rng = np.random.default_rng(5)
    truth, hits = 0.9 - (0.7 * 0.9 + 0.3 * 0.8), 0
    for _ in range(300):
        a = rng.random(100) < 0.9
        b = np.where(rng.random(100) < 0.3, rng.random(100) < 0.8, a)
        low, high = paired_difference(a, b)["interval"]
        hits += low <= truth <= high
    assert 0.90 < hits / 300 < 0.98


def test_runs_weigh_the_same():
    found = run_bootstrap([[1.0, 1.0, 1.0, 1.0], [0.0]])
    assert (found["mean"], found["runs"]) == (0.5, [1.0, 0.0])
    # Both runs, or one of them twice: a quarter of the draws each.
    assert found["interval"] == [0.0, 1.0]


def test_run_and_rollout_both_count():
    """The variance is that of run means, of m with replacement, and of rollouts within."""
    rng = np.random.default_rng(6)
    runs = [rng.normal(mean, 1.0, 10) for mean in rng.normal(0, 0.3, 8)]
    low, high = run_bootstrap(runs)["interval"]
    between = np.var([run.mean() for run in runs]) / 8
    within = np.mean([run.var() / 10 for run in runs]) / 8
    expected = 2 * 1.96 * np.sqrt(between + within)
    assert high - low == pytest.approx(expected, rel=0.08)
    assert high - low > 1.1 * 2 * 1.96 * np.sqrt(between)


def test_intervals_of_runs_cover_the_truth():
    """Of ten runs 90 % where 95 are promised: the price of few runs, as the docstring says."""
    rng, hits = np.random.default_rng(7), 0
    for _ in range(200):
        runs = [rng.normal(mean, 1.0, 40) for mean in rng.normal(0, 1.0, 10)]
        low, high = run_bootstrap(runs)["interval"]
        hits += low <= 0 <= high
    assert 0.83 < hits / 200 < 0.97


def test_degenerate_runs():
    assert run_bootstrap([[1, 1], [1, 1, 1]]) == {
        "mean": 1.0,
        "interval": [1.0, 1.0],
        "runs": [1.0, 1.0],
    }
    assert run_bootstrap([[0, 1]]) == {"mean": 0.5, "interval": None, "runs": [0.5]}
    # One rollout of each run: runs are still drawn.
    low, high = run_bootstrap([[0], [1], [2], [3]])["interval"]
    assert 0 < low < 1.5 < high < 3
    for runs in ([], [[1.0], []], [[1.0, np.nan]], [[[1.0]]]):
        with pytest.raises(ValueError, match="at least one run"):
            run_bootstrap(runs)


def test_figures_are_json_and_the_same_every_time():
    rng = np.random.default_rng(8)
    a, b = rng.random(30) < 0.8, rng.random(30) < 0.7
    for make in (lambda: paired_difference(a, b), lambda: run_bootstrap([a, b])):
        figures = make()
        assert json.loads(json.dumps(figures)) == figures == make()
