"""The results of a study as numbers with their places in its files.

`StageSource` and `TestSource` pair a record with its place in a file; `trained_curves` and
`expert_curve` give the curves of a panel. `collecting` and `performance` use them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from surefoot.config.study import EXPERT, Technique
from surefoot.runs.layout import METRICS_FILE
from surefoot.runs.metrics import Collected, StageRecord
from surefoot.study.folder import PolicyTest
from surefoot.study.layout import TESTS_FOLDER
from surefoot.study.report.numbers import Number, stored, stored_share
from surefoot.study.report.panels import Curve, Group, RunPoint, group_of
from surefoot.study.results import CellResult, StudyResults


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
        shown = stored_share(vars(self.record)[field], self.file, self.line, field)
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
    for source in tests(cell, measurement):
        if wanted is not None and source.test.iteration == wanted.iteration:
            return source
    return None


def techniques_shown(results: StudyResults) -> Iterator[tuple[int, Technique]]:
    """The techniques that are trained, each with the number of its color and marker."""
    trained = [each for each in results.study.techniques if each.method != EXPERT]
    yield from enumerate(trained)


def expert_curve(
    results: StudyResults, setting: str, groups: Callable[[Sequence[CellResult]], Sequence[Group]]
) -> Curve | None:
    """The expert of a setting as a curve; None if it has nothing to show.

    Args:
        results: The results.
        setting: Name of the setting.
        groups: What to show of the expert's cell: a group for each place.
    """
    for technique in results.study.techniques:
        if technique.method != EXPERT:
            continue
        shown = tuple(groups(results.of(technique.name, setting)))
        if shown:
            return Curve(technique.name, technique.title, -1, shown)
    return None


def trained_curves(
    results: StudyResults, setting: str, groups: Callable[[Sequence[CellResult]], Sequence[Group]]
) -> tuple[Curve, ...]:
    """The curves of the techniques that have something to show, in the study's order.

    Args:
        results: The results.
        setting: Name of the setting.
        groups: What to show of a technique's runs: a group for each place.
    """
    curves = []
    for number, technique in techniques_shown(results):
        shown = tuple(groups(results.of(technique.name, setting)))
        if shown:
            curves.append(Curve(technique.name, technique.title, number, shown))
    return tuple(curves)


def grouped(places: Mapping[str, Sequence[RunPoint]]) -> tuple[Group, ...]:
    """The groups of places that have runs, by the name of the place."""
    return tuple(group_of(label, points) for label, points in places.items() if points)


def titled(results: StudyResults, setting: str, title: str = "") -> str:
    """Title of a panel: what it shows and its setting, if there are several."""
    if len(results.study.settings) == 1:
        return title
    name = results.study.setting(setting).title
    return f"{name}: {title}" if title else name
