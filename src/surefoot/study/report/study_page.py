"""The report of a study: its page, its pictures, and the same content as records.

`study_report` makes the records, `write_study_report` the files: ``report.html``, which needs no
network and no other file, and a folder with each figure as PNG and PDF. The report of an unfinished
study shows what exists so far, and lists what is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from surefoot.config.study import Options
from surefoot.files import write_atomic
from surefoot.study.cells import cells_of
from surefoot.study.folder import JudgedPrediction, read_predictions
from surefoot.study.layout import FIGURES_FOLDER, PAGE_FILE
from surefoot.study.report.collecting import collecting_figures
from surefoot.study.report.markup import (
    NOTHING,
    Markup,
    code,
    element,
    escaped,
    facts,
    folded,
    joined,
    number,
    paragraph,
    section,
    table,
)
from surefoot.study.report.panels import Quantity, ReportFigure
from surefoot.study.report.performance import performance_figures
from surefoot.study.report.pictures import draw_all
from surefoot.study.report.style import document
from surefoot.study.report.tables import (
    cost_tables,
    figure_tables,
    hash_table,
    job_seconds,
    job_table,
    processors,
    versions_table,
)
from surefoot.study.report.verdicts import (
    Verdicts,
    prediction_table,
    verdict_table,
    verdicts_of,
)
from surefoot.study.results import StudyResults, about_shared_data

HOURS = Quantity("", "h", 3600.0, 2)
"""A time in hours."""
MOST_ROWS = 14
"""Longer tables are folded at first."""
ABOUT_INTERVALS = (
    "The run, which is a seed of the data, is the unit; several trainings on it count as one run, "
    "with their mean. Every run is a point, means are over runs, and intervals are 95 % t "
    "intervals over the means of runs, which are wide with few runs and may reach beyond the axes; "
    "axes of shares may begin above 0. An interval of a share of episodes is never narrower than "
    "the score interval of all episodes together. A dash stands for what has not been measured, or "
    "has no interval."
)
"""How to read figures and tables."""


@dataclass(frozen=True)
class StudyReport:
    """What the report of a study shows.

    Attributes:
        study: Name of the study.
        title: Its title.
        commit: The commit that its jobs ran; None outside of a checkout.
        version: Version of the package.
        missing: Names of the cells that lack a result.
        predictions: What was expected, written before the study ran, and the outcomes.
        verdicts: The claims and the planned comparisons with their verdicts.
        figures: The figures, with every number that they show and where it is stored.
    """

    study: str
    title: str
    commit: str | None
    version: str
    missing: tuple[str, ...]
    predictions: tuple[JudgedPrediction, ...]
    verdicts: Verdicts
    figures: tuple[ReportFigure, ...]


def study_report(results: StudyResults) -> StudyReport:
    """What the report of a study shows.

    Args:
        results: The results, complete or not.
    """
    setup = results.setup
    return StudyReport(
        study=setup.study.name,
        title=setup.study.title,
        commit=setup.commit,
        version=setup.version,
        missing=results.missing,
        predictions=read_predictions(results.folder, setup.study),
        verdicts=verdicts_of(results),
        figures=(*collecting_figures(results), *performance_figures(results)),
    )


def write_study_report(
    results: StudyResults, report: StudyReport, folder: Path, films: Markup = NOTHING
) -> Path:
    """Write the page of a study and its pictures.

    Args:
        results: The results.
        report: What the report shows of them.
        folder: Folder of the page; the pictures go into its folder of figures.
        films: Films for the page, as markup that contains them entirely.

    Returns:
        The page.

    Raises:
        WriteError: The folder cannot be written to.
    """
    pictures = draw_all(report.figures, folder / FIGURES_FOLDER)
    path = folder / PAGE_FILE
    write_atomic(path, document(report.title, _body(results, report, pictures, films)))
    return path


def _body(
    results: StudyResults, report: StudyReport, pictures: Sequence[Markup], films: Markup
) -> Markup:
    """Everything that the page shows."""
    parts = [
        ("verdicts", "Claims and predictions", _verdicts(report)),
        ("figures", "Figures", _figures(report, pictures)),
        ("films", "Films", [films] if films else []),
        ("cost", "Cost", _costs(results)),
        ("provenance", "What ran where", _provenance(results)),
        ("setup", "What was compared", _setup(results)),
    ]
    shown = [part for part in parts if part[2]]
    links = [
        element("li", element("a", escaped(title), {"href": f"#{identity}"}))
        for identity, title, _ in shown
    ]
    contents = element("nav", element("ul", joined(links)), {"aria-label": "Sections"})
    sections = [section(identity, title, content) for identity, title, content in shown]
    return joined([_head(results, report), contents, *sections])


def _head(results: StudyResults, report: StudyReport) -> Markup:
    """Title, what the study is, and what is missing."""
    jobs = [job for cell in results.cells for job in cell.jobs]
    all_cells = len(cells_of(results.study))
    seeds = ", ".join(str(seed) for seed in results.study.seeds)
    pairs = [
        ("study", code(report.study)),
        ("cells", escaped(f"{all_cells - len(report.missing)} of {all_cells} complete")),
        ("seeds", escaped(seeds)),
        ("commit", code(report.commit or "not in a checkout")),
        ("surefoot", escaped(report.version)),
        ("processors", escaped("; ".join(processors(jobs)) or "–")),
        ("work", number(job_seconds(results), HOURS)),
    ]
    parts = [element("h1", escaped(report.title)), facts(pairs)]
    if report.missing:
        names = [element("li", code(name)) for name in report.missing]
        notice = paragraph(
            "The study is not complete: what follows is of the runs that are there. Runs that lack "
            "a result:"
        )
        parts.append(
            element("div", joined([notice, element("ul", joined(names))]), {"class": "notice"})
        )
    parts.append(paragraph(ABOUT_INTERVALS, "soft"))
    if shared := about_shared_data(results):
        parts.append(paragraph(shared, "soft"))
    return element("header", joined(parts))


def _verdicts(report: StudyReport) -> list[Markup]:
    """Claims, predictions and planned comparisons."""
    parts = []
    if report.verdicts.claims:
        parts.append(verdict_table("The paper's claims", report.verdicts.claims, "section"))
    if report.predictions:
        parts.append(prediction_table(report.predictions))
    if report.verdicts.comparisons:
        caption = "Comparisons planned before the study ran, beside what came out"
        parts.append(verdict_table(caption, report.verdicts.comparisons, "setting"))
    return parts


def _figures(report: StudyReport, pictures: Sequence[Markup]) -> list[Markup]:
    """Every figure with its caption and its tables."""
    parts = []
    for figure, picture in zip(report.figures, pictures, strict=True):
        rows = sum(len(curve.groups) for panel in figure.panels for curve in panel.curves)
        content = [
            element("h3", escaped(figure.title)),
            element(
                "figure",
                joined(
                    [
                        element("div", picture, {"class": "scroll"}),
                        element("figcaption", escaped(figure.caption)),
                    ]
                ),
            ),
            folded("The same numbers as a table", figure_tables(figure), rows <= MOST_ROWS),
        ]
        parts.append(element("article", joined(content), {"id": figure.name}))
    return parts


def _costs(results: StudyResults) -> list[Markup]:
    """What the techniques cost."""
    if not any(cell.metrics for cell in results.cells):
        return []
    return [
        paragraph(
            "What a run cost: the time that the expert drove (where it is only asked, the MPC "
            "solves show it), all simulated time, MPC solves of 50 ms each, falls, in all and for "
            "each minute of the rollouts, near falls, which tilt as far as a fall elsewhere and "
            "recover, and the wall time of all stages; beside it the largest torque of the best "
            "policy in its first measurement. Pre-training, tails and queries are counted, but for "
            "the falls in LocoDAGGER's queries; a "
            "series of dataset sizes (behavior cloning) collects once and trains every size."
        ),
        cost_tables(results),
    ]


def _provenance(results: StudyResults) -> list[Markup]:
    """Jobs, versions and hashes."""
    jobs = [job for cell in results.cells for job in cell.jobs]
    if not jobs:
        return []
    return [
        versions_table(jobs),
        folded("All jobs", job_table(results)),
        folded("Hashes of data and policies", hash_table(results)),
    ]


def _setup(results: StudyResults) -> list[Markup]:
    """Techniques, settings and measurements with their options."""
    study = results.study
    techniques = [
        (
            escaped(each.title),
            code(each.name),
            code(each.method),
            escaped(each.preset),
            _options(each.options),
        )
        for each in study.techniques
    ]
    settings = [
        (escaped(each.title), code(each.name), _options(each.options)) for each in study.settings
    ]
    measurements = [
        (
            escaped(each.title),
            code(each.name),
            escaped(each.measure),
            escaped(each.policies),
            escaped(each.split),
            _options(each.options),
        )
        for each in study.measurements
    ]
    return [
        table("Techniques", ("technique", "name", "method", "preset", "other options"), techniques),
        table("Settings", ("setting", "name", "options"), settings),
        table(
            "Measurements",
            ("measurement", "name", "kind", "policies", "initial states", "options"),
            measurements,
        ),
    ]


def _options(options: Options) -> Markup:
    """Options as pieces of code."""
    if not options:
        return escaped("–")
    return joined([code(f"{name} = {value}") for name, value in options.items()], ", ")
