"""The paper's claims about the policies (V-B and V-C): robustness, tracking errors, and pushes.

Success and errors are those of the last policy of each run, impulses those of its best one. Read
`paper_runs` for the runs, `claims` for the rule behind the verdicts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from surefoot.config.study import PAPER_TECHNIQUES
from surefoot.study.claims import (
    ABOVE_ZERO,
    BELOW_ZERO,
    PERCENT,
    POINTS,
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
)
from surefoot.study.paper_runs import BC, DECAYS, EQUAL, LOCO_HALF, LOCO_MOST, SAFE, PaperRuns
from surefoot.study.results import CellResult
from surefoot.study.run_statistics import mean_of_runs
from surefoot.study.run_values import (
    Axis,
    Counted,
    direction_impulses,
    early_error,
    unpushed,
)

JUST_BELOW_90_PERCENT = Region(0.85, 0.9)
"""Shares that are just below 90 %."""
NO_WORSE = Region(low=-0.05)
"""Differences of success that are no significant disadvantage."""
MOST_DIRECTIONS = Region(low=0.5)
"""Shares of directions that count as most of them."""
VX: Axis = 0
VY: Axis = 1
YAW: Axis = 2
SPEED = NumberStyle("thousandths of m²/s²", 1000.0, 3)
YAW_RATE = NumberStyle("thousandths of rad²/s²", 1000.0, 3)
IMPULSE = NumberStyle("N s", 1.0, 2)

section_b = partial(Statement, "V-B")
section_c = partial(Statement, "V-C")


def robustness_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-B, Fig. 3: success from perturbed initial states."""
    grows = "The robustness of {} grows with the size of its dataset."
    plateau = "{} ends with a success rate just below 90 %."
    least = "LocoDAGGER 0.8 ends with a lower success rate than all others."
    as_good = "{} ends at most 5 points below the success rate of BC."
    return (
        *(
            judge_change(
                section_b(f"{each}-grows", grows.format(paper.title(each)), POINTS, ABOVE_ZERO),
                paper.success(each),
                paper.success(each, first=True),
                "The last policy against the first.",
            )
            for each in PAPER_TECHNIQUES
        ),
        *(
            judge_mean(
                section_b(
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
            section_b("most-least-robust", least, POINTS, BELOW_ZERO),
            paper.success(LOCO_MOST),
            [paper.success(each) for each in (BC, LOCO_HALF, SAFE)],
        ),
        *(
            judge_difference(
                section_b(f"{each}-as-good", as_good.format(paper.title(each)), POINTS, NO_WORSE),
                paper.success(each),
                paper.success(BC),
            )
            for each in (LOCO_HALF, SAFE)
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

    def settled(axis: Axis, techniques: Sequence[str] = PAPER_TECHNIQUES) -> str:
        samples = [paper.settled(technique, axis) for technique in techniques]
        return _settled_text(samples, YAW_RATE if axis == YAW else SPEED)

    return (
        judge_extreme(
            section_b("most-worst-vx", worst.format("vx"), SPEED, ABOVE_ZERO),
            paper.error(LOCO_MOST, VX),
            errors(VX, (BC, LOCO_HALF, SAFE)),
            settled(VX),
        ),
        judge_extreme(
            section_b("most-worst-yaw", worst.format("the yaw rate"), YAW_RATE, ABOVE_ZERO),
            paper.error(LOCO_MOST, YAW),
            errors(YAW, (BC, LOCO_HALF, SAFE)),
            settled(YAW),
        ),
        judge_equal(
            section_b("equal-vx", same, SPEED),
            paper.error(SAFE, VX),
            paper.error(BC, VX),
            EQUAL,
            settled(VX, (SAFE, BC)),
        ),
        judge_extreme(
            section_b("half-higher-vx", higher, SPEED, ABOVE_ZERO),
            paper.error(LOCO_HALF, VX),
            errors(VX, (BC, SAFE)),
            settled(VX, (LOCO_HALF, BC, SAFE)),
        ),
        judge_difference(
            section_b("half-earlier-vx", earlier, SPEED, ABOVE_ZERO),
            paper.values(LOCO_HALF, lambda cell: early_error(cell, paper.test, VX)),
            paper.values(SAFE, lambda cell: early_error(cell, paper.test, VX)),
            "Mean over the first half of the iterations, which BC does not have.",
        ),
        judge_extreme(
            section_b("cloning-best-yaw", best, YAW_RATE, BELOW_ZERO),
            paper.error(BC, YAW),
            errors(YAW, (LOCO_HALF, LOCO_MOST, SAFE)),
            settled(YAW),
        ),
        judge_extreme(
            section_b("safe-second-yaw", second, YAW_RATE, BELOW_ZERO),
            paper.error(SAFE, YAW),
            errors(YAW, (LOCO_HALF, LOCO_MOST)),
            settled(YAW, (SAFE, LOCO_HALF, LOCO_MOST)),
        ),
        _no_best_claim(
            section_b("no-best-vy", "No technique tracks vy clearly best.", SPEED),
            errors(VY, PAPER_TECHNIQUES),
            settled(VY),
        ),
    )


def _settled_text(samples: Sequence[Sample], style: NumberStyle) -> str:
    """Errors from 1 s on in all episodes that last that long, even if they fail later."""
    parts = [
        f"{sample.title} {style.scale * mean_of_runs(sample.runs).mean:.{style.digits}f}"
        for sample in samples
        if sample.runs is not None
    ]
    return f"From 1 s on, in all episodes: {', '.join(parts)}." if parts else ""


def _no_best_claim(statement: Statement, samples: Sequence[Sample], beside: str) -> Claim:
    """Judge whether the technique with the smallest error is about as good as the second.

    Args:
        statement: The claim, without a region.
        samples: The error of each technique.
        beside: A sentence with related numbers, which ends the reason.
    """
    measured = [(mean_of_runs(sample.runs).mean, sample) for sample in samples if sample.runs]
    if len(measured) < len(samples):
        return judge_extreme(statement, samples[0], samples[1:])  # this names what is missing
    measured.sort(key=lambda pair: pair[0])
    best = measured[0][1]
    second = measured[1][1]
    order = f"The best is {best.title}, the second {second.title}."
    return judge_equal(statement, second, best, EQUAL, f"{order} {beside}".strip())


def push_claims(paper: PaperRuns) -> tuple[Claim, ...]:
    """V-C, Fig. 5: impulses that the best policies withstand, mean of all directions."""
    least = "BC withstands a smaller impulse than all others."
    more = "LocoSafeDAGGER withstands more than LocoDAGGER {}, in the mean of all directions."
    most = "LocoSafeDAGGER withstands more than LocoDAGGER {} from most directions."
    return (
        judge_extreme(
            section_c("cloning-least-push", least, IMPULSE, BELOW_ZERO),
            paper.impulse(BC),
            [paper.impulse(each) for each in (LOCO_HALF, LOCO_MOST, SAFE)],
            _survival(paper, PAPER_TECHNIQUES),
        ),
        *(
            judge_difference(
                section_c(f"safe-push-{alpha}", more.format(alpha), IMPULSE, ABOVE_ZERO),
                paper.impulse(SAFE),
                paper.impulse(technique),
                _survival(paper, (SAFE, technique)),
            )
            for alpha, technique in DECAYS
        ),
        *(
            judge_mean(
                section_c(f"safe-most-{alpha}", most.format(alpha), PERCENT, MOST_DIRECTIONS),
                paper.shares(SAFE, lambda cell, other=technique: _larger(paper, cell, other)),
                "The share of directions, against the run of the same seed.",
            )
            for alpha, technique in DECAYS
        ),
    )


def _larger(paper: PaperRuns, cell: CellResult, technique: str) -> Counted | None:
    """Number of directions in which a run withstands more than its seed's rival, and of all."""
    run = direction_impulses(cell, paper.push)
    for rival in paper.cells(technique):
        if rival.cell.seed == cell.cell.seed:
            other = direction_impulses(rival, paper.push)
            if run is not None and other is not None:
                return int(np.greater(run, other).sum()), len(run)
    return None


def _survival(paper: PaperRuns, techniques: Sequence[str]) -> str:
    """How many robots survive unpushed, and which runs count as 0 N s because too few do."""
    parts = []
    for each in techniques:
        runs = paper.shares(each, lambda cell: unpushed(cell, paper.push)).runs
        impulses = paper.impulse(each).runs
        if runs is None or impulses is None:
            continue
        zeros = sum(impulse == 0.0 for impulse in impulses.values)
        none = f" ({zeros} of its runs withstand no push that was tried)" if zeros else ""
        parts.append(f"{paper.title(each)} {100 * mean_of_runs(runs).mean:.1f} %{none}")
    return f"Survive without a push: {', '.join(parts)}." if parts else ""
