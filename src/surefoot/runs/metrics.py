"""A run's metrics: one record, and one line of ``metrics.jsonl``, for each stage that is done.

`StageRecord` is the type of any record; the field ``stage`` tells them apart. The fields of a
record include what its stage has measured. Only `format_line` and `parse_line` convert between
records and lines. A field whose default is None is left out of the line if it is None; NaN becomes
null. Runs of earlier versions wrote ``guard_classifier`` and ``guard_history`` for what is now
``gate_classifier`` and ``gate_history``; both are read. `parse_metrics` reads a whole file. Read
`runs.stages` next, which makes most of the records.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

from surefoot.config import NumberFormat
from surefoot.config.json_io import Plain, from_json, to_json
from surefoot.config.json_text import parse_json
from surefoot.errors import shown, unknown
from surefoot.evaluation.robustness import Robustness
from surefoot.learning.classifier import ClassifierQuality
from surefoot.runs.collection_cost import CollectionCost

LearnedGate = Literal["classifier", "history"]
"""The gates that are networks: `safety.learned.Deviation` and `safety.learned.History`."""


@dataclass(frozen=True, kw_only=True)
class Collected(CollectionCost):
    """Iteration i has collected data: D <- D u D'. The fields include the cost of collecting.

    Attributes:
        stage: Name of the stage in the file.
        iteration: The iteration i; 0 is the pre-training.
        expert: Name of the expert that drove or was queried.
        starts_hash: SHA-256 of the stored set of initial states.
        dataset_frames: Number of frames in D.
        dataset_hash: SHA-256 of D.
        seconds: Wall time of the stage [s].
        allowed_seconds: Expert-seconds that the stage may spend (`config.budget`), MPC solves x
            0.05 s [s]; None without a budget.
        spent_seconds: Expert-seconds that the stage has spent [s]; None without a budget.
    """

    stage: Literal["collect"] = "collect"
    iteration: int
    expert: str
    starts_hash: str
    dataset_frames: int
    dataset_hash: str
    seconds: float
    allowed_seconds: float | None = None
    spent_seconds: float | None = None


@dataclass(frozen=True, kw_only=True)
class Trained:
    """Iteration i has trained its policy pi_i on D.

    Attributes:
        stage: Name of the stage in the file.
        iteration: The iteration i; 0 is the pre-training.
        epochs: Number of passes over the data, including mirror images; the last one may end
            early.
        steps: Number of optimizer steps.
        frames: Number of frames in D, held out or not.
        device: Device that the network was trained on, as PyTorch names it.
        precision: Number format of the products of the hidden layers; None in files of early
            versions.
        train_loss: Mean L1 loss of the last epoch [rad].
        validation_loss: Mean L1 loss on the held-out episodes [rad]; None without any.
        seconds: Wall time of the stage [s].
        episodes: Number of episodes in D; None in files of early versions.
        dataset_hash: SHA-256 of D; in a series of dataset sizes (behavior cloning), D is only a
            part of the collected data. None in files of early versions.
    """

    stage: Literal["train"] = "train"
    iteration: int
    epochs: int
    steps: int
    frames: int
    device: str
    precision: NumberFormat | None = None
    train_loss: float
    validation_loss: float | None
    seconds: float
    episodes: int | None = None
    dataset_hash: str | None = None


@dataclass(frozen=True, kw_only=True)
class Validated(Robustness):
    """Iteration i has measured the robustness of its policy pi_i on the `select` initial states.

    Attributes:
        stage: Name of the stage in the file.
        iteration: The iteration i; 0 is the pre-training.
        seconds: Wall time of the stage [s].
    """

    stage: Literal["validate"] = "validate"
    iteration: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class GateTrained(ClassifierQuality):
    """Iteration i has trained the network of a learned gate; positive means unsafe.

    Attributes:
        stage: Name of the stage in the file: `gate_` and the kind of gate.
        iteration: The iteration i; 0 is the pre-training.
        tau: Deviation beyond which a state is unsafe (SafeDAGGER); None for a history gate.
        sigma: ``(12,)`` standard deviation of each joint's target, which scales the deviation
            [rad]; None for a history gate.
        sha256: SHA-256 of the network; None in files of early versions.
        seconds: Wall time of the stage [s].
    """

    stage: Literal["gate_classifier", "gate_history"]
    iteration: int
    tau: float | None = None
    sigma: tuple[float, ...] | None = None
    sha256: str | None = None
    seconds: float

    @property
    def kind(self) -> LearnedGate:
        """Name of the learned gate."""
        return "classifier" if self.stage == "gate_classifier" else "history"


@dataclass(frozen=True, kw_only=True)
class Best:
    """The run is finished, and its best policy is chosen.

    Attributes:
        stage: Name of the stage in the file.
        iteration: Always 0, as the stage belongs to the whole run.
        best_iteration: Iteration that trained the policy that the run chose
            (`surefoot.runs.stages.choose_best_policy`); always the last one in behavior cloning and
            in a run on a robot.
    """

    stage: Literal["best"] = "best"
    iteration: int = 0
    best_iteration: int


StageRecord = Collected | Trained | Validated | GateTrained | Best
"""A record of a stage that is done."""

MOST_ITERATIONS = 10_000
"""The most iterations that any configuration allows."""
_KINDS: dict[str, type[StageRecord]] = {
    "collect": Collected,
    "train": Trained,
    "validate": Validated,
    "gate_classifier": GateTrained,
    "gate_history": GateTrained,
    "best": Best,
}


def line_values(record: StageRecord) -> dict[str, Plain]:
    """The JSON values of a record's line, without fields whose default is None if they are None."""
    values = {"stage": record.stage, "iteration": record.iteration} | to_json(record)
    optional = [field.name for field in fields(record) if field.default is None]
    for name in optional:
        if values[name] is None:
            del values[name]
    return values


