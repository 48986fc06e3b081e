"""The folder of a study while it runs: who runs it, what is done, whether it is paused.

All of this is in files, so another terminal, or another machine of a cluster, sees the same: a lock
that only a living process holds, the records of the jobs, a file that marks the study as paused,
and a log for each job. Read `runner` next.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from surefoot.config.json_io import read_json
from surefoot.config.study import StudyConfig
from surefoot.files import is_locked, lock_file, write_atomic, write_json
from surefoot.study.cells import StudyJob, measurements_of
from surefoot.study.folder import (
    StudyError,
    read_job,
    read_study,
    read_tests,
    results_folder,
    run_folder,
    shared_folder,
)
from surefoot.study.layout import JOBS_FOLDER, LOCK_FILE, PAUSED_FILE, WORKERS_FILE

logger = logging.getLogger(__name__)

JobState = Literal["done", "running", "ready", "waiting", "failed"]
"""How far a job is: it waits until the jobs that it needs are done, then it is ready."""
LOG_FILE = "log.txt"
"""File with the output of a job's process."""
FAILED_FILE = "failed.txt"
"""File that exists if the job's last attempt failed, with the end of its output."""


@dataclass(frozen=True)
class JobStatus:
    """How far a job is.

    Attributes:
        job: The job.
        state: How far it is.
        seconds: Processor time of all its slices that have ended [s].
        processors: Models of the processors that these ran on.
    """

    job: StudyJob
    state: JobState
    seconds: float = 0.0
    processors: tuple[str, ...] = ()


def claim_study(folder: Path) -> None:
    """Keep other processes from running a study, until this one ends, however it ends.

    Args:
        folder: Folder of the study.

    Raises:
        StudyError: Another process runs it.
        WriteError: The folder cannot be written to.
    """
    if not lock_file(folder / LOCK_FILE):
        raise StudyError(
            f"another process runs the study in {folder}; `surefoot study status` shows how far "
            "it is"
        )


def say_workers(folder: Path, workers: int) -> None:
    """Record how many jobs the process that has claimed a study runs at a time.

    Raises:
        WriteError: The folder cannot be written to.
    """
    write_json(folder / WORKERS_FILE, workers)


def workers_of(folder: Path) -> int | None:
    """How many jobs at a time the process running a study does; None if no other process runs it.

    It is also None until that process has recorded the number (`say_workers`).
    """
    path = folder / WORKERS_FILE
    if not is_locked(folder / LOCK_FILE) or not path.exists():
        return None
    workers = read_json(path)
    return workers if type(workers) is int and workers > 0 else None


def claim_job(folder: Path, job: str) -> None:
    """Claim a job for this process, until the process ends.

    Raises:
        StudyError: Another process does it.
        WriteError: The folder cannot be written to.
    """
    if not lock_file(job_folder(folder, job) / LOCK_FILE):
        raise StudyError(f"another process does the job {job} of {folder}; wait for it")


def job_folder(folder: Path, job: str) -> Path:
    """Folder of a job's output."""
    return folder / JOBS_FOLDER / job


def pause_study(folder: Path) -> None:
    """Pause a study: its processes are suspended within a second, and keep their memory.

    Raises:
        StudyError: There is no study.
        WriteError: The folder cannot be written to.
    """
    read_study(folder)
    write_atomic(folder / PAUSED_FILE, b"")


def resume_study(folder: Path) -> None:
    """Let a paused study continue.

    Raises:
        StudyError: There is no study.
    """
    read_study(folder)
    (folder / PAUSED_FILE).unlink(missing_ok=True)


def is_paused(folder: Path) -> bool:
    """Whether a study is paused."""
    return (folder / PAUSED_FILE).is_file()


def job_statuses(folder: Path) -> tuple[JobStatus, ...]:
    """How far each job of a study is, in the study's order.

    A job whose files cannot be read, or are not what the study asks for, counts as failed, and a
    warning says what to do. The other jobs are shown all the same.

    Raises:
        StudyError: There is no study.
    """
    setup = read_study(folder)
    jobs = setup.jobs
    done: set[str] = set()
    refused: set[str] = set()
    for job in jobs:
        try:
            if _is_done(folder, setup.study, job):
                done.add(job.name)
        except StudyError as error:
            logger.warning("%s: %s", job.name, error)
            refused.add(job.name)
    # What a refused job needs must not be made again before someone has looked at its files.
    done = _with_their_folders(folder, jobs, done | refused) - refused
    return tuple(
        JobStatus(job, "failed") if job.name in refused else _status_of(folder, job, done)
        for job in jobs
    )


def _status_of(folder: Path, job: StudyJob, done: set[str]) -> JobStatus:
    """How far a job is, given the names of those that are done."""
    state = _state_of(folder, job, done)
    record = read_job(folder, job.cell, job.name)
    if record is None:
        return JobStatus(job, state)
    return JobStatus(job, state, record.seconds, record.processors)


def _state_of(folder: Path, job: StudyJob, done: set[str]) -> JobState:
    """How far a job is, given the names of those that are done."""
    if job.name in done:
        return "done"
    if is_locked(job_folder(folder, job.name) / LOCK_FILE):
        return "running"
    if (job_folder(folder, job.name) / FAILED_FILE).exists():
        return "failed"
    return "ready" if done.issuperset(job.needs) else "waiting"


def finished_jobs(folder: Path, study: StudyConfig, jobs: Sequence[StudyJob]) -> set[str]:
    """Names of the jobs that are done and whose files, if still needed, are there.

    On a new machine only the committed results are there: a missing run is made again if it has not
    been measured yet.

    Args:
        folder: Folder of the study.
        study: The study.
        jobs: The jobs, each after those that it needs.

    Raises:
        StudyError: A file cannot be read, or was measured with other options than the study has.
    """
    done = {job.name for job in jobs if _is_done(folder, study, job)}
    return _with_their_folders(folder, jobs, done)


def _is_done(folder: Path, study: StudyConfig, job: StudyJob) -> bool:
    """Whether a job is recorded as done, and everything that it was to measure is there.

    Raises:
        StudyError: A file cannot be read, or was measured with other options than the study has.
    """
    record = read_job(folder, job.cell, job.name)
    if record is None or not record.finished:
        return False
    if job.kind in ("share", "train"):
        return True
    # A file that was moved away is measured again, and so is what the study has asked for since.
    names = measurements_of(study, job.cell)
    measured = [read_tests(folder, study, job.cell, name) for name in names]
    return all(tests is not None and tests.finished for tests in measured)


def _with_their_folders(folder: Path, jobs: Sequence[StudyJob], done: set[str]) -> set[str]:
    """The done jobs whose folders are there, or are no longer needed."""
    done = set(done)
    for job in reversed(jobs):
        needed = any(job.name in other.needs and other.name not in done for other in jobs)
        if needed and not _made(folder, job).is_dir():
            done.discard(job.name)
    return done


def _made(folder: Path, job: StudyJob) -> Path:
    """The folder that a job makes for the jobs that need it."""
    if job.kind == "share":
        return shared_folder(folder, job.name)
    if job.kind == "train":
        return run_folder(folder, job.cell)
    return results_folder(folder, job.cell)
