"""The files in a study's folder, one record each: their content, their place, how to read them.

The folder of a study has ``study.json`` and a folder for each cell, with the configuration of the
run, its metrics, what was measured of its policies, a record of each job, and the policy that is
kept. All of these can be committed; the folders of runs, logs and code beside them are only needed
while the study runs. Read `results` for how the files are read together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from surefoot.config import Config
from surefoot.config.json_io import from_json, read_json
from surefoot.config.learning import NumberFormat
from surefoot.config.study import Options, StudyConfig
from surefoot.evaluation.imitation import ImitationError
from surefoot.evaluation.push_limits import PushResult
from surefoot.evaluation.robustness import Robustness
from surefoot.files import write_atomic, write_json
from surefoot.runs.layout import CONFIG_FILE, KEPT_POLICY_FILE, ROBOT_FILE, STARTS_FILES
from surefoot.runs.run import Run
from surefoot.runs.setup import read_setup
from surefoot.study.cells import Cell, StudyJob, cell_config, jobs_of, measured_options
from surefoot.study.layout import JOBS_FOLDER, JUDGED_FILE, STUDY_FILE, TESTS_FOLDER

Record = TypeVar("Record")


class StudyError(ValueError):
    """A study cannot be run or read as asked."""


@dataclass(frozen=True)
class StudySetup:
    """The content of a study's ``study.json``.

    Attributes:
        study: The study.
        commit: The commit of the code that its jobs run; None if it was not in a checkout.
        version: Version of the package.
        precision: The number format for cells whose precision is `auto`, measured once for all of
            them.
        beginnings: Name of a cell -> name of the job that makes what it begins with
            (`cells.beginnings_of`), as of the study's start; None in files of earlier versions.
    """

    study: StudyConfig
    commit: str | None
    version: str
    precision: NumberFormat
    beginnings: dict[str, str] | None = None

    @property
    def jobs(self) -> tuple[StudyJob, ...]:
        """All jobs of the study, as of its start, each after those that it needs."""
        return jobs_of(self.study, self.beginnings)


@dataclass(frozen=True)
class JudgedPrediction:
    """A prediction and its outcome, as a person judges it.

    Attributes:
        prediction: The sentence, exactly as in the study.
        verdict: Whether it came true, in a word or two.
        came_out: The outcome, in words.
    """

    prediction: str
    verdict: str
    came_out: str


@dataclass(frozen=True)
class Judged:
    """The content of a study's ``judged.json``.

    Attributes:
        predictions: The predictions that have been judged.
    """

    predictions: tuple[JudgedPrediction, ...] = ()


@dataclass(frozen=True)
class JobRecord:
    """What ran where, and for how long.

    Attributes:
        job: Name of the job.
        commit: The commit that it ran; None outside of a checkout.
        processors: Models of the processors that it ran on, more than one if it was moved.
        versions: Version of Python and of each package, by name.
        precision: Number format of the products in training; empty if nothing was trained.
        started: When it was first started, in UTC, as ISO 8601.
        seconds: Processor time of all its slices [s]; in files of earlier versions, their wall
            time, pauses included.
        finished: Whether it is done; if not, it continues where it stopped.
    """

    job: str
    commit: str | None
    processors: tuple[str, ...]
    versions: dict[str, str]
    precision: str
    started: str
    seconds: float
    finished: bool


@dataclass(frozen=True)
class PolicyTest:
    """The results of one measurement for one policy, or for the expert.

    Attributes:
        iteration: Iteration that trained the policy (behavior cloning: number of the size of its
            data); 0 for the expert.
        frames: Number of frames that it was trained on; None for the expert.
        sha256: SHA-256 of the policy's file; None for the expert.
        robustness: Its robustness, where that is measured.
        pushes: The impulses that it withstands, where these are measured.
        imitation: Its deviation from the expert's targets, where that is measured.
    """

    iteration: int
    frames: int | None
    sha256: str | None
    robustness: Robustness | None = None
    pushes: PushResult | None = None
    imitation: ImitationError | None = None


@dataclass(frozen=True)
class Tests:
    """The results of one measurement for the policies of one cell.

    Attributes:
        measurement: Name of the measurement.
        policies: The policies, in the order of their iterations.
        finished: Whether all of them are measured.
        options: The study's options for it (`cells.measured_options`); None in files of earlier
            versions.
    """

    measurement: str
    policies: tuple[PolicyTest, ...]
    finished: bool
    options: Options | None = None

    __test__ = False  # pytest must not collect it


def run_config(setup: StudySetup, cell: Cell, base: Config | None = None) -> Config:
    """The configuration of a cell's run, with the precision that the whole study trains in.

    Args:
        setup: The study.
        cell: The cell.
        base: The configuration that the study's options change; None is the technique's preset.
    """
    config = cell_config(setup.study, cell, base)
    if config.training.precision != "auto":
        return config
    return replace(config, training=replace(config.training, precision=setup.precision))


def save_setup(folder: Path, setup: StudySetup) -> None:
    """Write a study's setup into its folder.

    Raises:
        WriteError: The folder cannot be written to.
    """
    write_json(folder / STUDY_FILE, setup)


def read_study(folder: Path) -> StudySetup:
    """The study of a folder.

    Raises:
        StudyError: There is no study, or its file cannot be read.
    """
    path = folder / STUDY_FILE
    if not path.is_file():
        raise StudyError(f"{folder} holds no study (no {path.name}); `surefoot study` makes one")
    return _read(StudySetup, path)


def read_predictions(folder: Path, study: StudyConfig) -> tuple[JudgedPrediction, ...]:
    """The predictions of a study with their outcomes; empty texts for those not judged yet.

    Raises:
        StudyError: The file cannot be read, judges a prediction twice, or judges something that the
            study does not predict.
    """
    path = folder / JUDGED_FILE
    judged = _read(Judged, path).predictions if path.exists() else ()
    known = {each.prediction: each for each in judged}
    if len(known) < len(judged):
        raise StudyError(f"{path} judges a prediction twice; leave one of them out")
    for text in known:
        if text not in study.predictions:
            raise StudyError(
                f"{path} judges {text!r}, which {STUDY_FILE} does not predict; copy its sentences"
            )
    return tuple(known.get(text, JudgedPrediction(text, "", "")) for text in study.predictions)


def results_folder(folder: Path, cell: Cell) -> Path:
    """Folder of a cell's results in the folder of its study."""
    return folder / cell.name


