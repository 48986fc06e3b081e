"""Planned comparisons: predictions that came true and that did not, Holm, missing runs."""

from dataclasses import replace

import pytest

from surefoot.config.json_io import from_json, to_json
from surefoot.config.studies import paper_study
from surefoot.config.study import PlannedComparison
from surefoot.study.planned_comparisons import (
    ComparisonOutcome,
    comparison_outcomes,
    predicted_region,
)
from surefoot.study.run_statistics import Runs, difference_of_runs
from tests.fakes.studies import FakeRun, study_results

SAFE = "loco_safe_dagger"
BC = "behavior_cloning"


def impulses(*values):
    return [FakeRun(impulse=(value - 0.1, value + 0.1)) for value in values]


def success(*counts):
    return [FakeRun(successes=(count - 1, count)) for count in counts]


def outcome_of(prediction, runs, measurement="push", others=0, margin=None):
    """The outcome of comparing LocoSafeDAGGER with BC, beside comparisons not measured."""
    planned = PlannedComparison(measurement, SAFE, BC, "all", prediction, margin=margin)
    unmeasured = [PlannedComparison("push", SAFE, "loco_dagger-0.5", "all")] * others
    study = replace(paper_study(), seeds=(0, 1, 2, 3, 4), comparisons=(planned, *unmeasured))
    return comparison_outcomes(study_results(runs, study))[0]


HIGH = impulses(3.0, 3.1, 3.2, 3.3, 3.4)
LOW = impulses(2.0, 2.1, 2.2, 2.3, 2.4)


@pytest.mark.parametrize(
    ("prediction", "safe", "cloning", "verdict"),
    [
        ("better", HIGH, LOW, "holds"),
        ("better", LOW, HIGH, "does not hold"),
        ("worse", LOW, HIGH, "holds"),
        ("worse", HIGH, LOW, "does not hold"),
        ("equal", HIGH, LOW, "does not hold"),
        ("equal", HIGH, impulses(3.05, 3.15, 3.2, 3.25, 3.3), "holds"),
        ("better", HIGH, impulses(3.05, 3.15, 3.2, 3.25, 3.3), "cannot tell"),
        ("none", HIGH, LOW, "holds"),
        ("none", LOW, HIGH, "holds"),
        ("none", HIGH, impulses(2.9, 3.4, 3.1, 3.2, 3.4), "cannot tell"),
    ],
)
def test_five_runs_can_tell_whether_a_prediction_came_true(prediction, safe, cloning, verdict):
    assert outcome_of(prediction, {SAFE: safe, BC: cloning}).verdict == verdict


def test_an_outcome_holds_the_difference_and_both_p_values():
    outcome = outcome_of("better", {SAFE: HIGH, BC: LOW}, others=3)
    assert outcome.text == "LocoSafeDAGGER does better than BC: largest impulse."
    assert outcome.measured is not None
    assert outcome.measured.difference == pytest.approx(1.0)
    assert outcome.p == pytest.approx(2 / 252)
    assert outcome.smallest_p == pytest.approx(2 / 252)
    assert outcome.adjusted_p == pytest.approx(8 / 252)
    assert "p = 0.008, and 0.032 by Holm's method over 4 comparisons" in outcome.reason
    assert outcome.number.startswith("+1.00 N s (+0.77 to +1.23); runs 3.00, 3.10,")


def test_a_difference_that_holms_method_takes_back_cannot_be_told():
    outcome = outcome_of("better", {SAFE: HIGH, BC: LOW}, others=6)
    assert outcome.adjusted_p == pytest.approx(14 / 252)
    assert outcome.verdict == "cannot tell"
    assert "The test does not bear the interval out." in outcome.reason


def test_three_runs_can_show_equality_but_no_difference():
    outcome = outcome_of("better", {SAFE: HIGH[:3], BC: LOW[:3]})
    assert (outcome.verdict, outcome.smallest_p) == ("cannot tell", pytest.approx(0.1))
    assert "That is not enough to show any difference." in outcome.reason
    assert "Of BC, 3 of 5 runs are measured." in outcome.reason
    far = impulses(2.8, 3.0, 3.2)
    assert outcome_of("equal", {SAFE: far, BC: far}).verdict == "cannot tell"
    near = impulses(3.0, 3.01, 3.02)
    assert outcome_of("equal", {SAFE: near, BC: near}).verdict == "holds"


