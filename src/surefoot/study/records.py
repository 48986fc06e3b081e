"""The records of a comparison of methods, and of a survey of variants of the expert.

A `Comparison` has one `Row` for the expert and one for each run, a `Survey` has one `SurveyCell`
for each variant. What has not been measured yet is None, and is filled in while the study is in
progress. The readers also accept files of earlier versions. Next: `comparison` and `expert_survey`
for the measurements, `tables` and `plot` for how they are shown.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from surefoot.bench.plan import Times
from surefoot.config import Backend, Config
from surefoot.config.json_io import from_json, read_json, to_json
from surefoot.evaluation.push_limits import PushDifference, PushLimits, PushResult
from surefoot.evaluation.robustness import Robustness, VelocityError
from surefoot.evaluation.statistics import Interval, PairedDifference
from surefoot.files import write_json
from surefoot.runs.run_cost import RunCost

Nodes = tuple[int, int]
"""Number of centroidal and of kinematic nodes, 50 ms apart."""
Rules = Literal["published", "own"]
"""The rules for footholds and commands: BiConMP's, or this package's."""
Variant = tuple[Backend, Nodes, Rules]
"""A variant of the expert."""
_PREFIXES = {"paper": "", "wide": "wide_"}
"""Prefixes of the JSON keys of a cell's two survivals."""


@dataclass(frozen=True)
class Measured:
    """What has been measured of one controller in one simulator.

    Attributes:
        evaluation: Its robustness on the `test` initial states.
        pushes: The impulses that it withstands.
    """

    evaluation: Robustness | None = None
    pushes: PushResult | None = None


@dataclass(frozen=True)
class Difference:
    """Paired differences between one row and another, in one simulator.

    Attributes:
        success: Difference of the success rates.
        pushes: Difference of the impulses [N s].
    """

    success: PairedDifference | None = None
    pushes: PushDifference | None = None


@dataclass(frozen=True)
class Differences:
    """Paired differences between a row and the two reference rows, in one simulator.

    Attributes:
        expert: Row minus expert; None in the expert's row.
        baseline: Row minus baseline; None in the baseline's row, and without a baseline.
    """

    expert: Difference | None = None
    baseline: Difference | None = None


@dataclass(frozen=True)
class Row:
    """One controller of a comparison: the expert, or the policy of a run.

    Attributes:
        label: Name of the row.
        run: Folder of the run; None for the expert.
        method: Name of the run's method; None for the expert.
        policy: File of the policy; None for the expert.
        sha256: SHA-256 of that file; None for the expert.
        cost: What the whole run cost; None for the expert.
        results: Simulator -> what has been measured in it.
        differences: Simulator -> how the row differs from the expert and from the baseline; empty
            while the comparison is in progress.
    """

    label: str
    run: str | None = None
    method: str | None = None
    policy: str | None = None
    sha256: str | None = None
    cost: RunCost | None = None
    results: dict[Backend, Measured] = field(default_factory=dict)
    differences: dict[Backend, Differences] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """Several policies, and the expert, measured in the same settings.

    Attributes:
        config: Robot, gait, expert, falls, evaluation and pushes, the same for all rows.
        episodes: Number of `test` initial states.
        versions: Package -> its version, and the processor.
        starts: Name of the set of initial states -> its SHA-256.
        baseline: Label of the row that the others are compared with; None without any.
        rows: The expert's row, then one for each run.
    """

    config: Config
    episodes: int
    versions: dict[str, str]
    starts: dict[str, str]
    baseline: str | None
    rows: tuple[Row, ...]


@dataclass(frozen=True)
class Survival:
    """How a variant of the expert did on one set of initial states.

    Attributes:
        episodes: Number of initial states.
        survived: Number of robots that did not fall, and that the expert did not give up on.
        survived_interval: Wilson's 95 % interval of the share that survived.
        stalls: Number of robots that stayed up and stopped stepping.
        lost: Ids of the initial states that the robots did not survive.
        invalid_plans: Number of MPC solves that gave no valid plan.
        mse: Mean squared velocity error from 1 s on: vx, vy [m^2/s^2], yaw rate [rad^2/s^2].
        starts_hash: SHA-256 of the set of initial states.
    """

    episodes: int
    survived: int
    survived_interval: Interval
    stalls: int
    lost: tuple[int, ...]
    invalid_plans: int
    mse: VelocityError
    starts_hash: str


