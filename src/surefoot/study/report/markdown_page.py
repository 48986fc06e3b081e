"""The results of a study as Markdown, for a page of the documentation.

`page_of_tables` puts them into the generated part of a page and keeps the page's prose. A study
that judges the paper's claims has the table of claims; any other has a table for each setting, with
a row for each technique. Both have the predictions with their outcomes, and the comparisons that
were planned before the study ran.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from surefoot.config.study import EXPERT
from surefoot.runs.budget import SECONDS_PER_SOLVE
from surefoot.study.cells import cells_of
from surefoot.study.folder import JudgedPrediction
from surefoot.study.markdown_text import markdown, page_with
from surefoot.study.report.numbers import Estimate, Number
from surefoot.study.report.panels import Curve, Group, Panel, ReportFigure
from surefoot.study.report.performance import BEST_ERRORS, BEST_FIGURE
from surefoot.study.report.study_page import StudyReport
from surefoot.study.report.tables import mean_costs
from surefoot.study.report.verdicts import UNJUDGED, JudgedSentence
from surefoot.study.results import CellResult, StudyResults, about_shared_data
from surefoot.study.run_statistics import mean_of_runs
from surefoot.study.run_values import best_value, is_trained

UNMEASURED = "–"
"""Shown in a table where nothing was measured."""
TRACKING = "{}: mean squared errors of vx, vy, yaw rate, from 1 s on [10⁻³ m²/s², rad²/s²]"
"""Title of the column of tracking errors."""


def page_of_tables(results: StudyResults, report: StudyReport, path: Path) -> str:
    """The content of a page with a study's tables in its generated part; the prose stays.

    Args:
        results: Results of the study, complete or not.
        report: What its report shows.
        path: The page.

    Raises:
        ValueError: The page has no such part.
    """
    if results.study.claims == "paper":
        parts = [_about_claims(results), _verdict_table("claim", report.verdicts.claims, "section")]
    else:
        parts = [_about(results, report), *_settings(results, report)]
    if report.predictions:
        parts.append(_predictions(report.predictions))
    if report.verdicts.comparisons:
        planned = "planned before the study ran"
        parts.append("### Planned comparisons")
        parts.append(_verdict_table(planned, report.verdicts.comparisons, "setting"))
    return page_with("\n\n".join(parts), path, results.study.name)


def _about_claims(results: StudyResults) -> str:
    """How many runs the claims are judged by."""
    trained = sum(is_trained(cell) for cell in results.cells)
    seeds = ", ".join(str(seed) for seed in results.study.seeds)
    commit = results.setup.commit
    made_by = f" of commit {commit[:12]}" if commit else ""
    runs = "run" if trained == 1 else "runs"
    return f"{trained} finished {runs}{made_by}, seeds {seeds}; 95 % intervals over runs."


def _about(results: StudyResults, report: StudyReport) -> str:
    """How many runs there are, and how to read the cells of the tables."""
    trained = [
        cell.name
        for cell in cells_of(results.study)
        if results.study.technique(cell.technique).method != EXPERT
    ]
    cells = len(trained)
    complete = len(set(trained) - set(report.missing))
    made_by = f" of commit {report.commit[:12]}" if report.commit else ""
    impulses = ""
    if any(each.measure == "impulse" for each in results.study.measurements):
        impulses = " or in N s"
    errors = ""
    if any(figure.name == BEST_ERRORS for figure in report.figures):
        errors = "Errors are of all episodes that last 1 s, means over runs. "
    return (
        f"{complete} of {cells} trainings{made_by} are complete. A cell holds the mean "
        f"over runs in percent{impulses}, its 95 % interval over runs in brackets, and every run, "
        "which is a seed of the data: several trainings on it count as one run, with their mean. "
        f"{errors}"
        "Falls are those of all rollouts from which a run learned; the seconds are those of the "
        f"MPC, solves of 0.05 s each. {about_shared_data(results)}"
    ).rstrip()


def _settings(results: StudyResults, report: StudyReport) -> list[str]:
    """A table for each setting, under its title."""
    figures = {figure.name: figure for figure in report.figures}
    if BEST_FIGURE not in figures:
        return []
    best = figures[BEST_FIGURE]
    errors = figures[BEST_ERRORS].rows if BEST_ERRORS in figures else [()] * len(best.rows)
    parts = []
    for setting, panels, tracking in zip(results.study.settings, best.rows, errors, strict=True):
        parts.append(f"### {setting.title[:1].upper()}{setting.title[1:]}")
        parts.append(_setting_table(results, setting.name, panels, tracking, best))
    return parts


def _setting_table(
    results: StudyResults,
    setting: str,
    panels: tuple[Panel, ...],
    tracking: tuple[Panel, ...],
    figure: ReportFigure,
) -> str:
    """The table of a setting: the expert, then the techniques in the study's order."""
    titles = [each.title for each in results.study.measurements if each.measure == "robustness"]
    pushes = [each for each in results.study.measurements if each.measure == "impulse"]
    lines = []
    for curve in figure.curves:
        cells = list(results.of(curve.technique, setting))
        measured = [_success(panel, curve.technique) for panel in panels]
        measured += [_impulse(cells, each.name) for each in pushes]
        if all(cell == UNMEASURED for cell in measured):
            continue
        errors = [", ".join(_error(panel, curve.technique) for panel in tracking)]
        lines.append([curve.title, *measured, *(errors if tracking else []), *_costs(cells)])
    titles += [f"{each.title} [N s]" for each in pushes]
    errors = [TRACKING.format(titles[0])] if tracking else []
    return markdown(["technique", *titles, *errors, "falls, mean", "MPC [s], mean"], lines)


