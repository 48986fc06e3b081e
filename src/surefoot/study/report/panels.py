"""What a figure shows, as records: the same for its picture, its table and the JSON.

A figure has rows of panels. A panel has a curve for each technique, a curve has a group of runs for
each place on the axis, and a group has every run as a point, and the mean over runs. `collecting`
and `performance` make figures from results; `drawing` and `tables` show them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from surefoot.study.report.numbers import Estimate, Number, over_runs, over_trainings

Kind = Literal["iterations", "policies", "frames", "directions", "techniques"]
"""What a figure is drawn against: iterations, policies, frames of the dataset, directions of a push
[deg], or techniques, each of which has its own line."""


@dataclass(frozen=True)
class RunPoint:
    """The value of one run at one place.

    Attributes:
        seed: Seed of the run.
        x: Its place on the horizontal axis.
        y: What was measured.
    """

    seed: int
    x: Number
    y: Number


@dataclass(frozen=True)
class Group:
    """The values of all runs of a technique at one place.

    Attributes:
        label: Name of the place.
        x: Mean of the runs' places on the horizontal axis.
        runs: Every run.
        estimate: The mean over runs; None if no run has a number.
    """

    label: str
    x: Number
    runs: tuple[RunPoint, ...]
    estimate: Estimate | None


@dataclass(frozen=True)
class Curve:
    """The values of a technique at all places.

    Attributes:
        technique: Name of the technique.
        title: Its name in figures and tables.
        style: Number of the technique's color and marker; -1 for the expert.
        groups: The places, in their order.
    """

    technique: str
    title: str
    style: int
    groups: tuple[Group, ...]


@dataclass(frozen=True)
class Quantity:
    """What a panel shows, and how its numbers are written.

    Attributes:
        title: What it is.
        unit: The unit in which it is written.
        scale: One such unit, in the unit in which it is stored.
        digits: Number of digits after the point.
        is_share: Whether it lies between 0 and 1.
    """

    title: str
    unit: str
    scale: float = 1.0
    digits: int = 1
    is_share: bool = False


def percent(title: str) -> Quantity:
    """A share, written in percent."""
    return Quantity(title, "%", 0.01, 1, is_share=True)


@dataclass(frozen=True)
class Panel:
    """A pair of axes.

    Attributes:
        title: Title of the panel; empty where the figure's is enough.
        quantity: What is shown.
        curves: The techniques that have something to show, in the study's order.
        reference: The expert; None where it has not been measured, or is not comparable.
        limit: A value that the paper's text names, drawn as a line; None without one.
    """

    title: str
    quantity: Quantity
    curves: tuple[Curve, ...]
    reference: Curve | None = None
    limit: float | None = None


@dataclass(frozen=True)
class ReportFigure:
    """A figure.

    Attributes:
        name: Name of its files.
        title: Its title.
        caption: What it shows, in whole sentences.
        kind: What it is drawn against.
        rows: Rows of panels; long ones are drawn as several.
        over_runs: Whether its values are means over runs; otherwise they come from a single run.
    """

    name: str
    title: str
    caption: str
    kind: Kind
    rows: tuple[tuple[Panel, ...], ...]
    over_runs: bool = True

    @property
    def panels(self) -> tuple[Panel, ...]:
        """All panels, row by row."""
        return tuple(panel for row in self.rows for panel in row)

    @property
    def curves(self) -> tuple[Curve, ...]:
        """The first curve of each technique, for a legend; the expert first."""
        found: dict[str, Curve] = {}
        for panel in self.panels:
            for curve in (panel.reference, *panel.curves):
                if curve is not None:
                    found.setdefault(curve.technique, curve)
        return tuple(sorted(found.values(), key=lambda curve: curve.style))


def group_of(label: str, trainings: Sequence[RunPoint]) -> Group:
    """All runs at one place, with their mean.

    Trainings on the data of one seed are not independent: they count as one run, with their mean.

    Args:
        label: Name of the place.
        trainings: The value of each training there, at least one.
    """
    by_seed: dict[int, list[RunPoint]] = {}
    for training in trainings:
        by_seed.setdefault(training.seed, []).append(training)
    runs = []
    for seed, points in by_seed.items():
        x = over_trainings([point.x for point in points])
        runs.append(RunPoint(seed, x, over_trainings([point.y for point in points])))
    sources = ";".join(run.x.source for run in runs)
    x = Number(sum(run.x.value for run in runs) / len(runs), f"mean({sources})")
    return Group(label, x, tuple(runs), over_runs([run.y for run in runs]))


def grid(panels: Sequence[Panel], columns: int) -> tuple[tuple[Panel, ...], ...]:
    """Panels in rows with a given number of columns; the last row may be shorter."""
    return tuple(tuple(panels[first : first + columns]) for first in range(0, len(panels), columns))
