"""Verdicts: the rule, both ways; what a claim says of itself; rivals, margins, missing runs."""

import pytest

from surefoot.config.json_io import from_json, to_json
from surefoot.study.claims import (
    ABOVE_ZERO,
    BELOW_ZERO,
    PERCENT,
    UNMEASURED,
    Claim,
    NumberStyle,
    Region,
    Sample,
    Statement,
    judge_change,
    judge_difference,
    judge_equal,
    judge_extreme,
    judge_mean,
    verdict_of,
)
from surefoot.study.run_statistics import Runs
from tests.fakes.results import shares

NEWTON_SECONDS = NumberStyle("N s")
EQUAL = Statement("V-A", "name", "A sentence.", NEWTON_SECONDS)


def statement(region, style=NEWTON_SECONDS):
    return Statement("V-A", "name", "A sentence.", style, region)


def sample(title, *values, planned=3):
    return Sample(title, Runs(values) if values else None, planned)


@pytest.mark.parametrize(
    ("interval", "region", "verdict"),
    [
        ((0.01, 0.04), Region(high=0.05), "holds"),
        ((0.06, 0.09), Region(high=0.05), "does not hold"),
        ((0.05, 0.09), Region(high=0.05), "does not hold"),
        ((0.04, 0.06), Region(high=0.05), "cannot tell"),
        ((0.06, 0.09), Region(low=0.05), "holds"),
        ((0.01, 0.04), Region(low=0.05), "does not hold"),
        ((0.06, 0.14), Region(0.05, 0.15), "holds"),
        ((0.01, 0.04), Region(0.05, 0.15), "does not hold"),
        ((0.2, 0.3), Region(0.05, 0.15), "does not hold"),
        ((0.01, 0.2), Region(0.05, 0.15), "cannot tell"),
        ((0.14, 0.16), Region(0.05, 0.15), "cannot tell"),
        (None, Region(high=0.05), "cannot tell"),
    ],
)
def test_a_claim_holds_if_the_whole_interval_lies_in_its_region(interval, region, verdict):
    assert verdict_of(interval, region) == verdict


def test_a_mean_is_shown_with_its_interval_and_every_run():
    runs = Sample("BC", shares((2, 4, 3), (40, 40, 40)), 3)
    claim = judge_mean(statement(Region(high=0.2), PERCENT), runs, "Beside it.")
    assert claim.verdict == "holds"
    assert claim.number == "7.5 % (1.3 to 13.7); runs 5.0, 10.0, 7.5"
    assert claim.reason == "The whole interval is below 20.0 %. Beside it."
    low = judge_mean(statement(Region(high=0.01), PERCENT), runs)
    assert low.verdict == "does not hold"
    assert low.reason == "No part of the interval is below 1.0 %."
    middle = judge_mean(statement(Region(0.05, 0.1), PERCENT), runs)
    assert middle.verdict == "cannot tell"
    assert middle.reason == (
        "Only a part of the interval is between 5.0 and 10.0 %: 3 runs cannot tell."
    )


def test_a_difference_names_both_sides():
    claim = judge_difference(
        statement(ABOVE_ZERO), sample("A", 3.0, 3.1, 3.2), sample("B", 2.0, 2.1, 2.0)
    )
    assert claim.verdict == "holds"
    difference, _, runs = claim.number.partition("; runs ")
    assert difference == "+1.07 N s (+0.86 to +1.27)"
    assert runs == "3.00, 3.10, 3.20 against 2.00, 2.10, 2.00"
    assert "The whole interval is above 0.00 N s." in claim.reason
    other = judge_difference(
        statement(BELOW_ZERO), sample("A", 3.0, 3.1, 3.2), sample("B", 2.0, 2.1, 2.0)
    )
    assert other.verdict == "does not hold"


def test_runs_that_all_agree_say_what_their_interval_supposes():
    runs = Sample("BC", shares((40, 40, 40), (40, 40, 40)), 3)
    claim = judge_mean(statement(Region(low=0.9), PERCENT), runs)
    assert claim.verdict == "holds"
    assert claim.number == "100.0 % (96.9 to 100.0); runs 100.0, 100.0, 100.0"
    assert "as if runs differed no more than rollouts do by chance" in claim.reason
    assert "if the rollouts of a run were all alike, it would be 43.9 to 100.0 %." in claim.reason
    equal = judge_mean(statement(ABOVE_ZERO), sample("BC", 2.0, 2.0, 2.0))
    assert (equal.verdict, equal.number) == ("cannot tell", "2.00 N s; runs 2.00, 2.00, 2.00")
    assert "All runs agree exactly" in equal.reason


def test_a_single_run_and_missing_runs_are_named():
    claim = judge_mean(statement(ABOVE_ZERO), sample("BC", 2.0))
    assert claim.verdict == "cannot tell"
    assert claim.number == "2.00 N s; runs 2.00"
    assert "single run" in claim.reason
    assert "Of BC, 1 of 3 runs are measured." in claim.reason


