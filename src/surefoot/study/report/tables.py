"""The tables of a study's report: beside each figure, costs, what ran where, versions and hashes."""

from __future__ import annotations

from collections.abc import Sequence

from surefoot.runs.metrics import Collected, StageRecord, Trained, Validated
from surefoot.study.report.markup import (
    COUNT,
    MISSING,
    Markup,
    code,
    escaped,
    interval,
    joined,
    number,
    table,
)
from surefoot.study.report.numbers import Number, over_runs, stored, total
from surefoot.study.report.panels import Curve, Panel, Quantity, ReportFigure
from surefoot.study.report.source import stages
from surefoot.study.results import CellResult, JobRecord, StudyResults

SECONDS = Quantity("", "", 1.0, 1)
"""A time in seconds."""
MINUTES = Quantity("", "", 60.0, 1)
"""A time in minutes."""
COSTS = ("expert_seconds", "robot_seconds", "plans", "falls", "diverged", "frames_kept")
"""Fields of a collection that add up to the cost of a run."""
COST_TITLES = (
    "expert drove [s]",
    "simulated [s]",
    "MPC solves",
    "falls",
    "MPC diverged",
    "frames kept",
    "work [min]",
)
"""What the columns of the costs are called."""


def figure_tables(figure: ReportFigure) -> Markup:
    """The numbers of a figure: a table for each panel."""
    return joined([_panel_table(figure, panel) for panel in figure.panels])


def _panel_table(figure: ReportFigure, panel: Panel) -> Markup:
    """The numbers of a panel: a row for each technique at each place, with every run."""
    quantity = panel.quantity
    curves = [*panel.curves, *([] if panel.reference is None else [panel.reference])]
    rows = [row for curve in curves for row in _curve_rows(figure, quantity, curve)]
    place = {
        "iterations": ("iteration",),
        "frames": ("policy", "frames, mean"),
        "directions": ("direction [deg]",),
        "techniques": (),
    }[figure.kind]
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    head = ("technique", *place, f"mean{unit}", "95 % interval", "runs")
    return table(panel.title or figure.title, head, rows)


def _curve_rows(
    figure: ReportFigure, quantity: Quantity, curve: Curve
) -> list[tuple[Markup, ...]]:
    """The rows of a technique."""
    rows = []
    for group in curve.groups:
        runs = joined([number(point.y, quantity, unit=False) for point in group.runs], ", ")
        place: tuple[Markup, ...] = ()
        if figure.kind == "frames":
            place = (escaped(group.label.removeprefix("policy ")), number(group.x))
        elif figure.kind != "techniques":
            place = (number(group.x),)
        mean = MISSING
        spread = MISSING
        if group.estimate is not None:
            mean = number(group.estimate.mean, quantity, unit=False)
            spread = interval(group.estimate, quantity)
        rows.append((escaped(curve.title), *place, mean, spread, runs))
    return rows


def cost_of(cell: CellResult) -> tuple[Number, ...]:
    """What a run cost: the columns of `COST_TITLES`. Pre-training, tails and queries count."""
    records = stages(cell.metrics, cell.cell.name)
    collected = [each for each in records if isinstance(each.record, Collected)]
    timed = [each for each in records if _is_timed(each.record)]
    costs = [total([each.number(field) for each in collected]) for field in COSTS]
    return (*costs, total([each.number("seconds") for each in timed]))


def _is_timed(record: StageRecord) -> bool:
    """Whether a stage has a wall time."""
    return isinstance(record, Collected | Trained | Validated) or record.stage.startswith("gate_")


def cost_tables(results: StudyResults) -> Markup:
    """What the techniques cost: the mean over runs, and every run."""
    means = []
    runs = []
    for setting in results.study.settings:
        for technique in results.study.techniques:
            cells = [cell for cell in results.of(technique.name, setting.name) if cell.metrics]
            if not cells:
                continue
            costs = [cost_of(cell) for cell in cells]
            estimates = [over_runs(column) for column in zip(*costs, strict=True)]
            cells_of_row = [
                MISSING if estimate is None else _cost_cell(place, estimate.mean)
                for place, estimate in enumerate(estimates)
            ]
            name = [escaped(technique.title), escaped(setting.title)]
            means.append((*name, *cells_of_row))
            for cell, cost in zip(cells, costs, strict=True):
                line = [_cost_cell(place, each) for place, each in enumerate(cost)]
                runs.append((code(cell.cell.name), *line))
    return joined(
        [
            table("Mean cost of a run", ("technique", "setting", *COST_TITLES), means),
            table("Cost of every run", ("run", *COST_TITLES), runs),
        ]
    )


def _cost_cell(place: int, each: Number) -> Markup:
    """A number of the costs, as its column is written."""
    last = len(COST_TITLES) - 1
    quantity = MINUTES if place == last else SECONDS if place < 2 else COUNT
    return number(each, quantity)


def job_table(results: StudyResults) -> Markup:
    """What ran where, and for how long."""
    rows = []
    for cell in results.cells:
        for job in cell.jobs:
            file = f"{cell.cell.name}/jobs/{job.job}.json"
            rows.append(
                (
                    code(job.job),
                    escaped(job.started),
                    number(stored(job.seconds, file, "seconds"), MINUTES),
                    escaped("; ".join(job.processors)),
                    escaped(job.precision or "–"),
                    escaped("done" if job.finished else "goes on"),
                )
            )
    head = ("job", "started (UTC)", "minutes", "processor", "precision of training", "state")
    return table("Jobs", head, rows)


def job_seconds(results: StudyResults) -> Number:
    """How long all jobs ran together [s]."""
    return total(
        [
            stored(job.seconds, f"{cell.cell.name}/jobs/{job.job}.json", "seconds")
            for cell in results.cells
            for job in cell.jobs
        ]
    )


def processors(jobs: Sequence[JobRecord]) -> tuple[str, ...]:
    """The models of processors that jobs ran on."""
    return tuple(dict.fromkeys(name for job in jobs for name in job.processors))


def versions_table(jobs: Sequence[JobRecord]) -> Markup:
    """Versions of Python and packages; several where jobs differ."""
    found: dict[str, dict[str, None]] = {}
    for job in jobs:
        for name, version in job.versions.items():
            if name != "processor":
                found.setdefault(name, {})[version] = None
    rows = [(escaped(name), escaped(", ".join(versions))) for name, versions in found.items()]
    return table("Versions", ("package", "version"), rows)


def hash_table(results: StudyResults) -> Markup:
    """Hashes of the data and of the best policy of every run, and of the initial states."""
    rows = []
    for cell in results.cells:
        collected = [record for record in cell.metrics if isinstance(record, Collected)]
        data = collected[-1].dataset_hash if collected else ""
        policy = next(
            (
                test.sha256
                for name in cell.tests
                for test in [cell.best_test(name)]
                if test is not None and test.sha256 is not None
            ),
            "",
        )
        rows.append((code(cell.cell.name), _hash(data), _hash(policy), _hash(_starts(cell))))
    head = ("run", "dataset", "best policy", "initial states")
    return table("SHA-256", head, rows)


def _hash(text: str) -> Markup:
    """A hash; a dash where there is none."""
    return code(text) if text else MISSING


def _starts(cell: CellResult) -> str:
    """Hash of the initial states of a cell's measurements."""
    for tests in cell.tests.values():
        for test in tests.policies:
            if test.robustness is not None:
                return test.robustness.starts_hash
            if test.pushes is not None:
                return test.pushes.starts_hash
    return ""