@pytest.mark.parametrize(
    ("prediction", "safe", "cloning", "verdict"),
    [
        ("better", (95, 97, 96, 98, 99), (60, 70, 65, 72, 68), "holds"),
        ("equal", (99, 100, 100, 99, 100), (100, 100, 99, 100, 100), "holds"),
        ("equal", (95, 97, 96, 98, 99), (60, 70, 65, 72, 68), "does not hold"),
        ("equal", (100, 80, 90, 95, 85), (90, 92, 91, 94, 93), "cannot tell"),
        ("better", (100, 100, 100, 100, 100), (100, 100, 100, 100, 100), "cannot tell"),
    ],
)
def test_success_is_compared_in_points(prediction, safe, cloning, verdict):
    outcome = outcome_of(prediction, {SAFE: success(*safe), BC: success(*cloning)}, "test")
    assert outcome.verdict == verdict
    assert " points (" in outcome.number


def test_a_margin_counts_only_where_equality_is_predicted():
    with pytest.raises(ValueError, match="a margin of 3 counts only where `equal` is predicted"):
        PlannedComparison("push", SAFE, BC, "all", "better", margin=3.0)


@pytest.mark.parametrize(("margin", "verdict"), [(None, "holds"), (2.0, "cannot tell")])
def test_a_study_may_have_a_margin_of_its_own(margin, verdict):
    runs = {SAFE: success(98, 98, 99, 98, 98), BC: success(100, 100, 99, 100, 100)}
    assert outcome_of("equal", runs, "test", margin=margin).verdict == verdict


@pytest.mark.parametrize("runs", [{}, {SAFE: HIGH}, {BC: LOW}])
def test_what_is_not_measured_yet_has_no_number(runs):
    outcome = outcome_of("better", runs)
    assert (outcome.verdict, outcome.number) == ("cannot tell", "not measured yet")
    assert (outcome.measured, outcome.p, outcome.adjusted_p) == (None, None, None)
    assert ("LocoSafeDAGGER" in outcome.reason) == (SAFE not in runs)


def test_one_run_shows_no_spread():
    planned = PlannedComparison("push", SAFE, BC, "all", "worse")
    study = replace(paper_study(), comparisons=(planned,), seeds=(0,))
    results = study_results({SAFE: impulses(3.0), BC: impulses(3.5)}, study)
    outcome = comparison_outcomes(results)[0]
    assert (outcome.verdict, outcome.p) == ("cannot tell", None)
    assert outcome.number == "-0.50 N s; runs 3.00 against 3.50"
    assert outcome.reason.startswith("There is a single run")


def test_trainings_on_the_same_data_are_one_run():
    study = paper_study()
    techniques = tuple(
        replace(each, trainings=2) if each.name == BC else each for each in study.techniques
    )
    planned = PlannedComparison("push", SAFE, BC, "all", "better")
    study = replace(study, techniques=techniques, comparisons=(planned,))
    runs = {SAFE: HIGH[:3], BC: impulses(1.0, 3.0, 1.1, 3.1, 1.2, 3.2)}
    measured = comparison_outcomes(study_results(runs, study))[0].measured
    assert measured is not None
    assert measured.b.runs == pytest.approx((2.0, 2.1, 2.2))


def test_a_smaller_imitation_error_is_better():
    measured = difference_of_runs(Runs((0.1, 0.2)), Runs((1.0, 1.1)))
    better = PlannedComparison("error", SAFE, BC, "all", "better")
    assert predicted_region(better, "imitation", measured).high == 0.0
    worse = replace(better, prediction="worse")
    assert predicted_region(worse, "imitation", measured).low == 0.0
    equal = replace(better, prediction="equal")
    assert predicted_region(equal, "imitation", measured).high == pytest.approx(0.105)


def test_outcomes_survive_json():
    outcome = outcome_of("better", {SAFE: HIGH, BC: LOW})
    assert from_json(ComparisonOutcome, to_json(outcome)) == outcome
