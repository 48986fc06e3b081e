"""The comparisons that a study has planned, with the outcome of each.

Every comparison has the means of both techniques, Welch's interval of their difference, and the
p-value of a permutation test, adjusted by Holm's method over all planned comparisons. A predicted
difference came true if the interval is on the predicted side of 0 and the adjusted p-value is at
most 5 %; predicted equality came true if the whole interval lies within a margin. Only the best
policy of each run counts. Read `run_statistics` for the tests, `claims` for the rule behind the
verdicts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from surefoot.config.study import Measure, PlannedComparison
from surefoot.study.claims import (
    ABOVE_ZERO,
    BELOW_ZERO,
    POINTS,
    UNMEASURED,
    NumberStyle,
    Region,
    Sample,
    Verdict,
    missing_runs,
    number_text,
    reason_of,
    verdict_of,
)
from surefoot.study.results import StudyResults
from surefoot.study.run_statistics import (
    RunDifference,
    difference_of_runs,
    holm,
    permutation_p,
    smallest_p,
)
from surefoot.study.run_values import best_value

SIGNIFICANT = 0.05
"""Largest adjusted p-value of a difference that counts."""
STYLES: dict[Measure, NumberStyle] = {
    "robustness": POINTS,
    "impulse": NumberStyle("N s", 1.0, 2),
    "imitation": NumberStyle("mrad", 1.0, 1),
}
"""How the differences of each measure are written."""
MARGINS: dict[Measure, float] = {"robustness": 0.05, "impulse": 0.25}
"""Differences that count as none, where the study names no margin: 5 percentage points, and
0.25 N s, half of what was predicted to separate techniques."""
RELATIVE_MARGIN = 0.1
"""Differences of other measures that count as none, as a share of the reference."""
SENTENCES = {
    "better": "{} does better than {}: {}.",
    "worse": "{} does worse than {}: {}.",
    "equal": "{} does as well as {}: {}.",
    "none": "{} differs from {}: {}.",
}
"""The sentence for each prediction, with the technique, the reference, and the measurement."""


@dataclass(frozen=True)
class ComparisonOutcome:
    """A planned comparison and its outcome.

    Attributes:
        text: The prediction as a sentence; without a prediction, that the techniques differ.
        section: The setting, where the study has several; empty otherwise.
        verdict: Whether the prediction came true.
        number: The difference with its interval and every run, as text.
        reason: The reason for the verdict, in sentences.
        measured: The difference and both means, in the unit of the values (success as a share, N s,
            mrad); None if not measured yet.
        p: The p-value of the permutation test; None with fewer than two runs of a technique.
        adjusted_p: The same, adjusted by Holm's method over all comparisons of the study.
        smallest_p: The smallest p-value that this number of runs can give; None without a test.
    """

    text: str
    section: str
    verdict: Verdict
    number: str
    reason: str
    measured: RunDifference | None
    p: float | None
    adjusted_p: float | None
    smallest_p: float | None


@dataclass(frozen=True)
class _Pair:
    """The runs of both techniques of a comparison, and their difference."""

    technique: Sample
    reference: Sample
    measured: RunDifference | None = None
    p: float | None = None


def comparison_outcomes(results: StudyResults) -> tuple[ComparisonOutcome, ...]:
    """The outcome of each planned comparison, in the study's order.

    Args:
        results: Results of the study, finished or not. Comparisons that are not measured yet count
            in Holm's adjustment.
    """
    planned = results.study.comparisons
    pairs = [_pair(results, comparison) for comparison in planned]
    adjusted = holm([pair.p for pair in pairs])
    return tuple(
        _outcome(results, comparison, pair, p)
        for comparison, pair, p in zip(planned, pairs, adjusted, strict=True)
    )


def _pair(results: StudyResults, comparison: PlannedComparison) -> _Pair:
    """The runs of a comparison, with their difference and its p-value."""
    pair = _Pair(
        _sample(results, comparison, comparison.technique),
        _sample(results, comparison, comparison.reference),
    )
    a = pair.technique.runs
    b = pair.reference.runs
    if a is None or b is None:
        return pair
    several = min(len(a.values), len(b.values)) > 1
    p = permutation_p(a.values, b.values) if several else None
    return replace(pair, measured=difference_of_runs(a, b), p=p)


def _sample(results: StudyResults, comparison: PlannedComparison, technique: str) -> Sample:
    """What was measured of the best policies of a technique."""
    study = results.study
    cells = results.of(technique, comparison.setting)
    measure = study.measurement(comparison.measurement).measure
    return Sample(
        study.technique(technique).title,
        best_value(cells, comparison.measurement, measure),
        len(study.seeds),
    )


def _outcome(
    results: StudyResults, comparison: PlannedComparison, pair: _Pair, adjusted_p: float | None
) -> ComparisonOutcome:
    """The outcome of one comparison."""
    study = results.study
    measurement = study.measurement(comparison.measurement)
    text = SENTENCES[comparison.prediction].format(
        pair.technique.title, pair.reference.title, measurement.title
    )
    several = len(study.settings) > 1
    outcome = ComparisonOutcome(
        text=text,
        section=study.setting(comparison.setting).title if several else "",
        verdict="cannot tell",
        number=UNMEASURED,
        reason=_unmeasured(pair),
        measured=pair.measured,
        p=pair.p,
        adjusted_p=adjusted_p,
        smallest_p=_smallest_p(pair),
    )
    if pair.measured is None:
        return outcome
    region = predicted_region(comparison, measurement.measure, pair.measured)
    by_interval = verdict_of(pair.measured.interval, region)
    is_shown_equal = comparison.prediction == "equal" and by_interval == "holds"
    is_significant = adjusted_p is not None and adjusted_p <= SIGNIFICANT
    # Equality is shown by the interval alone; every difference needs the test, too.
    verdict = by_interval if is_shown_equal or is_significant else "cannot tell"
    style = STYLES[measurement.measure]
    reasons = [
        reason_of(by_interval, pair.measured, region, style),
        _about_test(outcome, len(study.comparisons)),
        "" if verdict == by_interval else "The test does not bear the interval out.",
        missing_runs(pair.technique),
        missing_runs(pair.reference),
    ]
    return replace(
        outcome,
        verdict=verdict,
        number=number_text(pair.measured, style),
        reason=" ".join(reason for reason in reasons if reason),
    )


def _unmeasured(pair: _Pair) -> str:
    """Which technique is not measured yet."""
    missing = [each.title for each in (pair.technique, pair.reference) if each.runs is None]
    return f"No finished run of {', '.join(missing)} has this number."


def _smallest_p(pair: _Pair) -> float | None:
    """The smallest p-value that the runs of a comparison can give."""
    if pair.measured is None or pair.p is None:
        return None
    return smallest_p(len(pair.measured.a.runs), len(pair.measured.b.runs))


def _about_test(outcome: ComparisonOutcome, comparisons: int) -> str:
    """A sentence about the permutation test; empty if there is none."""
    if outcome.p is None or outcome.adjusted_p is None or outcome.smallest_p is None:
        return ""
    text = (
        f"The permutation test gives p = {outcome.p:.3f}, and {outcome.adjusted_p:.3f} by Holm's "
        f"method over {comparisons} comparisons; so many runs cannot give less than "
        f"{outcome.smallest_p:.3f}."
    )
    if outcome.smallest_p > SIGNIFICANT:
        return f"{text} That is not enough to show any difference."
    return text


def predicted_region(
    comparison: PlannedComparison, measure: Measure, measured: RunDifference
) -> Region:
    """Where the difference lies if a prediction comes true.

    Args:
        comparison: The comparison with its prediction. Without one, the prediction is that the
            techniques differ, in the direction of the measured difference.
        measure: What is measured: more is better for success and impulse, less for deviation.
        measured: The difference.
    """
    better = BELOW_ZERO if measure == "imitation" else ABOVE_ZERO
    worse = ABOVE_ZERO if measure == "imitation" else BELOW_ZERO
    if comparison.prediction == "better":
        return better
    if comparison.prediction == "worse":
        return worse
    if comparison.prediction == "none":
        return ABOVE_ZERO if measured.difference > 0.0 else BELOW_ZERO
    if comparison.margin is not None:
        margin = comparison.margin / STYLES[measure].scale
    else:
        margin = MARGINS.get(measure, RELATIVE_MARGIN * abs(measured.b.mean))
    return Region(-margin, margin)
