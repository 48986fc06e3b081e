"""Runs the jobs of a study, several at a time, each after those that it needs.

The folder has the whole state of a study; this module only starts the jobs that are ready, and
waits. After a kill, the same command continues the study. A failed job blocks only the jobs that
need it. Read `cells` for the jobs, `queue` for their order, `state` for their progress, `supervise`
for how one is run.
"""

from __future__ import annotations

import fnmatch
import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from surefoot.config import Config
from surefoot.config.json_io import changes
from surefoot.config.learning import NumberFormat
from surefoot.config.study import EXPERT, Measurement, StudyConfig, config_of, measured_config
from surefoot.errors import unknown
from surefoot.evaluation.push import pushed_starts
from surefoot.runs.checks import check_config
from surefoot.runs.precision import choose_for_run
from surefoot.runs.versions import versions
from surefoot.scenarios.gaits import all_starts_of
from surefoot.scenarios.prepare import completed
from surefoot.scenarios.starts import starts_of
from surefoot.study.cells import StudyJob, beginnings_of, trained_configs
from surefoot.study.checkout import check_out, checkout_root, clean_commit
from surefoot.study.folder import StudyError, StudySetup, read_study, save_setup
from surefoot.study.layout import STUDY_FILE
from surefoot.study.pools import make_pool
from surefoot.study.queue import JobQueue
from surefoot.study.state import claim_study, finished_jobs, is_paused, say_workers
from surefoot.study.supervise import Ended, Task
from surefoot.workers import Workers

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class StudyOutcome:
    """How far a study has come.

    Attributes:
        jobs: Number of its jobs.
        done: Number of jobs that are done.
        failed: The jobs that failed, with the end of their logs.
    """

    jobs: int
    done: int
    failed: tuple[Ended, ...]


def open_study(folder: Path, study: StudyConfig) -> StudySetup:
    """Begin a study in a folder, or continue the one that is there.

    Args:
        folder: Folder of the study, new or with the same study.
        study: The study.

    Raises:
        StudyError: The folder holds another study, another process is starting one there, the code
            has uncommitted changes, a cell could not be run or measured here, or the networks would
            be trained in several precisions.
        WriteError: The folder cannot be written to.
    """
    if (folder / STUDY_FILE).exists():
        setup = read_study(folder)
        if setup.study != study:
            names = sorted({name.split(".")[0] for name, _, _ in changes(study, setup.study)})
            raise StudyError(
                f"{folder} holds a study with other {', '.join(names)}. A study is not changed "
                "after it has begun: run the changed one in another folder (--folder), or go on "
                f"with this one by `surefoot study {folder}`"
            )
        return setup
    check_cells(study)
    claim_study(folder)
    if (folder / STUDY_FILE).exists():  # another process has begun it in the meantime, and ended
        return open_study(folder, study)
    root = checkout_root()
    commit = None if root is None else clean_commit(root)
    precision = measured_precision(study)
    check_precisions(study, precision)
    begins = beginnings_of(study)
    setup = StudySetup(study, commit, versions()["surefoot"], precision, begins)
    save_setup(folder, setup)
    return setup


def check_cells(study: StudyConfig) -> None:
    """Check that every technique can be trained and measured under every setting, before any work.

    Raises:
        StudyError: One cannot; the message names it, the option, and the values it may have.
    """
    for part in (*study.techniques, *study.settings):
        if "seed" in part.options:
            raise StudyError(
                f"{part.section}.{part.name}: the option seed would be ignored, because a study's "
                "seeds are its `seeds`; leave it out, and name the seeds there"
            )
    for technique in study.techniques:
        for setting in study.settings:
            where = f"{technique.name} in the setting {setting.name}"
            try:
                config = completed(config_of(technique, setting))
                if technique.method != EXPERT:
                    check_config(config)
                for measurement in study.measurements:
                    where = f"{technique.name} in the setting {setting.name}, {measurement.name}"
                    check_measured(measured_config(config, measurement), measurement)
            except ValueError as error:
                raise StudyError(f"{where}: {error}") from error


