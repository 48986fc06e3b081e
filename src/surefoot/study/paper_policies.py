"""The paper's claims about the policies (V-B and V-C): robustness, tracking errors, and pushes.

Success and errors are those of the last policy of each run, impulses those of its best one. Read
`paper_runs` for the runs, `claims` for the rule of the verdicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from surefoot.study.claims import (
    ABOVE_ZERO,
    BELOW_ZERO,
    PERCENT,
    POINTS,
    Claim,
    Quantity,
    Region,
    Sample,
    Statement,
    judge_change,
    judge_difference,
    judge_equal,
    judge_extreme,
    judge_mean,
)
from surefoot.study.paper_runs import BC, EQUAL, LOCO_HALF, LOCO_MOST, SAFE, PaperRuns
from surefoot.study.run_statistics import mean_of_runs
from surefoot.study.run_values import Axis, direction_impulses, early_error

JUST_BELOW_90_PERCENT = Region(0.85, 0.9)
"""Shares that are just below 90 %."""
VX: Axis = 0
VY: Axis = 1
YAW: Axis = 2
SPEED = Quantity("thousandths of m²/s²", 1000.0, 3)
YAW_RATE = Quantity("thousandths of rad²/s²", 1000.0, 3)
IMPULSE = Quantity("N s", 1.0, 2)
ALL = (BC, LOCO_HALF, LOCO_MOST, SAFE)
"""All techniques that learn."""

robustness = partial(Statement, "V-B", 3)
tracking = partial(Statement, "V-B", 4)
pushes = partial(Statement, "V-C", 5)


def robustness_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-B, Fig. 3: success from perturbed initial states."""
    grows = "The robustness of {} grows with the size of its dataset."
    plateau = "{} ends with a success rate just below 90 %."
    least = "LocoDAGGER 0.8 ends with a lower success rate than all others."
    return (
        *(
            judge_change(
                robustness(f"{each}-grows", grows.format(paper.title(each)), POINTS, ABOVE_ZERO),
                paper.success(each),
                paper.success(each, first=True),
                "The last policy against the first.",
            )
            for each in ALL
        ),
        *(
            judge_mean(
                robustness(
                    f"{each}-plateau",
                    plateau.format(paper.title(each)),
                    PERCENT,
                    JUST_BELOW_90_PERCENT,
                ),
                paper.success(each),
            )
            for each in (BC, LOCO_HALF, SAFE)
        ),
        judge_extreme(
            robustness("most-least-robust", least, POINTS, BELOW_ZERO),
            paper.success(LOCO_MOST),
            [paper.success(each) for each in (BC, LOCO_HALF, SAFE)],
        ),
    )


def tracking_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-B, Fig. 4: how well the commanded velocity is tracked."""
    worst = "LocoDAGGER 0.8 tracks {} worse than all others."
    same = "BC and LocoSafeDAGGER end with the same error of vx."
    higher = "LocoDAGGER 0.5 ends with a higher error of vx than BC and LocoSafeDAGGER."
    earlier = "LocoDAGGER 0.5 has a higher error of vx than LocoSafeDAGGER in earlier iterations."
    best = "BC tracks the yaw rate better than all others."
    second = "LocoSafeDAGGER tracks the yaw rate better than LocoDAGGER with either decay."

    def errors(axis: Axis, techniques: Sequence[str]) -> list[Sample]:
        return [paper.error(technique, axis) for technique in techniques]

    return (
        judge_extreme(
            tracking("most-worst-vx", worst.format("vx"), SPEED, ABOVE_ZERO),
            paper.error(LOCO_MOST, VX),
            errors(VX, (BC, LOCO_HALF, SAFE)),
        ),
        judge_extreme(
            tracking("most-worst-yaw", worst.format("the yaw rate"), YAW_RATE, ABOVE_ZERO),
            paper.error(LOCO_MOST, YAW),
            errors(YAW, (BC, LOCO_HALF, SAFE)),
        ),
        judge_equal(
            tracking("equal-vx", same, SPEED, ABOVE_ZERO),
            paper.error(SAFE, VX),
            paper.error(BC, VX),
            EQUAL,
        ),
        judge_extreme(
            tracking("half-higher-vx", higher, SPEED, ABOVE_ZERO),
            paper.error(LOCO_HALF, VX),
            errors(VX, (BC, SAFE)),
        ),
        judge_difference(
            tracking("half-earlier-vx", earlier, SPEED, ABOVE_ZERO),
            paper.values(LOCO_HALF, lambda cell: early_error(cell, paper.test, VX)),
            paper.values(SAFE, lambda cell: early_error(cell, paper.test, VX)),
            "Mean over the first half of the iterations, which BC does not have.",
        ),
        judge_extreme(
            tracking("cloning-best-yaw", best, YAW_RATE, BELOW_ZERO),
            paper.error(BC, YAW),
            errors(YAW, (LOCO_HALF, LOCO_MOST, SAFE)),
        ),
        judge_extreme(
            tracking("safe-second-yaw", second, YAW_RATE, BELOW_ZERO),
            paper.error(SAFE, YAW),
            errors(YAW, (LOCO_HALF, LOCO_MOST)),
        ),
        _no_best_claim(
            tracking("no-best-vy", "No technique tracks vy clearly best.", SPEED, BELOW_ZERO),
            errors(VY, ALL),
        ),
    )


def _no_best_claim(statement: Statement, samples: Sequence[Sample]) -> Claim:
    """Judge whether the technique with the smallest error is about as good as the second.

    Args:
        statement: The claim, whose region is replaced.
        samples: The error of each technique.
    """
    measured = [(mean_of_runs(sample.runs).mean, sample) for sample in samples if sample.runs]
    if len(measured) < len(samples):
        return judge_extreme(statement, samples[0], samples[1:])  # It says which ones are missing.
    measured.sort(key=lambda pair: pair[0])
    best = measured[0][1]
    second = measured[1][1]
    beside = f"The best is {best.title}, the second {second.title}."
    return judge_equal(statement, second, best, EQUAL, beside)


def push_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-C, Fig. 5: impulses that the best policies withstand, mean of all directions."""
    least = "BC withstands a smaller impulse than all others."
    more = "LocoSafeDAGGER withstands slightly more than LocoDAGGER {}, from most directions."
    return (
        judge_extreme(
            pushes("cloning-least-push", least, IMPULSE, BELOW_ZERO),
            paper.impulse(BC),
            [paper.impulse(each) for each in (LOCO_HALF, LOCO_MOST, SAFE)],
        ),
        *(
            judge_difference(
                pushes(f"safe-push-{alpha}", more.format(alpha), IMPULSE, ABOVE_ZERO),
                paper.impulse(SAFE),
                paper.impulse(technique),
                _directions(paper, technique),
            )
            for alpha, technique in (("0.5", LOCO_HALF), ("0.8", LOCO_MOST))
        ),
    )


def _directions(paper: PaperRuns, technique: str) -> str:
    """From how many directions LocoSafeDAGGER withstands more; empty if that is unknown."""
    safe = direction_impulses(paper.cells(SAFE), paper.push)
    other = direction_impulses(paper.cells(technique), paper.push)
    if not safe or len(safe) != len(other):
        return ""
    more = sum(a > b for a, b in zip(safe, other, strict=True))
    return f"Its mean over runs is larger from {more} of {len(safe)} directions."
