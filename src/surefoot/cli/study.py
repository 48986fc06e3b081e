"""The command study: many runs and their measurements, from one file.

The first word says what to do with a study: run it (no word), show its ``status``, ``pause`` or
``resume`` it. Everything is kept in the study's folder (`surefoot.study.state`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.options import OnWorkers
from surefoot.cli.outputs import Output, check_outputs
from surefoot.cli.progress import duration_text
from surefoot.errors import unknown
from surefoot.files import write_json

if TYPE_CHECKING:
    from surefoot.config.study import StudyConfig
    from surefoot.study.cells import StudyJob
    from surefoot.study.estimate import Estimate
    from surefoot.study.state import JobStatus

ACTIONS = ("status", "pause", "resume")
"""First words that do something else than running the study."""


@dataclass(frozen=True)
class JobReport:
    """How far a job is, for machines.

    Attributes:
        name: Name of the job.
        state: `done`, `running`, `ready`, `waiting` or `failed`.
        seconds: How long it has worked so far, in processor time [s].
    """

    name: str
    state: str
    seconds: float


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is, for machines.

    Attributes:
        folder: Folder of the study.
        paused: Whether it is paused.
        jobs: How far each of its jobs is.
    """

    folder: Path
    paused: bool
    jobs: Sequence[JobReport]


@dataclass(frozen=True)
class JobEstimate:
    """How long a job will take, for machines.

    Attributes:
        name: Name of the job.
        seconds: How long it takes in all on one core of this machine [s].
    """

    name: str
    seconds: float


@dataclass(frozen=True)
class EstimateReport:
    """How long a study will take, for machines.

    Attributes:
        processor: Model of the processor that it was estimated for.
        workers: How many jobs run at a time.
        hours: How long the study takes with so many [h].
        jobs: How long each of its jobs takes.
    """

    processor: str
    workers: int
    hours: float
    jobs: Sequence[JobEstimate]


@dataclass(frozen=True)
class Study(OnWorkers):
    """Run a study: techniques x seeds x settings, and what is measured of them.

    For example `surefoot study smoke`, or with a JSON file of your own. The same command again
    goes on with a study that was interrupted. `surefoot study status NAME` shows how far it is,
    `surefoot study pause NAME` holds all its processes, and `surefoot study resume NAME` lets them
    go on.

    JSON keys: folder, paused, jobs [list; of each job its name, state (done, running, ready,
    waiting, failed) and seconds]. With --estimate: processor; workers and hours [with so many jobs
    at a time]; jobs [list; of each job its name, and seconds on one core].
    """

    words: Annotated[
        tuple[str, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="STUDY", help_behavior_hint="(required)"),
    ]
    """The study: paper, regimes, options, sensors, sensors-go2, sensors-default, smoke, a JSON
    file, or the folder of one that has begun; before it status, pause or resume. docs/studies.md
    has a file to begin with."""
    folder: Path | None = None
    """The folder of the study; without it, studies/NAME."""
    jobs: tuple[str, ...] = ()
    """Run these jobs only, with those that they need: names, or patterns such as '*--seed-0'."""
    estimate: bool = False
    """Only say how many jobs there are and how long they will take here, and run nothing; with
    --jobs, of these jobs and those that they need."""
    json: Path | None = None
    """Write how far the jobs are to this file, as JSON; with --estimate, how long they will
    take."""

    def __call__(self) -> int:
        """Do what the first word says."""
        from surefoot.study.state import pause_study, resume_study

        action, name = self._words()
        if action != "run" and (self.jobs or self.estimate):
            raise ValueError(
                f"study {action} is about all jobs and estimates nothing; leave out --jobs and "
                "--estimate"
            )
        folder = self._folder(name)
        check_outputs(self, [Output("--json", self.json)], new_study=folder)
        if action == "pause":
            pause_study(folder)
            print(f"paused; go on with `surefoot study resume {quote(str(folder))}`")
        elif action == "resume":
            resume_study(folder)
            print("its processes go on; if nobody runs it, start it again with `surefoot study`")
        elif action == "run":
            return self._run(name, folder)
        self._show(folder)
        return 0

    def _words(self) -> tuple[str, str]:
        """The action and the study."""
        words = list(self.words)
        action = words.pop(0) if words and words[0] in ACTIONS else "run"
        if len(words) != 1:
            raise ValueError(
                f"study needs the name of one study, and got {' '.join(words) or 'none'}; for "
                "example: surefoot study smoke"
            )
        return action, words[0]

    def _folder(self, name: str) -> Path:
        """The folder of the study."""
        from surefoot.study.layout import STUDY_FILE

        if self.folder is not None:
            return self.folder
        path = Path(name)
        is_a_path = len(path.parts) > 1 and not path.is_file()
        if is_a_path or (path / STUDY_FILE).is_file():
            return path
        return Path("studies") / (study_named(name).name if path.is_file() else name)

    def _run(self, name: str, folder: Path) -> int:
        """Run the study, after saying what there is to do."""
        from surefoot.study.estimate import estimate_study
        from surefoot.study.runner import needed_jobs, open_study, run_study
        from surefoot.study.state import job_statuses

        study = study_named(name)
        # A name that is wrong begins no study.
        jobs = needed_jobs(jobs_in(folder, study), self.jobs)
        if self.estimate:
            estimate = estimate_study(study, jobs)
            if self.json is not None:
                write_json(self.json, estimate_report(jobs, estimate, self.workers))
            print(describe_work(jobs, estimate, self.workers))
            return 0
        setup = open_study(folder, study)
        estimate = estimate_study(study, setup.jobs, folder)
        print(f"{study.title}, in {folder}: {describe_work(jobs, estimate, self.workers)}")
        names = {job.name for job in jobs}
        statuses = [status for status in job_statuses(folder) if status.job.name in names]
        print(describe_state(statuses, estimate, self.workers))
        outcome = run_study(folder, self.spread, self.jobs)
        self._show(folder)
        return 1 if outcome.failed else 0

    def _show(self, folder: Path) -> None:
        """Write how far the jobs are where asked, and print it."""
        from surefoot.study.estimate import read_estimate
        from surefoot.study.state import (
            LOG_FILE,
            is_paused,
            job_folder,
            job_statuses,
            workers_of,
        )

        statuses = job_statuses(folder)
        paused = is_paused(folder)
        if self.json is not None:
            jobs = [JobReport(s.job.name, s.state, s.seconds) for s in statuses]
            write_json(self.json, StudyProgress(folder, paused, jobs))
        workers = workers_of(folder) or self.workers
        estimate = read_estimate(folder, [status.job for status in statuses])
        print(describe_state(statuses, estimate, workers))
        where = quote(str(folder))
        if paused:
            print(f"paused: `surefoot study resume {where}` lets it go on")
        for status in statuses:
            if status.state == "failed":
                name = status.job.name
                log = job_folder(folder, name) / LOG_FILE
                print(f"{name} failed, see {log}; again: surefoot study {where} --jobs {name}")


