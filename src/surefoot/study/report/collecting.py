"""The paper's first two figures: failed rollouts while collecting data, and the share of the MPC.

In the paper's count (IV-F) a rollout of LocoDAGGER fails if the MPC diverges while it drives, or if
the robot falls while the policy drives; a rollout of LocoSafeDAGGER fails only if the MPC diverges.
Physical falls are shown beside this count: all of them, whoever drove.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from surefoot.study.report.numbers import Number, difference, share, total
from surefoot.study.report.panels import Group, Panel, Quantity, ReportFigure, RunPoint, percent
from surefoot.study.report.source import StageSource, collections, grouped, panel
from surefoot.study.results import CellResult, StudyResults
from surefoot.study.run_values import MONITORED

LIMIT = 0.05
"""The share of failed rollouts that the paper's text names (V-A)."""
SHARE_LIMIT = 0.10
"""The share of the MPC that the paper's text names for LocoSafeDAGGER (V-A)."""

ABOUT_FAILURES = (
    "In the paper's count a rollout of LocoDAGGER fails if the MPC diverges while it drives or the "
    "robot falls while the policy drives, one of LocoSafeDAGGER if the MPC diverges. Physical "
    "falls count every fall, whoever drove. The dashed line is at 5 %, which the paper's text "
    "names."
)
"""How to read panels of failed rollouts."""

FAILED = percent("failed, in the paper's count")
"""The paper's failures, as a share of an iteration's rollouts."""
FALLS = percent("fell, whoever drove")
"""Physical falls, as a share of an iteration's rollouts."""
SHARE = percent("MPC drove, over T")
"""The share of the rollouts' time that the expert drove."""
SHARE_WITH_TAIL = percent("MPC drove, with the tail")
"""The same share, over the rollouts with their tails."""

ValueOf = Callable[[StageSource, str], Number]
"""Returns the number to show for a collection, given the name of its method."""


def collecting_figures(results: StudyResults) -> tuple[ReportFigure, ...]:
    """The figures of failures and of the share of the MPC; none without any iteration."""
    figures = (
        ReportFigure(
            "1-failures",
            "Failed rollouts while collecting data",
            f"Share of the rollouts of each iteration. {ABOUT_FAILURES}",
            "iterations",
            _rows(
                results,
                (
                    (FAILED, paper_failures, LIMIT),
                    (FALLS, falls, LIMIT),
                ),
            ),
        ),
        ReportFigure(
            "2-expert-share",
            "Share of the MPC while collecting data",
            "Share of the time of each iteration's rollouts in which the MPC drove: over the "
            "rollout of duration T, as in the paper, and with the tail after it. The dashed line "
            "is at 10 %, which the paper's text names.",
            "iterations",
            _rows(
                results,
                (
                    (SHARE, _field("expert_share"), SHARE_LIMIT),
                    (
                        SHARE_WITH_TAIL,
                        _field("expert_share_with_tail"),
                        SHARE_LIMIT,
                    ),
                ),
            ),
        ),
    )
    return tuple(figure for figure in figures if figure.curves)


def _rows(
    results: StudyResults, columns: Sequence[tuple[Quantity, ValueOf, float]]
) -> tuple[tuple[Panel, ...], ...]:
    """A row of panels for each setting."""
    return tuple(
        tuple(
            panel(
                results,
                setting.name,
                quantity.title,
                quantity,
                lambda cells, value=value: _by_iteration(cells, value),
                limit,
            )
            for quantity, value, limit in columns
        )
        for setting in results.study.settings
    )


def _by_iteration(cells: Sequence[CellResult], value: ValueOf) -> tuple[Group, ...]:
    """All runs at each iteration after the pre-training."""
    places: dict[int, list[RunPoint]] = {}
    for cell in cells:
        for stage, record in collections(cell):
            if record.iteration > 0:
                point = RunPoint(
                    cell.cell.seed, stage.number("iteration"), value(stage, cell.config.method.name)
                )
                places.setdefault(record.iteration, []).append(point)
    return grouped({f"iteration {number}": places[number] for number in sorted(places)})


def paper_failures(stage: StageSource, method: str) -> Number:
    """Share of an iteration's rollouts that failed, as the paper counts them.

    Args:
        stage: The record of the collection.
        method: Name of the run's method.
    """
    failed = stage.number("diverged")
    if method not in MONITORED:
        lost = difference(stage.number("falls"), stage.number("falls_expert_driving"))
        failed = total((failed, lost))
    return share(failed, stage.number("episodes"))


def falls(stage: StageSource, method: str = "") -> Number:
    """Share of an iteration's rollouts that fell, counted in the same way for all methods."""
    del method
    return share(stage.number("falls"), stage.number("episodes"))


def _field(name: str) -> ValueOf:
    """Reads a field of the collection that is a share of time."""
    return lambda stage, _method: stage.share(name)
