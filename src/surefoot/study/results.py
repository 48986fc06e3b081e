"""What a study leaves for its report: small files, one folder for each cell, and their reader.

The folder of a study holds ``study.json`` and a folder for each cell, with the configuration of the
run, its metrics, what was measured of its policies, a record of each job, and the policy that is
kept. All of it can be committed; the folders of runs, logs and code beside it are only needed while
the study runs. `read_results` refuses results that do not belong together. Read `claims` and
`report` for what is made of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from tqdm import tqdm

from surefoot.config import Config
from surefoot.config.json_io import from_json, read_json
from surefoot.config.learning import NumberFormat
from surefoot.config.study import StudyConfig
from surefoot.evaluation.imitation import ImitationError
from surefoot.evaluation.push_limits import PushResult
from surefoot.evaluation.robustness import Robustness
from surefoot.files import write_atomic, write_json
from surefoot.robots.scaling import with_own_values
from surefoot.runs.initial_states import resumed_config
from surefoot.runs.layout import KEPT_POLICY_FILE, STARTS_FILE
from surefoot.runs.metrics import Best, StageRecord
from surefoot.runs.run import CONFIG_FILE, Run, open_run, read_setup
from surefoot.scenarios.starts import PACKAGED
from surefoot.study.cells import Cell, cell_config, cells_of, measurements_of

Record = TypeVar("Record")
STUDY_FILE = "study.json"
"""File in a study's folder that makes the folder a study."""


class StudyError(ValueError):
    """A study cannot be run or read as asked."""


@dataclass(frozen=True)
class StudySetup:
    """The content of a study's ``study.json``.

    Attributes:
        study: The study.
        commit: The commit of the code that its jobs run; None if it was not in a checkout.
        version: Version of the package.
        precision: The number format in which cells train whose precision is `auto`, measured once
            for all of them.
    """

    study: StudyConfig
    commit: str | None
    version: str
    precision: NumberFormat


@dataclass(frozen=True)
class JobRecord:
    """What ran where, and for how long.

    Attributes:
        job: Name of the job.
        commit: The commit that it ran; None outside of a checkout.
        processors: Models of the processors that it ran on, more than one if it was moved.
        versions: Version of Python and of each package, by name.
        precision: Number format of the products in training; empty if nothing was trained.
        started: When it was started first, in UTC, as ISO 8601.
        seconds: Processor time of all its slices [s]; in files of earlier versions how long they
            took, pauses included.
        finished: Whether it is done; if not, it goes on where it stopped.
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
    """What one measurement says of one policy, or of the expert.

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
    """What one measurement says of the policies of one cell.

    Attributes:
        measurement: Name of the measurement.
        policies: The policies, in the order of their iterations.
        finished: Whether all of them are measured.
    """

    measurement: str
    policies: tuple[PolicyTest, ...]
    finished: bool


@dataclass(frozen=True)
class CellResult:
    """All that is known of one cell.

    Attributes:
        cell: The cell.
        config: Configuration of its run.
        metrics: Its metrics, one record for each stage; none for the expert.
        tests: Measurement -> what it says of the cell's policies.
        jobs: The jobs that made it, as far as they are recorded.
        policy: File of the policy that is kept, if one is.
    """

    cell: Cell
    config: Config
    metrics: tuple[StageRecord, ...]
    tests: dict[str, Tests]
    jobs: tuple[JobRecord, ...]
    policy: Path | None

    @property
    def best_iteration(self) -> int | None:
        """The iteration of the policy that the run chose; None if the run is not finished."""
        for record in self.metrics:
            if isinstance(record, Best):
                return record.best_iteration
        return None

    def best_test(self, measurement: str) -> PolicyTest | None:
        """What a measurement says of the best policy, or of the expert; None if nothing yet."""
        if measurement not in self.tests:
            return None
        wanted = 0 if not self.metrics else self.best_iteration
        for test in self.tests[measurement].policies:
            if test.iteration == wanted:
                return test
        return None


@dataclass(frozen=True)
class StudyResults:
    """All that is known of a study.

    Attributes:
        setup: The study, and the commit that it ran.
        folder: Folder of the study.
        cells: The cells that have any result, in the study's order.
        missing: Names of the cells that lack a result.
    """

    setup: StudySetup
    folder: Path
    cells: tuple[CellResult, ...]
    missing: tuple[str, ...]

    @property
    def study(self) -> StudyConfig:
        """The study."""
        return self.setup.study

    def of(self, technique: str, setting: str) -> tuple[CellResult, ...]:
        """The results of a technique under a setting, one for each run, in the order of seeds.

        Raises:
            ValueError: The study has no such technique or setting.
        """
        self.study.technique(technique)
        self.study.setting(setting)
        return tuple(
            result
            for result in self.cells
            if result.cell.technique == technique and result.cell.setting == setting
        )