@dataclass(frozen=True)
class SurveyCell:
    """What has been measured of one variant of the expert; None where nothing has been yet.

    Attributes:
        simulator: The simulator.
        nodes: Number of centroidal and of kinematic nodes.
        rules: The rules for footholds and commands.
        plan_ms: Wall time of cold plans [ms].
        paper: Survival of the initial states with the paper's deviations.
        wide: Survival of the initial states with 1.5 times those deviations.
        push: The impulses that the variant withstands.
    """

    simulator: Backend
    nodes: Nodes
    rules: Rules
    plan_ms: Times | None = None
    paper: Survival | None = None
    wide: Survival | None = None
    push: PushLimits | None = None

    @property
    def variant(self) -> Variant:
        """What distinguishes the cell from the others."""
        return self.simulator, self.nodes, self.rules

    @property
    def title(self) -> str:
        """The variant in words."""
        return f"{self.simulator}, {self.nodes[0]}/{self.nodes[1]} nodes, {self.rules} rules"


@dataclass(frozen=True)
class Survey:
    """Variants of the expert, measured on equal terms.

    Attributes:
        config: What the variants have in common, with the package's own rules.
        episodes: Number of initial states of each set.
        versions: Package -> its version, and the processor.
        starts: Name of each set of initial states -> its SHA-256.
        cells: The variants.
        lost_by_all: Simulator and set -> ids of the initial states that every variant measured so
            far has lost.
    """

    config: Config
    episodes: int
    versions: dict[str, str]
    starts: dict[str, str]
    cells: tuple[SurveyCell, ...]
    lost_by_all: dict[str, tuple[int, ...]]


def read_comparison(path: Path) -> Comparison:
    """Read a comparison, finished or in progress, even if an earlier version wrote it.

    Raises:
        ValueError: The file is not JSON, or has unknown or missing keys; the message names the file
            and the key.
    """
    values = read_json(path)
    try:
        return from_json(Comparison, values)
    except ValueError as error:
        raise ValueError(f"{path} is no comparison that this version can read: {error}") from error


def read_survey(path: Path) -> Survey:
    """Read a survey, finished or in progress, even if an earlier version wrote it.

    Raises:
        ValueError: The file is not JSON, or has unknown or missing keys; the message names the file
            and the key.
    """
    values = read_json(path)
    try:
        # A survey that has no measurement yet may have been written without this key.
        values = {"lost_by_all": {}} | _object(values, "Survey")
        cells = values.get("cells")
        if not isinstance(cells, list):
            raise ValueError(f"cells is {cells!r}, expected a list")
        survey = from_json(Survey, values | {"cells": []})
        read = [_read_cell(cell, f"cells[{number}]") for number, cell in enumerate(cells)]
        return replace(survey, cells=tuple(read))
    except ValueError as error:
        raise ValueError(f"{path} is no survey that this version can read: {error}") from error


def write_survey(path: Path, survey: Survey) -> None:
    """Write a survey as JSON, with the fields of a cell's survivals among its other fields.

    Raises:
        WriteError: The file cannot be written.
    """
    values = to_json(survey)
    for cell in values["cells"]:
        for name, prefix in _PREFIXES.items():
            survival = cell.pop(name) or {}
            cell |= {prefix + key: value for key, value in survival.items()}
    write_json(path, values)


def _read_cell(cell: object, where: str) -> SurveyCell:
    """A cell from its JSON values, with the fields of its survivals among its other fields."""
    values = _object(cell, where)
    for name, prefix in _PREFIXES.items():
        if f"{prefix}survived" in values:
            keys = [field.name for field in fields(Survival) if prefix + field.name in values]
            values[name] = {key: values.pop(prefix + key) for key in keys}
    push = values.pop("push", None)
    read = from_json(SurveyCell, values, where)
    return read if push is None else replace(read, push=_read_push(push, f"{where}.push"))


def _read_push(push: object, where: str) -> PushLimits:
    """Pushes from their JSON values; earlier versions did not write each robot's outcome."""
    values = _object(push, where)
    if "survived" in values:
        return from_json(PushResult, values, where)
    known = {key: value for key, value in values.items() if key != "unpushed_successes"}
    return from_json(PushLimits, known, where)


def _object(value: object, where: str) -> dict[str, Any]:
    """A copy of a JSON object.

    Raises:
        ValueError: The value is not an object.
    """
    if not isinstance(value, dict):
        raise ValueError(f"{where} is {value!r}, expected an object with keys")
    return dict(value)
