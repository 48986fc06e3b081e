"""All results of a study's cells, read together for its report.

`read_results` refuses results that do not belong together. Read `folder` for the files that they
come from, `claims` and `report` for what is made from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from tqdm import tqdm

from surefoot.config import Config
from surefoot.config.json_io import changes
from surefoot.config.study import StudyConfig
from surefoot.robots.scaling import with_own_values
from surefoot.runs.first_stage import without_files
from surefoot.runs.initial_states import resumed_config
from surefoot.runs.layout import CONFIG_FILE, KEPT_POLICY_FILE
from surefoot.runs.metrics import Collected, StageRecord, best_iteration
from surefoot.runs.run import Run, open_run
from surefoot.scenarios.starts import PACKAGED
from surefoot.study.cells import Cell, cells_of, measurements_of
from surefoot.study.folder import (
    JobRecord,
    PolicyTest,
    StudyError,
    StudySetup,
    Tests,
    read_jobs,
    read_study,
    read_tests,
    results_folder,
    run_config,
)
from surefoot.study.layout import STUDY_FILE


@dataclass(frozen=True)
class CellResult:
    """All that is known about one cell.

    Attributes:
        cell: The cell.
        config: Configuration of its run.
        metrics: Its metrics, one record for each stage; none for the expert.
        tests: Measurement -> its results for the cell's policies.
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
        return best_iteration(self.metrics)

    def best_test(self, measurement: str) -> PolicyTest | None:
        """A measurement's results for the best policy, or for the expert; None if none yet."""
        if measurement not in self.tests:
            return None
        wanted = 0 if not self.metrics else self.best_iteration
        for test in self.tests[measurement].policies:
            if test.iteration == wanted:
                return test
        return None


@dataclass(frozen=True)
class StudyResults:
    """All that is known about a study.

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


def sharing_data(results: StudyResults) -> tuple[str, ...]:
    """The techniques whose runs of several seeds have the same data, each with its setting.

    So it is where neither the initial states nor disturbances are drawn: without a budget, pushes
    and noise, cloning begins in the same states for every seed. Such runs differ by the trainings
    alone, as several trainings on the data of one seed do.

    Args:
        results: Results of the study, complete or not.
    """
    found = []
    for technique, setting in product(results.study.techniques, results.study.settings):
        of_seed = {
            result.cell.seed: collected[-1].dataset_hash
            for result in results.of(technique.name, setting.name)
            if (collected := [each for each in result.metrics if isinstance(each, Collected)])
        }
        if len(set(of_seed.values())) < len(of_seed):
            several = len(results.study.settings) > 1
            found.append(f"{technique.title} ({setting.title})" if several else technique.title)
    return tuple(found)


def about_shared_data(results: StudyResults) -> str:
    """A sentence about the techniques whose seeds have the same data; empty if there are none."""
    sharing = sharing_data(results)
    if not sharing:
        return ""
    return (
        f"The seeds of {'; '.join(sharing)} have the same data: these runs differ in their "
        "trainings alone, and intervals over them say nothing about other data."
    )


def read_results(folder: Path) -> StudyResults:
    """All results of a study.

    Raises:
        StudyError: There is no study, a file cannot be read, or the results do not belong together:
            they are of other configurations or measurements, of several commits, or of several
            precisions.
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
        StudyError: A file cannot be read, or the results are of another configuration or of other
            measurements.
    """
    results = results_folder(folder, cell)
    if not results.is_dir():
        return None
    metrics: tuple[StageRecord, ...] = ()
    if (results / CONFIG_FILE).exists():
        run = open_run(results)
        config = with_own_values(run.config)
        if run.method != setup.study.technique(cell.technique).method or config != _asked_of(
            setup, cell, run
        ):
            raise StudyError(
                f"{results} holds results of another configuration than {folder / STUDY_FILE} asks "
                "for; move them away, or restore the study's file"
            )
        metrics = tuple(run.metrics)
    else:
        config = with_own_values(run_config(setup, cell))
    tests = {}
    for measurement in setup.study.measurements:
        measured = read_tests(folder, setup.study, cell, measurement.name)
        if measured is not None:
            tests[measurement.name] = measured
    policy = results / KEPT_POLICY_FILE
    return CellResult(
        cell, config, metrics, tests, read_jobs(folder, cell), policy if policy.exists() else None
    )


def _asked_of(setup: StudySetup, cell: Cell, run: Run) -> Config:
    """The configuration that a study asks for in a cell's run, to compare with what the run has.

    Options that the study does not name are taken from the run, because presets change from version
    to version.

    Args:
        setup: The study.
        cell: The cell.
        run: The run, or what the study keeps of it.
    """
    asked = run_config(setup, cell, run.config)
    if asked.start_set not in (None, *PACKAGED) and not Path(asked.start_set).exists():
        # The file is on another machine: the configuration of the run names a copy of its own.
        asked = replace(asked, start_set=run.config.start_set)
    spec = run.config.robot.spec
    if spec and asked.robot.spec and replace(asked.robot.spec, urdf=spec.urdf) == spec:
        # Likewise, the results have their own copy of the robot's description.
        asked = replace(asked, robot=replace(asked.robot, spec=spec))
    return resumed_config(asked, run.config, run.setup.starts_hash)


def _is_complete(study: StudyConfig, result: CellResult) -> bool:
    """Whether all measurements of a cell are finished."""
    return all(
        name in result.tests and result.tests[name].finished
        for name in measurements_of(study, result.cell)
    )


def _common_part(config: Config) -> Config:
    """The part of a configuration that is the same in all runs of a technique under a setting."""
    config = without_files(config)
    # Results of earlier versions lack some of these files, so only their names are compared.
    others = tuple(
        replace(other, start_set=Path(other.start_set or "").name) for other in config.other_gaits
    )
    config = replace(config, other_gaits=others, start_set=Path(config.start_set or "").name)
    return replace(config, seed=0, training=replace(config.training, seed=None))


def _check_together(setup: StudySetup, results: Sequence[CellResult]) -> None:
    """Check that results may be shown in one table.

    Raises:
        StudyError: They come from several commits or several precisions of training, or the runs of
            a technique have several configurations.
    """
    first: dict[tuple[str, str], tuple[str, Config]] = {}
    for result in results:
        if not result.metrics:
            continue  # no configuration of its run has been kept yet: it has that of the presets
        common = _common_part(result.config)
        same = (result.cell.name, common)
        other, theirs = first.setdefault((result.cell.technique, result.cell.setting), same)
        differing = list(changes(common, theirs))
        if differing:
            names = ", ".join(name for name, _, _ in differing)
            raise StudyError(
                f"{result.cell.name} and {other} are of different configurations "
                f"({names}), though a study has them differ in their seeds alone; move one of them "
                "away, and run it again"
            )
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