@pytest.mark.parametrize(
    "claim",
    [
        judge_mean(statement(ABOVE_ZERO), sample("BC")),
        judge_difference(statement(ABOVE_ZERO), sample("A", 1.0), sample("BC")),
        judge_change(statement(ABOVE_ZERO), sample("BC"), sample("BC")),
        judge_extreme(statement(ABOVE_ZERO), sample("A", 1.0), [sample("B", 2.0), sample("BC")]),
        judge_equal(EQUAL, sample("A", 1.0), sample("BC"), 0.1),
    ],
)
def test_what_is_not_measured_yet_cannot_be_told(claim):
    assert (claim.verdict, claim.number) == ("cannot tell", UNMEASURED)
    assert claim.reason == "No finished run of BC has this number."


def test_the_extreme_is_judged_against_every_rival():
    top = sample("top", 3.0, 3.1, 3.2)
    near = sample("near", 2.0, 2.1, 2.2)
    far = sample("far", 0.0, 0.1, 0.2)
    claim = judge_extreme(statement(ABOVE_ZERO), top, [far, near])
    assert claim.verdict == "holds"
    assert claim.number.startswith("+1.00 N s")
    assert "Judged against each of the others; near is the least favorable." in claim.reason
    assert judge_extreme(statement(ABOVE_ZERO), near, [far, top]).verdict == "does not hold"
    lowest = judge_extreme(statement(BELOW_ZERO), far, [top, near])
    assert lowest.verdict == "holds"
    assert lowest.number.startswith("-2.00 N s")
    assert "near is the least favorable." in lowest.reason
    assert judge_extreme(statement(BELOW_ZERO), near, [far, top]).verdict == "does not hold"


def test_a_far_rival_whose_runs_differ_much_keeps_an_extreme_from_holding():
    lowest = sample("lowest", 0.66, 0.68, 0.67)
    close = sample("close", 0.81, 0.82, 0.80)
    scattered = sample("scattered", 0.67, 0.93, 0.93)
    claim = judge_extreme(statement(BELOW_ZERO), lowest, [close, scattered])
    assert claim.verdict == "cannot tell"
    assert "scattered is the least favorable" in claim.reason
    assert judge_extreme(statement(BELOW_ZERO), lowest, [close]).verdict == "holds"


def test_equality_has_a_margin_of_the_reference():
    reference = sample("BC", 1.0, 1.01, 0.99)
    same = judge_equal(EQUAL, sample("A", 1.02, 1.01, 1.0), reference, 0.1)
    assert same.verdict == "holds"
    assert "between -0.10 and 0.10 N s" in same.reason
    assert "Up to 10 % of the value of BC count as equal." in same.reason
    other = judge_equal(EQUAL, sample("A", 1.3, 1.31, 1.29), reference, 0.1)
    assert other.verdict == "does not hold"
    unclear = judge_equal(EQUAL, sample("A", 0.8, 1.2, 1.0), reference, 0.1)
    assert unclear.verdict == "cannot tell"
    below_zero = sample("BC", -1.0, -1.01, -0.99)
    same = judge_equal(EQUAL, sample("A", -1.02, -1.01, -1.0), below_zero, 0.1)
    assert same.verdict == "holds"
    assert "between -0.10 and 0.10 N s" in same.reason


def test_changes_are_those_of_each_run():
    before = sample("A", 1.0, 5.0, 9.0)
    claim = judge_change(statement(ABOVE_ZERO), sample("A", 1.5, 5.6, 9.4), before)
    assert claim.verdict == "holds"
    assert claim.number.startswith("+0.50 N s (+0.25 to +0.75)")


def test_a_change_names_the_runs_that_lack_one_of_the_measurements():
    after = Sample("A", Runs((1.5, 5.6, 9.4), seeds=(0, 1, 2)), 3)
    before = Sample("A", Runs((1.0, 5.0), seeds=(0, 1)), 3)
    claim = judge_change(statement(ABOVE_ZERO), after, before)
    assert "Of A, 2 of 3 runs are measured" in claim.reason
    none = judge_change(statement(ABOVE_ZERO), after, Sample("A", Runs((1.0,), seeds=(5,)), 3))
    assert none.reason == "No finished run of A has this number."


def test_nothing_is_written_as_minus_zero():
    claim = judge_mean(statement(ABOVE_ZERO), sample("A", -0.001, 0.0, 0.0005))
    assert claim.number == "0.00 N s (0.00 to 0.00); runs 0.00, 0.00, 0.00"


def test_claims_survive_json():
    claim = judge_mean(
        statement(Region(high=0.05), PERCENT), Sample("BC", shares((1, 0), (9, 9)), 2)
    )
    assert from_json(Claim, to_json(claim)) == claim
