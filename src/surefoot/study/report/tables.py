"""The tables of a study's report: numbers of figures, costs, jobs, versions and hashes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from surefoot.runs.layout import METRICS_FILE
from surefoot.runs.metrics import Best, Collected
from surefoot.study.folder import JobRecord
from surefoot.study.layout import JOBS_FOLDER
from surefoot.study.report.markup import (
    COUNT,
    MISSING,
    Markup,
    code,
    element,
    escaped,
    interval,
    joined,
    number,
    table,
)
from surefoot.study.report.numbers import (
    Estimate,
    Number,
    over_runs,
    over_trainings,
    rate,
    stored,
    total,
)
from surefoot.study.report.panels import Curve, Panel, Quantity, ReportFigure
from surefoot.study.report.source import best_test, stages
from surefoot.study.results import CellResult, StudyResults
from surefoot.study.run_values import is_trained

SECONDS = Quantity("", "", 1.0, 1)
"""A time in seconds."""
MINUTES = Quantity("", "", 60.0, 1)
"""A time in minutes."""
EACH_MINUTE = Quantity("", "", 1 / 60, 2)
"""A rate, stored per second and written per minute."""
TORQUE = Quantity("", "", 1.0, 1)
"""A torque in N m."""
SUMS = (
    "expert_seconds",
    "robot_seconds",
    "plans",
    "falls",
    "near_falls",
    "diverged",
    "frames_kept",
)
"""Fields of a collection that add up to the cost of a run."""
COSTS = {
    "expert_seconds": ("expert drove [s]", SECONDS),
    "robot_seconds": ("simulated [s]", SECONDS),
    "plans": ("MPC solves", COUNT),
    "falls": ("falls", COUNT),
    "fall_rate": ("falls a minute", EACH_MINUTE),
    "near_falls": ("near falls", COUNT),
    "diverged": ("MPC diverged", COUNT),
    "frames_kept": ("frames kept", COUNT),
    "max_torque": ("peak torque [N m]", TORQUE),
    "seconds": ("work [min]", MINUTES),
}
"""The columns of the costs: what each is called, and how it is written."""


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
        "policies": ("policy",),
        "frames": ("policy", "frames, mean"),
        "directions": ("direction [deg]",),
        "techniques": (),
    }[figure.kind]
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    numbers = (f"mean{unit}", "95 % interval", "runs")
    if not figure.over_runs:
        numbers = (f"value{unit}", "95 % interval")
    head = ("technique", *place, *numbers)
    return table(panel.title or figure.title, head, rows)


def _curve_rows(figure: ReportFigure, quantity: Quantity, curve: Curve) -> list[tuple[Markup, ...]]:
    """The rows of a technique."""
    rows = []
    for group in curve.groups:
        points = [number(point.y, quantity, unit=False) for point in group.runs]
        runs = element("span", joined(points, ", "), {"class": "runs"})
        place: tuple[Markup, ...] = ()
        if figure.kind == "frames":
            place = (escaped(group.label.removeprefix("policy ")), number(group.x))
        elif figure.kind != "techniques":
            place = (number(group.x),)
        mean = MISSING
        spread = MISSING
        if group.estimate is not None:
            estimate = in_row(group.estimate) if figure.over_runs else group.estimate
            mean = number(estimate.mean, quantity, unit=False)
            spread = interval(estimate, quantity)
        every = (runs,) if figure.over_runs else ()
        rows.append((escaped(curve.title), *place, mean, spread, *every))
    return rows


def in_row(estimate: Estimate) -> Estimate:
    """An estimate whose sources are shortened to refer to the runs in the same row."""
    low = None if estimate.low is None else replace(estimate.low, source="low(row)")
    high = None if estimate.high is None else replace(estimate.high, source="high(row)")
    return replace(estimate, mean=replace(estimate.mean, source="mean(row)"), low=low, high=high)


def cost_of(cell: CellResult) -> dict[str, Number]:
    """What a run cost, by the keys of `COSTS`. Pre-training, tails and queries count.

    The peak torque is that of its best policy in the first measurement that has one.
    """
    file = f"{cell.cell.name}/{METRICS_FILE}"
    records = stages(cell.metrics, cell.cell.name)
    collected = [each for each in records if isinstance(each.record, Collected)]
    timed = [each for each in records if not isinstance(each.record, Best)]
    costs = {
        field: total([each.number(field) for each in collected], f"{file}#/collect/{field}")
        for field in SUMS
    }
    known = total(
        [each.number("rollout_seconds_with_tail") for each in collected],
        f"{file}#/collect/rollout_seconds_with_tail",
    )
    costs["fall_rate"] = rate(costs["falls"], known)  # both are without queries
    costs["max_torque"] = _peak_torque(cell)
    costs["seconds"] = total([each.number("seconds") for each in timed], f"{file}#/*/seconds")
    return costs


def mean_costs(cells: Sequence[CellResult]) -> dict[str, Estimate | None]:
    """The mean cost of runs, by the keys of `COSTS`.

    Trainings on the data of one seed count as one run, with their mean.
    """
    by_seed: dict[int, list[dict[str, Number]]] = {}
    for cell in cells:
        by_seed.setdefault(cell.cell.seed, []).append(cost_of(cell))
    return {
        key: over_runs(
            [over_trainings([cost[key] for cost in costs]) for costs in by_seed.values()]
        )
        for key in COSTS
    }


def _peak_torque(cell: CellResult) -> Number:
    """The largest torque of a cell's best policy in the first measurement that has it."""
    for measurement in cell.tests:
        test = best_test(cell, measurement)
        if test is not None and test.test.robustness is not None:
            return test.robustness("max_torque")
    return Number(math.nan, "")


