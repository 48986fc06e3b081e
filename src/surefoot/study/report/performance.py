"""The figures of what policies can do: success and tracking against data, pushes, other simulators.

These are the paper's third to fifth figures, and others that show the best policy of every run: its
success in all measurements, for example in the other simulator, and its deviation from the expert.
The best policy of a run is the one that was chosen on the `select` initial states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from surefoot.config.study import Measure, Measurement, StudyConfig
from surefoot.study.report.numbers import Number, share
from surefoot.study.report.panels import (
    Group,
    Panel,
    Quantity,
    ReportFigure,
    RunPoint,
    grid,
    percent,
)
from surefoot.study.report.source import GroupsOf, TestSource, best_test, grouped, panel, tests
from surefoot.study.results import CellResult, StudyResults

SUCCESS = percent("success")
"""Share of the initial states from which a policy succeeds."""
ERRORS = (
    Quantity("vx", "m²/s² · 10⁻³", 1e-3, 2),
    Quantity("vy", "m²/s² · 10⁻³", 1e-3, 2),
    Quantity("yaw rate", "rad²/s² · 10⁻³", 1e-3, 2),
)
"""Mean squared errors of the velocity."""
WAYS = (
    ("mse", "successes, whole episode"),
    ("settled_mse", "all episodes, from 1 s on"),
)
"""The paper's way to measure errors, and the one over all episodes, each after its field."""
IMPULSES = (
    ("max_impulse", Quantity("largest impulse survived", "N s", 1.0, 2)),
    ("fitted_impulse", Quantity("impulse of the fitted curve", "N s", 1.0, 2)),
)
"""The paper's largest impulse, and the one that is read off the curve fitted to all levels."""
MEAN_IMPULSES = (
    ("mean_max_impulse", Quantity("largest impulse, mean of directions", "N s", 1.0, 2)),
    ("mean_fitted_impulse", Quantity("fitted impulse, mean of directions", "N s", 1.0, 2)),
)
"""Means of both over all directions."""
BEST_FIGURE = "7-best"
"""Name of the figure of the best policies of all runs."""
BEST_ERRORS = "9-tracking-best"
"""Name of the figure of their tracking errors."""
IMITATION = Quantity("deviation from the expert", "mrad", 1.0, 1)
"""Mean absolute deviation from the expert's targets."""

ValueOf = Callable[[TestSource], Number]
"""Returns the number to show for a policy's test."""


def performance_figures(results: StudyResults) -> tuple[ReportFigure, ...]:
    """The figures of all measurements that have results, in the paper's order."""
    figures = []
    for measurement in _measurements(results, "robustness"):
        if measurement.policies == "all":
            figures.append(_success_figure(results, measurement))
            figures.append(_error_figure(results, measurement))
    figures += [_push_figure(results, each) for each in _measurements(results, "impulse")]
    figures += [_mean_push_figure(results, each) for each in _measurements(results, "impulse")]
    figures.append(_best_figure(results))
    figures += [_best_error_figure(results, each) for each in tracked_best(results.study)]
    figures += [_imitation_figure(results, each) for each in _measurements(results, "imitation")]
    return tuple(_about_expert(figure) for figure in figures if figure.curves)


def _about_expert(figure: ReportFigure) -> ReportFigure:
    """The figure; its caption says which line is the expert, if there is one."""
    if all(panel.reference is None for panel in figure.panels):
        return figure
    return replace(figure, caption=f"{figure.caption} The dotted line is the expert.")


def tracked_best(study: StudyConfig) -> list[Measurement]:
    """The measurement whose tracking errors are shown for the best policies: the first one.

    There is none if the errors are shown for every policy.
    """
    measurements = [each for each in study.measurements if each.measure == "robustness"]
    return [each for each in measurements[:1] if each.policies == "best"]


def _measurements(results: StudyResults, measure: Measure) -> list[Measurement]:
    """The study's measurements of a kind."""
    return [each for each in results.study.measurements if each.measure == measure]


def _success(test: TestSource) -> Number:
    """Share of the initial states from which a policy succeeds."""
    return share(test.robustness("successes"), test.robustness("episodes"))


def _success_figure(results: StudyResults, measurement: Measurement) -> ReportFigure:
    """The paper's third figure: success against the size of the dataset."""
    panels = [
        _by_size(results, setting.name, measurement, SUCCESS, _success)
        for setting in results.study.settings
    ]
    return ReportFigure(
        f"3-success-{measurement.name}",
        "Success against the size of the dataset",
        f"Share of successful episodes ({measurement.title}) of the policy of each iteration, and "
        "of behavior cloning on parts of its data, against the number of frames that the policy "
        "was trained on.",
        "frames",
        (tuple(panels),),
    )


def _error_figure(results: StudyResults, measurement: Measurement) -> ReportFigure:
    """The paper's fourth figure: tracking errors against the size of the dataset."""
    rows = []
    for setting in results.study.settings:
        for field, way in WAYS:
            row = []
            for component, quantity in enumerate(ERRORS):
                row.append(
                    _by_size(
                        results,
                        setting.name,
                        measurement,
                        quantity,
                        lambda test, f=field, c=component: test.robustness(f, c),
                        f"{quantity.title}, {way}",
                    )
                )
            rows.append(tuple(row))
    return ReportFigure(
        f"4-tracking-{measurement.name}",
        "Velocity tracking against the size of the dataset",
        f"Mean squared error of vx, vy and yaw rate ({measurement.title}), in thousandths. Above "
        "as in the paper: successful episodes only, the whole of each. Below: all episodes that "
        "last so long, from 1 s on. A policy without such episodes has no error.",
        "frames",
        tuple(rows),
    )


