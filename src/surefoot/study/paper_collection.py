"""The paper's claims about collecting data (V-A): failures, the share of the MPC, and its cost.

Where the paper counts in another way than we do, a claim is listed twice. Read `paper_runs` for the
runs, `claims` for the rule behind the verdicts.
"""

from __future__ import annotations

from functools import partial

from surefoot.study.claims import (
    ABOVE_ZERO,
    BELOW_ZERO,
    PERCENT,
    POINTS,
    Claim,
    NumberStyle,
    Region,
    Statement,
    judge_change,
    judge_difference,
    judge_equal,
    judge_extreme,
    judge_mean,
)
from surefoot.study.paper_runs import (
    DECAYS,
    EQUAL,
    LOCO,
    LOCO_HALF,
    LOCO_MOST,
    SAFE,
    PaperRuns,
    early_half,
    first_iteration,
    late_half,
    percent,
    second_on,
    third_on,
)
from surefoot.study.run_statistics import mean_of_runs
from surefoot.study.run_values import (
    dataset_frames,
    falls_per_minute,
    iterations_collected,
    largest_rise,
    rollouts,
    share_with_tail,
    solves,
    solves_per_second,
)

FEW_FAILURES = Region(high=0.05)
"""The paper's limit of a low failure rate (V-A)."""
MANY_FAILURES = Region(low=0.05)
"""Failure rates above it."""
ABOUT_TEN_PERCENT = Region(0.05, 0.15)
"""Shares that are about 10 %."""
CONSTANT = Region(-0.05, 0.05)
"""Changes of a share that count as none."""
NO_RISE = Region(high=0.02)
"""Rises of the expert's share from one iteration to the next that may be due to chance: with 1000
tosses of a coin in each iteration, the share has a standard deviation of up to 1.6 points."""
FALLS = NumberStyle("falls per robot-minute", 1.0, 3)
SOLVES = NumberStyle("MPC solves", 1.0, 0)
SOLVES_PER_SECOND = NumberStyle("MPC solves per second of rollouts", 1.0, 2)
FRAMES = NumberStyle("thousand frames", 1e-3, 0)

section_a = partial(Statement, "V-A")


def failure_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-A, Fig. 1: how often rollouts fail while data is collected."""
    few = "After the first iteration, LocoSafeDAGGER fails in less than 5 % of its rollouts."
    falls = (
        "After the first iteration, less than 5 % of LocoSafeDAGGER's rollouts end in a fall or "
        "with a diverging MPC."
    )
    first = "In the first iteration, LocoSafeDAGGER fails in more than 5 % of its rollouts."
    half = "From the third iteration on, LocoDAGGER 0.5 fails in more than 5 % of its rollouts."
    most = "In later iterations, LocoDAGGER 0.8 fails in more than 5 % of its rollouts."
    rise = "LocoDAGGER {} fails more often in the second half of the iterations than in the first."
    return (
        judge_mean(
            section_a("safe-failures", few, PERCENT, FEW_FAILURES),
            paper.failures(SAFE, second_on),
            f"Iterations from the second on: {_rates(paper, SAFE, 1)}.",
        ),
        judge_mean(
            section_a("safe-falls", falls, PERCENT, FEW_FAILURES),
            paper.lost(SAFE, second_on),
            "The same claim as before; falls are counted too, whoever drove.",
        ),
        judge_mean(
            section_a("safe-first", first, PERCENT, MANY_FAILURES),
            paper.failures(SAFE, first_iteration),
            f"Falls: {percent(paper.falls(SAFE, first_iteration))}.",
        ),
        judge_mean(
            section_a("half-failures", half, PERCENT, MANY_FAILURES),
            paper.failures(LOCO_HALF, third_on),
            f"Falls, whoever drove: {percent(paper.falls(LOCO_HALF, third_on))}. "
            f"Iterations from the third on: {_rates(paper, LOCO_HALF, 2)}.",
        ),
        judge_mean(
            section_a("most-failures", most, PERCENT, MANY_FAILURES),
            paper.failures(LOCO_MOST, late_half),
            "The second half of the iterations. Falls, whoever drove: "
            f"{percent(paper.falls(LOCO_MOST, late_half))}.",
        ),
        *(
            judge_change(
                section_a(f"{technique}-rises", rise.format(alpha), POINTS, ABOVE_ZERO),
                paper.failures(technique, late_half),
                paper.failures(technique, early_half),
            )
            for alpha, technique in DECAYS
        ),
    )


def _rates(paper: PaperRuns, technique: str, skipped: int) -> str:
    """Failure rate of each iteration after some skipped ones, mean over runs, as text."""
    longest = max((len(iterations_collected(cell)) for cell in paper.cells(technique)), default=0)
    rates = []
    for number in range(skipped, longest):
        one = paper.failures(
            technique, lambda cell, n=number: iterations_collected(cell)[n : n + 1]
        )
        rates.append(percent(one))
    return ", ".join(rates) or "none"


def safest_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-A, Fig. 1: which technique fails less than others."""
    less = "LocoDAGGER 0.8 fails in fewer of its rollouts than LocoDAGGER 0.5."
    least = "LocoSafeDAGGER fails in fewer of its rollouts than LocoDAGGER with either decay."
    falls = "LocoSafeDAGGER falls less often in a minute than LocoDAGGER with either decay."
    return (
        judge_difference(
            section_a("most-fails-less", less, POINTS, BELOW_ZERO),
            paper.failures(LOCO_MOST),
            paper.failures(LOCO_HALF),
        ),
        judge_extreme(
            section_a("safe-fails-least", least, POINTS, BELOW_ZERO),
            paper.failures(SAFE),
            [paper.failures(technique) for technique in LOCO],
            "The paper's count leaves out LocoSafeDAGGER's falls.",
        ),
        judge_extreme(
            section_a("safe-falls-least", falls, FALLS, BELOW_ZERO),
            paper.values(SAFE, falls_per_minute),
            [paper.values(technique, falls_per_minute) for technique in LOCO],
            "The same claim in falls, by time, because its rollouts are twice as long.",
        ),
    )