def format_line(record: StageRecord) -> bytes:
    """A record as a line of JSON, without the newline."""
    return json.dumps(line_values(record), allow_nan=False).encode()


def parse_line(line: bytes) -> StageRecord:
    """The record of a line, of this version or an earlier one.

    Raises:
        ValueError: The line is not JSON, or not a record of any stage. The message continues a
            sentence that begins with the name of the line.
    """
    try:
        values = parse_json(line)
    except ValueError as error:
        raise ValueError(f"is not JSON ({error})") from error
    if not isinstance(values, dict):
        raise ValueError(f"is no record: {shown(values)} is not an object with keys")
    stage = str(values.get("stage"))[:80]
    if stage.startswith("guard_"):
        stage = "gate_" + stage.removeprefix("guard_")
    if stage not in _KINDS:
        raise ValueError(f"is no record: {unknown('stage', stage, _KINDS)}")
    try:
        record = from_json(_KINDS[stage], values | {"stage": stage})
        _check_iterations(record)
    except ValueError as error:
        raise ValueError(f"is not a whole record of the stage {stage} ({error})") from error
    return record


def parse_metrics(content: bytes, path: Path) -> list[StageRecord]:
    """The records in the content of a metrics file, in order.

    Args:
        content: Content of the file.
        path: The file, for messages.

    Raises:
        ValueError: A line is no record, or repeats the stage of another line, whose cost would then
            count twice.
    """
    records: list[StageRecord] = []
    lines: dict[tuple[str, int], int] = {}
    for number, line in enumerate(content.splitlines(), 1):
        try:
            record = parse_line(line)
        except ValueError as error:
            raise ValueError(
                f"line {number} of {path} {error}; delete it and all lines after it: "
                "`surefoot train ... --resume` does those stages again"
            ) from error
        first = lines.setdefault(stage_of(record), number)
        if first < number:
            raise ValueError(
                f"lines {first} and {number} of {path} are both of the stage {record.stage} of "
                f"iteration {record.iteration}, which is done once; delete line {number}"
            )
        records.append(record)
    return records


def best_iteration(records: Iterable[StageRecord]) -> int | None:
    """The iteration of the policy that a run chose; None if it has not finished."""
    return next((r.best_iteration for r in records if isinstance(r, Best)), None)


def stage_of(record: StageRecord) -> tuple[str, int]:
    """The name and the iteration of a stage, which together are unique in a run."""
    return record.stage, record.iteration


def _check_iterations(record: StageRecord) -> None:
    """Check that the iterations in a record are possible.

    Raises:
        ValueError: A number is negative, or larger than in any run.
    """
    named = {"iteration": record.iteration}
    if isinstance(record, Best):
        named["best_iteration"] = record.best_iteration
    for name, iteration in named.items():
        if not 0 <= iteration <= MOST_ITERATIONS:
            raise ValueError(f"{name} is {iteration}, expected 0 to {MOST_ITERATIONS}")