def _by_size(
    results: StudyResults,
    setting: str,
    measurement: Measurement,
    quantity: Quantity,
    value: ValueOf,
    title: str = "",
) -> Panel:
    """A panel of all policies against the size of their data."""

    def policies(cells: Sequence[CellResult]) -> tuple[Group, ...]:
        places: dict[int, list[RunPoint]] = {}
        for cell in cells:
            for test in tests(cell, measurement.name):
                point = RunPoint(cell.cell.seed, test.frames, value(test))
                places.setdefault(test.test.iteration, []).append(point)
        return grouped({f"policy {number}": places[number] for number in sorted(places)})

    return panel(results, setting, title, quantity, policies)


def _push_figure(results: StudyResults, measurement: Measurement) -> ReportFigure:
    """The paper's fifth figure: the largest impulse by direction."""
    panels = [
        panel(results, setting.name, quantity.title, quantity, _by_direction(measurement, field))
        for setting in results.study.settings
        for field, quantity in IMPULSES
    ]
    return ReportFigure(
        f"5-pushes-{measurement.name}",
        "Largest impulse by direction",
        f"Impulse on the base that the best policy of each run withstands ({measurement.title}), "
        "by the direction of the push, seen from above: forward is up, left is left. The lines are "
        "means over runs, the points are runs. 0 means that too few robots survive even without a "
        "push.",
        "directions",
        grid(panels, len(IMPULSES)),
    )


def _by_direction(measurement: Measurement, field: str) -> GroupsOf:
    """Makes a group of runs for each direction of the push."""

    def directions(cells: Sequence[CellResult]) -> tuple[Group, ...]:
        places: dict[str, list[RunPoint]] = {}
        for cell in cells:
            test = best_test(cell, measurement.name)
            if test is None or test.test.pushes is None:
                continue
            for position, degrees in enumerate(test.test.pushes.direction_deg):
                point = RunPoint(
                    cell.cell.seed,
                    test.pushes("direction_deg", position),
                    test.pushes(field, position),
                )
                places.setdefault(f"{degrees:g}°", []).append(point)
        return grouped(places)

    return directions


def _mean_push_figure(results: StudyResults, measurement: Measurement) -> ReportFigure:
    """The impulses of the best policies, averaged over all directions."""
    rows = tuple(
        tuple(
            _by_technique(
                results, setting.name, measurement, quantity, lambda test, f=field: test.pushes(f)
            )
            for field, quantity in MEAN_IMPULSES
        )
        for setting in results.study.settings
    )
    return ReportFigure(
        f"6-mean-push-{measurement.name}",
        "Impulse withstood, mean of all directions",
        f"The best policy of each run ({measurement.title}): every run as a point, the mean over "
        "runs with its interval.",
        "techniques",
        rows,
    )


def _best_figure(results: StudyResults) -> ReportFigure:
    """Success of the best policies in all measurements of robustness."""
    measurements = _measurements(results, "robustness")
    rows = tuple(
        tuple(
            _by_technique(results, setting.name, measurement, SUCCESS, _success, measurement.title)
            for measurement in measurements
        )
        for setting in results.study.settings
    )
    return ReportFigure(
        BEST_FIGURE,
        "Success of the best policy of each run",
        "Every run as a point, the mean over runs with its interval below them; one panel for each "
        "measurement, among them those in another simulator, where there are any.",
        "techniques",
        rows,
    )


def _best_error_figure(results: StudyResults, measurement: Measurement) -> ReportFigure:
    """Tracking errors of the best policies."""
    field, way = WAYS[1]
    rows = tuple(
        tuple(
            _by_technique(
                results,
                setting.name,
                measurement,
                quantity,
                lambda test, component=component: test.robustness(field, component),
                quantity.title,
            )
            for component, quantity in enumerate(ERRORS)
        )
        for setting in results.study.settings
    )
    return ReportFigure(
        BEST_ERRORS,
        "Velocity tracking of the best policy of each run",
        f"Mean squared error of vx, vy and yaw rate ({measurement.title}), in thousandths: {way}. "
        "Every run as a point, the mean over runs with its interval.",
        "techniques",
        rows,
    )


def _imitation_figure(results: StudyResults, measurement: Measurement) -> ReportFigure:
    """The deviation of the best policies from the expert's targets."""
    panels = [
        _by_technique(
            results, setting.name, measurement, IMITATION, lambda test: test.imitation("mean_mrad")
        )
        for setting in results.study.settings
    ]
    return ReportFigure(
        f"8-imitation-{measurement.name}",
        "Deviation from the expert",
        f"Mean absolute deviation of the joint targets of the best policy of each run from the "
        f"expert's ({measurement.title}): every run as a point, the mean over runs with its "
        "interval.",
        "techniques",
        (tuple(panels),),
    )


def _by_technique(
    results: StudyResults,
    setting: str,
    measurement: Measurement,
    quantity: Quantity,
    value: ValueOf,
    title: str = "",
) -> Panel:
    """A panel of the best policies, in which each technique has its own line."""

    def best(cells: Sequence[CellResult]) -> tuple[Group, ...]:
        points = []
        for cell in cells:
            test = best_test(cell, measurement.name)
            if test is not None:
                points.append(RunPoint(cell.cell.seed, test.frames, value(test)))
        return grouped({"best policy": points})

    return panel(results, setting, title or quantity.title, quantity, best)