def cost_tables(results: StudyResults) -> Markup:
    """What the techniques cost: the mean over finished runs, and every run."""
    means = []
    runs = []
    for setting in results.study.settings:
        for technique in results.study.techniques:
            cells = [cell for cell in results.of(technique.name, setting.name) if cell.metrics]
            if not cells:
                continue
            costs = [cost_of(cell) for cell in cells]
            mean = mean_costs([cell for cell in cells if is_trained(cell)])
            row = []
            for key, (_, quantity) in COSTS.items():
                estimate = mean[key]
                row.append(MISSING if estimate is None else number(estimate.mean, quantity))
            means.append((escaped(technique.title), escaped(setting.title), *row))
            for cell, cost in zip(cells, costs, strict=True):
                line = [number(cost[key], quantity) for key, (_, quantity) in COSTS.items()]
                runs.append((code(cell.cell.name), *line))
    titles = [title for title, _ in COSTS.values()]
    return joined(
        [
            table("Mean cost of a run", ("technique", "setting", *titles), means),
            table("Cost of every run", ("run", *titles), runs),
        ]
    )


def job_table(results: StudyResults) -> Markup:
    """What ran where, and for how long."""
    rows = []
    for cell in results.cells:
        for job in cell.jobs:
            file = f"{cell.cell.name}/{JOBS_FOLDER}/{job.job}.json"
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
    head = (
        "job",
        "started (UTC)",
        "minutes of work",
        "processor",
        "precision of training",
        "state",
    )
    return table("Jobs", head, rows)


def job_seconds(results: StudyResults) -> Number:
    """The total time of all jobs [s]."""
    seconds = [Number(job.seconds, "") for cell in results.cells for job in cell.jobs]
    return total(seconds, f"**/{JOBS_FOLDER}/*.json#/seconds")


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
        policy = _best_policy_hash(cell)
        rows.append((code(cell.cell.name), _hash(data), _hash(policy), _hash(_starts(cell))))
    head = ("run", "dataset", "best policy", "initial states")
    return table("SHA-256", head, rows)


def _hash(text: str) -> Markup:
    """A hash; a dash where there is none."""
    return code(text) if text else MISSING


def _best_policy_hash(cell: CellResult) -> str:
    """Hash of a cell's best policy; empty if nothing was measured of it."""
    for name in cell.tests:
        test = cell.best_test(name)
        if test is not None and test.sha256 is not None:
            return test.sha256
    return ""


def _starts(cell: CellResult) -> str:
    """Hash of the initial states of a cell's measurements."""
    for tests in cell.tests.values():
        for test in tests.policies:
            if test.robustness is not None:
                return test.robustness.starts_hash
            if test.pushes is not None:
                return test.pushes.starts_hash
    return ""