def share_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-A, Fig. 2: how much the MPC drives."""
    about = "With LocoSafeDAGGER the MPC drives about 10 % of the time."
    constant = "With LocoSafeDAGGER the share of the MPC stays constant over the iterations."
    falls = "With LocoDAGGER {} the share of the MPC falls monotonically."
    return (
        judge_mean(
            section_a("safe-share", about, PERCENT, ABOUT_TEN_PERCENT),
            paper.expert(SAFE),
            f"With the expert's tails it is {percent(paper.values(SAFE, share_with_tail))}.",
        ),
        judge_change(
            section_a("safe-share-constant", constant, POINTS, CONSTANT),
            paper.expert(SAFE, late_half),
            paper.expert(SAFE, early_half),
            "The second half of the iterations against the first.",
        ),
        *(
            judge_mean(
                section_a(f"{technique}-share-falls", falls.format(alpha), POINTS, NO_RISE),
                paper.values(technique, largest_rise),
                "The number is the largest rise from one iteration to the next. In the first one "
                f"the share is {percent(paper.expert(technique, first_iteration))}; the coin that "
                "the method throws makes it so.",
            )
            for alpha, technique in DECAYS
        ),
    )


def cost_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-A and V-B: how often the MPC is asked, and how much data that gives."""
    fewer = "LocoSafeDAGGER asks the MPC less often than LocoDAGGER with either decay."
    second = "LocoSafeDAGGER asks the MPC less often, for each second of rollouts."
    size = (
        "LocoSafeDAGGER reaches the same size of the dataset as LocoDAGGER 0.5 with four times as "
        "many rollouts."
    )
    return (
        judge_extreme(
            section_a("safe-solves", fewer, SOLVES, BELOW_ZERO),
            paper.values(SAFE, solves),
            [paper.values(technique, solves) for technique in LOCO],
            "Tails and LocoDAGGER's queries are counted, the pre-training is not.",
        ),
        judge_extreme(
            section_a("safe-solves-per-second", second, SOLVES_PER_SECOND, BELOW_ZERO),
            paper.values(SAFE, solves_per_second),
            [paper.values(technique, solves_per_second) for technique in LOCO],
        ),
        judge_equal(
            Statement("V-B", "safe-data", size, FRAMES),
            paper.values(SAFE, dataset_frames),
            paper.values(LOCO_HALF, dataset_frames),
            EQUAL,
            _times_as_many(paper),
        ),
    )


def _times_as_many(paper: PaperRuns) -> str:
    """A sentence with the ratio of LocoSafeDAGGER's rollouts to LocoDAGGER's; empty if unknown."""
    safe = paper.values(SAFE, rollouts).runs
    loco = paper.values(LOCO_HALF, rollouts).runs
    if safe is None or loco is None:
        return ""
    return f"It has {mean_of_runs(safe).mean / mean_of_runs(loco).mean:.1f} times as many rollouts."