def run_folder(folder: Path, cell: Cell) -> Path:
    """Folder of a cell's run."""
    return folder / "runs" / cell.name


def shared_folder(folder: Path, job: str) -> Path:
    """Folder of the run that makes what several cells begin with."""
    return folder / "runs" / "shared" / job


def save_run(folder: Path, cell: Cell, run: Run) -> None:
    """Keep the configuration and the metrics of a cell's run, as they are now.

    Before the first stage is done there is nothing to keep.

    Args:
        folder: Folder of the study.
        cell: The cell.
        run: Its run.
    """
    if not run.metrics_path.exists():
        return
    results = results_folder(folder, cell)
    write_json(results / CONFIG_FILE, read_setup(run.folder))
    _copy(run, ROBOT_FILE, results)
    write_atomic(results / run.metrics_path.name, run.metrics_path.read_bytes())


def save_policy(folder: Path, cell: Cell, run: Run) -> None:
    """Keep the best policy of a cell's run, with the run's own initial states to play it from.

    Only cells with a policy need the states, which are the same in many cells of a study.

    Args:
        folder: Folder of the study.
        cell: The cell.
        run: Its run, which is finished.
    """
    results = results_folder(folder, cell)
    for name in STARTS_FILES:
        _copy(run, name, results)
    write_atomic(results / KEPT_POLICY_FILE, run.best_policy_path.read_bytes())


def _copy(run: Run, name: str, results: Path) -> None:
    """Copy a file of a run that never changes, if it has it, unless that is done already."""
    original = run.folder / name
    if original.exists() and not (results / name).exists():
        write_atomic(results / name, original.read_bytes())


def save_tests(folder: Path, cell: Cell, tests: Tests) -> None:
    """Keep the results of a measurement of a cell."""
    write_json(results_folder(folder, cell) / TESTS_FOLDER / f"{tests.measurement}.json", tests)


def read_tests(folder: Path, study: StudyConfig, cell: Cell, measurement: str) -> Tests | None:
    """The results of a measurement of a cell; None if there are none yet.

    Args:
        folder: Folder of the study.
        study: The study.
        cell: The cell.
        measurement: Name of the measurement.

    Raises:
        StudyError: The file cannot be read, or was measured with other options than the study has.
    """
    path = results_folder(folder, cell) / TESTS_FOLDER / f"{measurement}.json"
    if not path.exists():
        return None
    tests = _read(Tests, path)
    asked = measured_options(study, cell, measurement)
    if tests.options is not None and tests.options != asked:
        other = sorted({name for name, _ in tests.options.items() ^ asked.items()})
        raise StudyError(
            f"{path} was measured with other options ({', '.join(other)}) than "
            f"{folder / STUDY_FILE} asks for; move it away, or restore the study's file"
        )
    return tests


def save_job(folder: Path, cell: Cell, record: JobRecord) -> None:
    """Keep the record of a job."""
    write_json(results_folder(folder, cell) / JOBS_FOLDER / f"{record.job}.json", record)


def read_job(folder: Path, cell: Cell, job: str) -> JobRecord | None:
    """The record of a job; None if it has never ended.

    Raises:
        StudyError: The file cannot be read.
    """
    path = results_folder(folder, cell) / JOBS_FOLDER / f"{job}.json"
    return _read(JobRecord, path) if path.exists() else None


def read_jobs(folder: Path, cell: Cell) -> tuple[JobRecord, ...]:
    """The records of all jobs of a cell, in the order of their names.

    Raises:
        StudyError: A file cannot be read.
    """
    paths = sorted(results_folder(folder, cell).glob(f"{JOBS_FOLDER}/*.json"))
    return tuple(_read(JobRecord, path) for path in paths)


def _read(kind: type[Record], path: Path) -> Record:
    """A record from a file of a study.

    Raises:
        StudyError: The file cannot be read.
    """
    try:
        return from_json(kind, read_json(path))
    except (OSError, ValueError) as error:
        raise StudyError(
            f"{path} cannot be read: {error}. Restore it from a copy, or delete it to do that part "
            "of the study again"
        ) from error
