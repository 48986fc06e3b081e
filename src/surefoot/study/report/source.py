"""The results of a study as numbers with their places in its files.

`StageSource` and `TestSource` pair a record with its place in a file; `panel` shows a number of all
techniques. `collecting` and `performance` use them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from surefoot.config.study import EXPERT
from surefoot.runs.layout import METRICS_FILE
from surefoot.runs.metrics import Collected, StageRecord
from surefoot.study.folder import PolicyTest
from surefoot.study.layout import TESTS_FOLDER
from surefoot.study.report.numbers import Number, stored
from surefoot.study.report.panels import Curve, Group, Panel, Quantity, RunPoint, group_of
from surefoot.study.results import CellResult, StudyResults

GroupsOf = Callable[[Sequence[CellResult]], Sequence[Group]]
"""Returns what to show of a technique's runs: a group for each place."""


@dataclass(frozen=True)
class StageSource:
    """A record of a stage, and where it is stored.

    Attributes:
        file: File of the metrics, relative to the folder of the study.
        line: Position of its line, from 0.
        record: The record.
    """

    file: str
    line: int
    record: StageRecord

    def number(self, field: str, *keys: int) -> Number:
        """The number in a field; keys select one in a field with several."""
        value = vars(self.record)[field]
        for key in keys:
            value = value[key]
        return stored(value, self.file, self.line, field, *keys)

    def share(self, field: str) -> Number:
        """The number in a field that is a share of time; unknown without any rollout."""
        shown = replace(self.number(field), trials=0)
        is_known = self.number("episodes").value > 0
        return shown if is_known else replace(shown, value=math.nan)


@dataclass(frozen=True)
class TestSource:
    """A measurement's results for a policy, and where they are stored.

    Attributes:
        file: File of the measurement, relative to the folder of the study.
        position: Position of the policy in it, from 0.
        test: The results.
    """

    file: str
    position: int
    test: PolicyTest

    __test__ = False  # pytest must not collect it

    @property
    def frames(self) -> Number:
        """Number of frames that the policy was trained on."""
        return stored(self.test.frames, self.file, "policies", self.position, "frames")

    def robustness(self, field: str, *keys: int) -> Number:
        """A number of its robustness; unknown if not measured."""
        return self._of("robustness", self.test.robustness, field, keys)

    def pushes(self, field: str, *keys: int) -> Number:
        """A number of the impulses that it withstands; unknown if not measured."""
        return self._of("pushes", self.test.pushes, field, keys)

    def imitation(self, field: str) -> Number:
        """A number of its deviation from the expert; unknown if not measured."""
        return self._of("imitation", self.test.imitation, field, ())

    def _of(self, part: str, record: object, field: str, keys: tuple[int, ...]) -> Number:
        """A number of a part of the test."""
        value = None
        if record is not None:
            value = vars(record)[field]
            for key in keys:
                value = value[key]
        return stored(value, self.file, "policies", self.position, part, field, *keys)


def stages(metrics: Sequence[StageRecord], folder: str = "") -> tuple[StageSource, ...]:
    """All records of a run, with their places.

    Args:
        metrics: The records, in the order of the file.
        folder: Folder of the run, relative to that of the study; empty if it is the same.
    """
    file = f"{folder}/{METRICS_FILE}" if folder else METRICS_FILE
    return tuple(StageSource(file, line, record) for line, record in enumerate(metrics))


def collections(cell: CellResult) -> Iterator[tuple[StageSource, Collected]]:
    """The collections of a run, the pre-training's first."""
    for stage in stages(cell.metrics, cell.cell.name):
        if isinstance(stage.record, Collected):
            yield stage, stage.record


def tests(cell: CellResult, measurement: str) -> tuple[TestSource, ...]:
    """A measurement's results for the policies of a cell, with their places."""
    if measurement not in cell.tests:
        return ()
    file = f"{cell.cell.name}/{TESTS_FOLDER}/{measurement}.json"
    policies = cell.tests[measurement].policies
    return tuple(TestSource(file, position, test) for position, test in enumerate(policies))


def best_test(cell: CellResult, measurement: str) -> TestSource | None:
    """A measurement's results for the best policy of a cell, or for the expert."""
    wanted = cell.best_test(measurement)
    return next((each for each in tests(cell, measurement) if each.test is wanted), None)


def grouped(places: Mapping[str, Sequence[RunPoint]]) -> tuple[Group, ...]:
    """The groups of places that have runs, by the name of the place."""
    return tuple(group_of(label, points) for label, points in places.items() if points)


def panel(
    results: StudyResults,
    setting: str,
    title: str,
    quantity: Quantity,
    groups: GroupsOf,
    limit: float | None = None,
) -> Panel:
    """A panel with every technique that has something to show, and the expert if it has.

    Args:
        results: The results.
        setting: Name of the setting, which the title begins with if there are several.
        title: What the panel shows; empty where the figure's title is enough.
        quantity: What its numbers are.
        groups: What to show of a technique's runs.
        limit: A value that the paper's text names; None without one.
    """
    trained = _trained_curves(results, setting, groups)
    expert = _expert_curve(results, setting, groups)
    return Panel(_titled(results, setting, title), quantity, trained, expert, limit)


def _trained_curves(results: StudyResults, setting: str, groups: GroupsOf) -> tuple[Curve, ...]:
    """The curves of the techniques that have something to show, in the study's order."""
    trained = [each for each in results.study.techniques if each.method != EXPERT]
    curves = []
    for number, technique in enumerate(trained):  # the number selects its color and marker
        shown = tuple(groups(results.of(technique.name, setting)))
        if shown:
            curves.append(Curve(technique.name, technique.title, number, shown))
    return tuple(curves)


def _expert_curve(results: StudyResults, setting: str, groups: GroupsOf) -> Curve | None:
    """The expert of a setting as a curve; None if it has nothing to show."""
    for technique in results.study.techniques:
        if technique.method != EXPERT:
            continue
        shown = tuple(groups(results.of(technique.name, setting)))
        if shown:
            return Curve(technique.name, technique.title, -1, shown)
    return None


def _titled(results: StudyResults, setting: str, title: str) -> str:
    """Title of a panel: what it shows and its setting, if there are several."""
    if len(results.study.settings) == 1:
        return title
    name = results.study.setting(setting).title
    return f"{name}: {title}" if title else name