def run_config(setup: StudySetup, cell: Cell) -> Config:
    """The configuration of a cell's run, with the precision that the whole study trains in."""
    config = cell_config(setup.study, cell)
    if config.training.precision != "auto":
        return config
    return replace(config, training=replace(config.training, precision=setup.precision))


def save_setup(folder: Path, setup: StudySetup) -> None:
    """Write what fixes a study into its folder.

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
    starts = run.folder / STARTS_FILE
    if starts.exists() and not (results / STARTS_FILE).exists():
        write_atomic(results / STARTS_FILE, starts.read_bytes())
    write_atomic(results / run.metrics_path.name, run.metrics_path.read_bytes())


def save_tests(folder: Path, cell: Cell, tests: Tests) -> None:
    """Keep what a measurement says of a cell."""
    write_json(results_folder(folder, cell) / "tests" / f"{tests.measurement}.json", tests)


def read_tests(folder: Path, cell: Cell, measurement: str) -> Tests | None:
    """What a measurement says of a cell; None if nothing yet.

    Raises:
        StudyError: The file cannot be read.
    """
    path = results_folder(folder, cell) / "tests" / f"{measurement}.json"
    return _read(Tests, path) if path.exists() else None


def save_job(folder: Path, cell: Cell, record: JobRecord) -> None:
    """Keep the record of a job."""
    write_json(results_folder(folder, cell) / "jobs" / f"{record.job}.json", record)


def read_job(folder: Path, cell: Cell, job: str) -> JobRecord | None:
    """The record of a job; None if it has not ended once.

    Raises:
        StudyError: The file cannot be read.
    """
    path = results_folder(folder, cell) / "jobs" / f"{job}.json"
    return _read(JobRecord, path) if path.exists() else None


def read_results(folder: Path) -> StudyResults:
    """All results of a study.

    Raises:
        StudyError: There is no study, a file cannot be read, or the results do not belong together:
            they are of other configurations, of several commits, or of several precisions.
    """
    setup = read_study(folder)
    results = []
    missing = []
    for cell in tqdm(cells_of(setup.study), "results", leave=False, unit="cell"):
        result = read_cell(folder, setup, cell)
        if result is not None:
            results.append(result)
        if result is None or not _is_complete(setup.study, result):
            missing.append(cell.name)
    _check_together(setup, results)
    return StudyResults(setup, folder, tuple(results), tuple(missing))


def read_cell(folder: Path, setup: StudySetup, cell: Cell) -> CellResult | None:
    """All results of a cell; None if there are none yet.

    Raises:
        StudyError: A file cannot be read, or the results are of another configuration.
    """
    results = results_folder(folder, cell)
    if not results.is_dir():
        return None
    config = with_own_values(run_config(setup, cell))
    metrics: tuple[StageRecord, ...] = ()
    if (results / CONFIG_FILE).exists():
        run = open_run(results)
        config = _resumed(run_config(setup, cell), run)
        if with_own_values(run.config) != config:
            raise StudyError(
                f"{results} holds results of another configuration than {folder / STUDY_FILE} asks "
                "for; move them away, or restore the study's file"
            )
        metrics = tuple(run.metrics)
    tests = {}
    for measurement in setup.study.measurements:
        measured = read_tests(folder, cell, measurement.name)
        if measured is not None:
            tests[measurement.name] = measured
    jobs = [_read(JobRecord, path) for path in sorted(results.glob("jobs/*.json"))]
    policy = results / KEPT_POLICY_FILE
    return CellResult(
        cell, config, metrics, tests, tuple(jobs), policy if policy.exists() else None
    )


def _resumed(asked: Config, run: Run) -> Config:
    """The configuration that a study asks for, with what its run has, to be compared with that.

    Args:
        asked: What the study asks for.
        run: The run, or what the study keeps of it.
    """
    if asked.start_set not in (None, *PACKAGED) and not Path(asked.start_set).exists():
        # A file of another machine: the results have their own copy of the initial states.
        asked = replace(asked, start_set=run.config.start_set)
    return resumed_config(asked, run.config, read_setup(run.folder).starts_hash)


def _is_complete(study: StudyConfig, result: CellResult) -> bool:
    """Whether everything has been measured of a cell."""
    return all(
        name in result.tests and result.tests[name].finished
        for name in measurements_of(study, result.cell)
    )


def _check_together(setup: StudySetup, results: Sequence[CellResult]) -> None:
    """Check that results may stand in one table.

    Raises:
        StudyError: They are of several commits, or of several precisions of training.
    """
    jobs = [job for result in results for job in result.jobs]
    for name, values in (
        ("commits", {job.commit for job in jobs} | ({setup.commit} if jobs else set())),
        ("precisions", {job.precision for job in jobs if job.precision}),
    ):
        if len(values) > 1:
            listed = ", ".join(sorted(str(value) for value in values))
            raise StudyError(
                f"the results are of several {name} ({listed}), which must not stand in one "
                "table: run the study again from one, or move the others away"
            )


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