def check_measured(config: Config, measurement: Measurement) -> None:
    """Check that there are enough initial states for a measurement.

    Args:
        config: The configuration under which a policy is measured.
        measurement: The measurement.

    Raises:
        ValueError: There are too few.
    """
    if measurement.measure == "robustness":
        all_starts_of(config).first(measurement.split, config.evaluation.episodes)
    elif measurement.measure == "impulse":
        pushed_starts(replace(config.push, split=measurement.split), starts_of(config))


def measured_precision(study: StudyConfig) -> NumberFormat:
    """The faster precision for a study's networks, measured on the first cell with `auto`."""
    for config in trained_configs(study).values():
        if config.training.precision == "auto":
            return choose_for_run(config).chosen
    return "float32"


def check_precisions(study: StudyConfig, measured: NumberFormat) -> None:
    """Check that all networks of a study train in one precision, or its report would refuse them.

    Args:
        study: The study.
        measured: The precision of those with `auto`.

    Raises:
        StudyError: They train in several.
    """
    techniques: dict[str, dict[str, None]] = {}
    for cell, config in trained_configs(study).items():
        precision = config.training.precision
        precision = measured if precision == "auto" else precision
        techniques.setdefault(precision, {})[cell.technique] = None
    if len(techniques) > 1:
        listed = "; ".join(f"{name}: {', '.join(each)}" for name, each in techniques.items())
        raise StudyError(
            f"the networks of {study.name} would train in several precisions ({listed}), which "
            "must not stand in one table: give the option training.precision one value everywhere"
        )


def run_study(folder: Path, workers: Workers, only: Sequence[str] = ()) -> StudyOutcome:
    """Run all jobs of a study that are not done yet.

    Args:
        folder: Folder of the study.
        workers: How many jobs run at a time, and where.
        only: Names, or shell patterns of names, of the jobs to run, together with the jobs that
            they need; empty runs all.

    Raises:
        StudyError: There is no study, another process runs it, or its code is not available.
        ValueError: No job has such a name.
    """
    folder = folder.resolve()
    setup = read_study(folder)
    claim_study(folder)
    jobs = needed_jobs(setup.jobs, only)
    queue = JobQueue(jobs, finished_jobs(folder, setup.study, jobs))
    code = code_of(folder, setup)
    pool = make_pool(workers)
    say_workers(folder, pool.count)
    if is_paused(folder):
        logger.warning("it is paused; `surefoot study resume %s` lets its jobs go on", folder)
    try:
        while True:
            while pool.has_room and (job := queue.take()) is not None:
                pool.start(Task(folder, job.name, code))
                logger.info("%s: started", job.name)
            if not queue.running:
                break
            for ended in pool.ended():
                ended = queue.give_back(ended)
                logger.info(
                    "%s: %s; %d of %d jobs are done",
                    ended.job,
                    ended.status,
                    len(queue.done),
                    len(jobs),
                )
                if ended.message:
                    logger.warning("%s", ended.message)
    finally:
        pool.stop()
    return StudyOutcome(len(jobs), len(queue.done), tuple(queue.failed))


def code_of(folder: Path, setup: StudySetup) -> Path | None:
    """The folder from which a study's jobs import the package; None for the installed package.

    Raises:
        StudyError: The study was begun in a checkout, and this package is not in one.
    """
    if setup.commit is None:
        return None
    root = checkout_root()
    if root is None:
        raise StudyError(
            f"{folder} runs the commit {setup.commit}: go on with it from a git checkout of "
            "surefoot that has this commit"
        )
    return check_out(root, setup.commit, folder)


def needed_jobs(jobs: Sequence[StudyJob], patterns: Sequence[str]) -> tuple[StudyJob, ...]:
    """The jobs whose names match, and all those that they need, in the order of the study.

    Args:
        jobs: All jobs of the study, each after those that it needs.
        patterns: Names of jobs, or shell patterns of names such as ``*--seed-0``; empty means all
            jobs.

    Raises:
        ValueError: No job has such a name.
    """
    if not patterns:
        return tuple(jobs)
    names = [job.name for job in jobs]
    needed: set[str] = set()
    for pattern in patterns:
        matching = fnmatch.filter(names, pattern)
        if not matching:
            raise ValueError(unknown("job", pattern, names))
        needed.update(matching)
    # A job comes after those that it needs.
    for job in reversed(jobs):
        if job.name in needed:
            needed.update(job.needs)
    return tuple(job for job in jobs if job.name in needed)
