"""Claims and their verdicts: a number with an interval over runs, and one rule.

A claim says that a number lies in a region, for example below 5 %. It holds if the whole 95 %
interval over runs lies inside the region; it does not hold if no part of the interval does;
otherwise the runs cannot tell, just as when nothing has been measured yet. "X is the largest" is
judged by the differences to all rivals, and shows the least favorable one. Read `run_statistics`
for the intervals, `paper_claims` for the paper's claims, and `planned_comparisons` for those that a
study plans itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from surefoot.evaluation.statistics import Interval, RunMeans, wilson
from surefoot.study.run_statistics import (
    RunDifference,
    Runs,
    change_in_runs,
    difference_of_runs,
    mean_of_runs,
    of_both,
)

Verdict = Literal["holds", "does not hold", "cannot tell"]
"""What the runs show about a claim."""
FROM_WORST: tuple[Verdict, ...] = ("does not hold", "cannot tell", "holds")
"""The verdicts, from the least to the most favorable."""
UNMEASURED = "not measured yet"
"""The number of a claim whose runs are missing."""


@dataclass(frozen=True)
class Claim:
    """A sentence with its verdict.

    Attributes:
        name: Short name of the claim.
        text: The sentence.
        section: Section of the paper that makes the claim.
        verdict: What the runs show about it.
        number: What was measured, with its interval and every run, as text.
        reason: The reason for the verdict, in sentences.
    """

    name: str
    text: str
    section: str
    verdict: Verdict
    number: str
    reason: str


@dataclass(frozen=True)
class Region:
    """Where a number lies if a claim holds, in the unit of the runs' values.

    Attributes:
        low: The number is above this.
        high: The number is below this.
    """

    low: float = -math.inf
    high: float = math.inf


ABOVE_ZERO = Region(low=0.0)
"""A difference that is positive."""
BELOW_ZERO = Region(high=0.0)
"""A difference that is negative."""


@dataclass(frozen=True)
class NumberStyle:
    """How the numbers of claims and comparisons are written in text.

    Attributes:
        unit: The unit, as text.
        scale: Factor that converts a value to this unit.
        digits: Number of digits after the point.
    """

    unit: str
    scale: float = 1.0
    digits: int = 2


PERCENT = NumberStyle("%", 100.0, 1)
"""A share."""
POINTS = NumberStyle("points", 100.0, 1)
"""A difference of shares, in percentage points."""


@dataclass(frozen=True)
class Statement:
    """A claim before it is judged.

    Attributes:
        section: Section of the paper that makes the claim.
        name: Short name of the claim.
        text: The sentence.
        style: How its number is written.
        region: Where the number lies if the claim holds; `judge_equal` finds it by its margin.
    """

    section: str
    name: str
    text: str
    style: NumberStyle
    region: Region = Region()


@dataclass(frozen=True)
class Sample:
    """The runs of one technique.

    Attributes:
        title: Name of the technique in texts.
        runs: What was measured for each run; None if nothing has been measured yet.
        planned: Number of runs that the study plans.
    """

    title: str
    runs: Runs | None
    planned: int


def verdict_of(interval: Interval | None, region: Region) -> Verdict:
    """The rule: whether the whole interval lies inside the region, no part of it, or neither.

    Args:
        interval: A 95 % interval over runs; None if nothing shows how much runs differ.
        region: Where the number lies if the claim holds.
    """
    if interval is None:
        return "cannot tell"
    low, high = interval
    if region.low < low and high < region.high:
        return "holds"
    if high <= region.low or region.high <= low:
        return "does not hold"
    return "cannot tell"


def judge_mean(statement: Statement, sample: Sample, beside: str = "") -> Claim:
    """Judge a mean over the runs of a technique.

    Args:
        statement: The claim.
        sample: The runs.
        beside: A sentence with related numbers, which ends the reason.
    """
    if sample.runs is None:
        return _unmeasured(statement, [sample])
    return _judged(statement, mean_of_runs(sample.runs), [sample], beside)


def judge_difference(statement: Statement, a: Sample, b: Sample, beside: str = "") -> Claim:
    """Judge the mean of one technique minus that of another.

    Args:
        statement: The claim.
        a: The runs of one technique.
        b: The runs of the other one, which is subtracted.
        beside: A sentence with related numbers, which ends the reason.
    """
    if a.runs is None or b.runs is None:
        return _unmeasured(statement, [a, b])
    return _judged(statement, difference_of_runs(a.runs, b.runs), [a, b], beside)


def judge_change(statement: Statement, after: Sample, before: Sample, beside: str = "") -> Claim:
    """Judge how much the runs of a technique change, from one measurement to another.

    Args:
        statement: The claim.
        after: The later measurement.
        before: The earlier measurement of the same runs, which is subtracted.
        beside: A sentence with related numbers, which ends the reason.
    """
    both = after.runs and before.runs and of_both(after.runs, before.runs)
    if not both:
        return _unmeasured(statement, [replace(after, runs=None)])
    return _judged(statement, change_in_runs(*both), [replace(after, runs=both[0])], beside)


def judge_extreme(
    statement: Statement, sample: Sample, rivals: Sequence[Sample], beside: str = ""
) -> Claim:
    """Judge whether a technique is above all rivals, or below all of them, as the region says.

    The claim holds if it holds against every rival, and does not hold if it fails against any. The
    number is the difference to the least favorable rival: the one with the worst verdict and, among
    several of those, the difference that speaks most against the claim.

    Args:
        statement: The claim; its region is `ABOVE_ZERO` or `BELOW_ZERO`.
        sample: The runs of the technique.
        rivals: The runs of the others.
        beside: A sentence with related numbers, which ends the reason.
    """
    runs = sample.runs
    measured = [(rival, rival.runs) for rival in rivals if rival.runs is not None]
    if runs is None or len(measured) < len(rivals):
        return _unmeasured(statement, [sample, *rivals])
    sign = 1.0 if statement.region == ABOVE_ZERO else -1.0

    def favor(pair: tuple[Sample, Runs]) -> tuple[int, float]:
        """How strongly the difference to a rival supports the claim."""
        difference = difference_of_runs(runs, pair[1])
        verdict = verdict_of(difference.interval, statement.region)
        return FROM_WORST.index(verdict), sign * difference.difference

    worst, _ = min(measured, key=favor)
    others = f"Judged against each of the others; {worst.title} is the least favorable."
    return judge_difference(statement, sample, worst, f"{others} {beside}".strip())


def judge_equal(
    statement: Statement, a: Sample, b: Sample, margin: float, beside: str = ""
) -> Claim:
    """Judge whether the means of two techniques are equal within a margin.

    Args:
        statement: The claim, without a region.
        a: The runs of one technique.
        b: The runs of the other.
        margin: Largest difference that counts as equal, as a share of the mean of b.
        beside: A sentence with related numbers, which ends the reason.
    """
    if b.runs is None:
        return _unmeasured(statement, [a, b])
    width = margin * abs(mean_of_runs(b.runs).mean)
    within = f"Up to {100 * margin:.0f} % of the value of {b.title} count as equal."
    return judge_difference(
        replace(statement, region=Region(-width, width)), a, b, f"{within} {beside}".strip()
    )


def _unmeasured(statement: Statement, samples: Sequence[Sample]) -> Claim:
    """The claim while runs are missing."""
    missing = dict.fromkeys(sample.title for sample in samples if sample.runs is None)
    reason = f"No finished run of {', '.join(missing)} has this number."
    return Claim(
        statement.name, statement.text, statement.section, "cannot tell", UNMEASURED, reason
    )


def _judged(
    statement: Statement,
    estimate: RunMeans | RunDifference,
    samples: Sequence[Sample],
    beside: str,
) -> Claim:
    """The claim with the verdict on an estimate."""
    verdict = verdict_of(estimate.interval, statement.region)
    reasons = [
        reason_of(verdict, estimate, statement.region, statement.style),
        *(missing_runs(sample) for sample in samples),
        beside,
    ]
    return Claim(
        statement.name,
        statement.text,
        statement.section,
        verdict,
        number_text(estimate, statement.style),
        " ".join(reason for reason in reasons if reason),
    )


def number_text(estimate: RunMeans | RunDifference, style: NumberStyle) -> str:
    """An estimate with its unit, its interval and every run, as text."""
    if isinstance(estimate, RunMeans):
        value = _plain(estimate.mean, style)
        runs = _listed(estimate, style)
    else:
        value = _plain(estimate.difference, style, "+")
        runs = f"{_listed(estimate.a, style)} against {_listed(estimate.b, style)}"
    text = f"{value} {style.unit}"
    if estimate.interval is not None:
        sign = "" if isinstance(estimate, RunMeans) else "+"
        low, high = (_plain(end, style, sign) for end in estimate.interval)
        text += f" ({low} to {high})"
    return f"{text}; runs {runs}"


def _listed(means: RunMeans, style: NumberStyle) -> str:
    """The values of runs, as text."""
    return ", ".join(_plain(value, style) for value in means.runs)


def _plain(value: float, style: NumberStyle, sign: str = "") -> str:
    """A value in a style, without its unit; zero is never written as -0."""
    rounded = round(value * style.scale, style.digits) + 0.0
    return f"{rounded:{sign}.{style.digits}f}"


def reason_of(
    verdict: Verdict, estimate: RunMeans | RunDifference, region: Region, style: NumberStyle
) -> str:
    """The reason for a verdict, in sentences."""
    arms = [estimate] if isinstance(estimate, RunMeans) else [estimate.a, estimate.b]
    fewest = min(len(arm.runs) for arm in arms)
    if estimate.interval is None and fewest == 1:
        return "There is a single run, and nothing shows how much runs differ."
    if estimate.interval is None:
        return "All runs agree exactly, and nothing shows how much they differ by chance."
    where = _region_text(region, style)
    count = " against ".join(str(len(arm.runs)) for arm in arms)
    texts: dict[Verdict, str] = {
        "holds": f"The whole interval is {where}.",
        "does not hold": f"No part of the interval is {where}.",
        "cannot tell": f"Only a part of the interval is {where}: {count} runs cannot tell.",
    }
    if any(len(set(arm.runs)) > 1 for arm in arms):
        return texts[verdict]
    agree = (
        f"{texts[verdict]} All runs agree, so that the interval is that of all rollouts together, "
        "as if runs differed no more than rollouts do by chance"
    )
    if isinstance(estimate, RunDifference):
        return f"{agree}."
    runs = len(estimate.runs)
    low, high = wilson(estimate.mean * runs, runs)
    return (
        f"{agree}; if the rollouts of a run were all alike, it would be {_plain(low, style)} to "
        f"{_plain(high, style)} {style.unit}."
    )


def _region_text(region: Region, style: NumberStyle) -> str:
    """A region as text, such as `below 5.0 %`."""
    low = _plain(region.low, style) if math.isfinite(region.low) else ""
    high = _plain(region.high, style) if math.isfinite(region.high) else ""
    if low and high:
        return f"between {low} and {high} {style.unit}"
    return f"above {low} {style.unit}" if low else f"below {high} {style.unit}"


def missing_runs(sample: Sample) -> str:
    """A sentence about how many of a technique's runs are measured; empty if all are."""
    count = 0 if sample.runs is None else len(sample.runs.values)
    if count >= sample.planned:
        return ""
    return f"Of {sample.title}, {count} of {sample.planned} runs are measured."