def study_named(name: str) -> StudyConfig:
    """The study that a word of the command line means.

    Args:
        name: Name of a study of the package, a JSON file of a study or of its setup, or the folder
            of a study, or its name under ``studies``.

    Raises:
        ValueError: There is no such study, or its file cannot be read.
    """
    from surefoot.config.json_io import from_json, read_json
    from surefoot.config.studies import STUDIES, named_study
    from surefoot.config.study import StudyConfig
    from surefoot.study.folder import StudySetup, read_study
    from surefoot.study.layout import STUDY_FILE

    if name in STUDIES:
        return named_study(name)
    path = Path(name)
    for folder in (path, Path("studies") / path):
        if (folder / STUDY_FILE).is_file():
            return read_study(folder).study
    if not path.is_file():
        raise ValueError(f"{unknown('study', name, STUDIES)}; there is no such file either")
    try:
        values = read_json(path)
        if isinstance(values, dict) and "study" in values:
            return from_json(StudySetup, values).study
        return from_json(StudyConfig, values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def jobs_in(folder: Path, study: StudyConfig) -> Sequence[StudyJob]:
    """All jobs of a study: those with which it began in a folder, or else those of its presets.

    Args:
        folder: Folder of the study, which need not be there.
        study: The study.

    Raises:
        StudyError: The folder holds a study that cannot be read.
    """
    from surefoot.study.cells import jobs_of
    from surefoot.study.folder import read_study
    from surefoot.study.layout import STUDY_FILE

    if (folder / STUDY_FILE).is_file():
        setup = read_study(folder)
        if setup.study == study:
            return setup.jobs
    return jobs_of(study)


def estimate_report(jobs: Sequence[StudyJob], estimate: Estimate, workers: int) -> EstimateReport:
    """How long jobs of a study will take, for machines.

    Args:
        jobs: The jobs.
        estimate: The estimate.
        workers: How many jobs run at a time.
    """
    reports = [JobEstimate(job.name, estimate.seconds[job.name]) for job in jobs]
    return EstimateReport(estimate.processor, workers, hours_of(jobs, estimate, workers), reports)


def hours_of(jobs: Sequence[StudyJob], estimate: Estimate, workers: int) -> float:
    """How long jobs of a study take, with so many of them at a time [h]."""
    from surefoot.study.queue import wall_seconds

    return wall_seconds(jobs, estimate.seconds, workers) / 3600.0


def describe_work(jobs: Sequence[StudyJob], estimate: Estimate, workers: int) -> str:
    """How much there is to do, in a sentence."""
    on_one_core = duration_text(sum(estimate.seconds[job.name] for job in jobs))
    wall = duration_text(3600.0 * hours_of(jobs, estimate, workers))
    return (
        f"{len(jobs)} jobs, about {on_one_core} of a core of this machine, {wall} with {workers} "
        "at a time"
    )


def describe_state(statuses: Sequence[JobStatus], estimate: Estimate | None, workers: int) -> str:
    """How far a study is: counts, what is running, and how long it still takes."""
    count = Counter(status.state for status in statuses)
    order = ("done", "running", "ready", "waiting", "failed")
    parts = [f"{count[state]} {state}" for state in order if count[state]]
    lines = [f"{len(statuses)} jobs: {', '.join(parts)}"]
    lines += [f"  running: {s.job.name}" for s in statuses if s.state == "running"]
    if estimate is not None and count["done"] < len(statuses):
        left = estimate.left(statuses, workers)
        end = datetime.now() + timedelta(seconds=left)
        lines.append(f"about {duration_text(left)} left, until {end:%Y-%m-%d %H:%M}")
    return "\n".join(lines)