def _impulse(cells: Sequence[CellResult], measurement: str) -> str:
    """The impulse that a technique's best policies withstand: mean, interval and every run."""
    runs = best_value(cells, measurement, "impulse")
    if runs is None:
        return UNMEASURED
    means = mean_of_runs(runs)
    interval = (
        "" if means.interval is None else f" [{means.interval[0]:.2f}, {means.interval[1]:.2f}]"
    )
    return f"**{means.mean:.2f}**{interval}: {', '.join(f'{value:.2f}' for value in runs.values)}"


def _success(panel: Panel, technique: str) -> str:
    """A technique's result in a panel: mean, interval and every run."""
    group = _group(panel, technique)
    if group is None or group.estimate is None:
        return UNMEASURED
    scale = panel.quantity.scale
    runs = ", ".join(_short(run.y, scale) for run in group.runs if run.y.is_known)
    return f"**{_short(group.estimate.mean, scale)}**{_interval(group.estimate, scale)} {runs}"


def _error(panel: Panel, technique: str) -> str:
    """The mean tracking error of a technique in a panel."""
    group = _group(panel, technique)
    if group is None or group.estimate is None:
        return UNMEASURED
    return f"{group.estimate.mean.value / panel.quantity.scale:.{panel.quantity.digits}f}"


def _group(panel: Panel, technique: str) -> Group | None:
    """The runs of a technique in a panel whose techniques have one place each; None if none."""
    curves: list[Curve | None] = [panel.reference, *panel.curves]
    for curve in curves:
        if curve is not None and curve.technique == technique and curve.groups:
            return curve.groups[0]
    return None


def _interval(estimate: Estimate, scale: float) -> str:
    """The interval of a mean in brackets, if there is one, and a colon."""
    if estimate.low is None or estimate.high is None:
        return ":"
    return f" [{_short(estimate.low, scale)}, {_short(estimate.high, scale)}]:"


def _short(number: Number, scale: float) -> str:
    """A number to the nearest whole one of its unit."""
    return f"{number.value / scale:.0f}"


def _costs(cells: list[CellResult]) -> list[str]:
    """The mean falls while collecting, and the mean time of the MPC [s], of finished runs."""
    mean = mean_costs([cell for cell in cells if is_trained(cell)])
    falls = mean["falls"]
    plans = mean["plans"]
    if falls is None or plans is None:
        return [UNMEASURED, UNMEASURED]
    return [f"{falls.mean.value:.1f}", f"{plans.mean.value * SECONDS_PER_SOLVE:.1f}"]


def _predictions(predictions: tuple[JudgedPrediction, ...]) -> str:
    """The predictions with their outcomes."""
    head = ("prediction, written before the study ran", "verdict", "what came out")
    lines = [
        (each.prediction, f"**{each.verdict or UNJUDGED}**", each.came_out) for each in predictions
    ]
    return f"### What was predicted\n\n{markdown(head, lines)}"


def _verdict_table(first: str, verdicts: Sequence[JudgedSentence], where: str) -> str:
    """A table of verdicts.

    Args:
        first: Title of the first column, that of the sentences.
        verdicts: The verdicts.
        where: Title of the column of sections, which is there if any verdict has one.
    """
    are_placed = any(each.section for each in verdicts)
    lines = []
    for each in verdicts:
        place = [each.section] if are_placed else []
        lines.append((each.text, *place, f"**{each.verdict}**", each.number, each.reason))
    place = [where] if are_placed else []
    return markdown((first, *place, "verdict", "measured", "why"), lines)
