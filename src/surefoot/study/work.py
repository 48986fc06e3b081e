"""What a job of a study does, in the process that does it: ``python -m surefoot.study.work``.

A job uses one process and one thread. It stops by itself after a while, at the end of a stage or of
a policy's measurement, and reports that it is not finished; when it is started again, it continues
there. A job that is killed loses what `surefoot train` would lose. Read `runner` for what starts
jobs.
"""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from surefoot.config import Backend, Config, IterativeConfig
from surefoot.config.study import EXPERT, Measurement, StudyConfig, measured_config
from surefoot.evaluation.imitation import imitation_error
from surefoot.evaluation.push import push_recovery
from surefoot.evaluation.robustness import evaluate
from surefoot.files import sha256_of
from surefoot.methods import METHODS
from surefoot.runs.first_stage import copy_first_stage
from surefoot.runs.metrics import StageRecord, Trained
from surefoot.runs.run import config_for, create, open_run
from surefoot.runs.stages import collect_data, train_policy
from surefoot.runs.versions import versions
from surefoot.study.cells import (
    Cell,
    StudyJob,
    find_job,
    measured_options,
    measurements_of,
)
from surefoot.study.folder import (
    JobRecord,
    PolicyTest,
    StudySetup,
    Tests,
    read_job,
    read_study,
    read_tests,
    run_config,
    run_folder,
    save_job,
    save_policy,
    save_run,
    save_tests,
    shared_folder,
)
from surefoot.study.state import claim_job
from surefoot.workers import Workers, end_with_the_parent

logger = logging.getLogger(__name__)

SLICE = 2400.0
"""How long a job works before it stops at the next opportunity, in processor time [s]. The longest
stage, a training on all frames of the paper's data, takes an hour, so no slice takes more than 100
minutes."""
UNFINISHED = 75
"""Exit status of a job that must be started again."""
PARENT = "SUREFOOT_PARENT"
"""Environment variable with the supervisor's process id."""
_PR_SET_PDEATHSIG = 1
ONE_WORKER = Workers(1)
"""Jobs run side by side, so each of them needs only one process."""


class SliceOver(Exception):  # noqa: N818  # not an error: the job goes on later
    """The time of a job's slice is over."""


@dataclass
class Slice:
    """The time for which a job works before it stops.

    Only processor time counts: a job that is paused, or waits for a core, does not work.

    Attributes:
        seconds: Length of the slice [s].
        began: Processor time of this process when the slice began [s].
        started: When the slice began, in UTC.
    """

    seconds: float
    began: float = field(default_factory=time.process_time)
    started: datetime = field(default_factory=lambda: datetime.now(UTC))

    @property
    def spent(self) -> float:
        """How long the job has worked [s]."""
        return time.process_time() - self.began

    def stop_if_over(self, _record: StageRecord | None = None) -> None:
        """End the job if its time is over; what it has done is on disk.

        Raises:
            SliceOver: The time is over.
        """
        if self.spent >= self.seconds:
            raise SliceOver


def do_job(folder: Path, name: str) -> bool:
    """Do a job of a study, or a slice of it.

    Args:
        folder: Folder of the study.
        name: Name of the job.

    Returns:
        Whether it is finished.

    Raises:
        StudyError: There is no study, or another process does the job.
        ValueError: There is no such job.
    """
    setup = read_study(folder)
    job = find_job(setup.jobs, name)
    claim_job(folder, name)
    piece = Slice(SLICE)
    finished = True
    try:
        if job.kind == "share":
            make_shared(folder, setup, job, piece)
        elif job.kind == "train":
            train_cell(folder, setup, job, piece)
        elif job.kind == "measure":
            measure_cell(folder, setup, job, piece)
        else:
            copy_tests(folder, setup, job)
    except SliceOver:
        finished = False
    save_job(folder, job.cell, job_record(folder, setup, job, piece, finished))
    return finished


def make_shared(folder: Path, setup: StudySetup, job: StudyJob, piece: Slice) -> None:
    """Make what several cells begin with: the first data, or also the first policy.

    Args:
        folder: Folder of the study.
        setup: The study.
        job: The job.
        piece: The slice of time that it has.
    """
    run = create(shared_folder(folder, job.name), run_config(setup, job.cell), resume=True)
    run.listeners.append(piece.stop_if_over)
    method = METHODS[run.method]
    collect_data(run, 0, method.collection(run, 0, None), ONE_WORKER)
    if job.shared == "policy":
        assert isinstance(run.config.method, IterativeConfig)
        train_policy(run, 0, run.config.method.first_training)


def train_cell(folder: Path, setup: StudySetup, job: StudyJob, piece: Slice) -> None:
    """Train the run of a cell, and keep its metrics and its best policy.

    Args:
        folder: Folder of the study.
        setup: The study.
        job: The job.
        piece: The slice of time that it has.
    """
    cell = job.cell
    run = create(run_folder(folder, cell), run_config(setup, cell), resume=True)
    for name in job.needs:
        assert job.shared is not None
        copy_first_stage(open_run(shared_folder(folder, name)), run, job.shared)
    run.listeners.append(piece.stop_if_over)
    try:
        METHODS[run.method].train(run, ONE_WORKER, None)
    finally:
        save_run(folder, cell, run)
    if setup.study.keep_policies == "best_of_run":
        save_policy(folder, cell, run)


def measure_cell(folder: Path, setup: StudySetup, job: StudyJob, piece: Slice) -> None:
    """Measure the policies of a cell, or the expert; each is kept as soon as it is measured.

    Args:
        folder: Folder of the study.
        setup: The study.
        job: The job.
        piece: The slice of time that it has.
    """
    cell = job.cell
    for name in measurements_of(setup.study, cell):
        measurement = setup.study.measurement(name)
        config = config_for(run_folder(folder, cell), run_config(setup, cell))
        config = measured_config(config, measurement)
        before = read_tests(folder, setup.study, cell, name)
        wanted = _policies_of(folder, setup.study, cell, measurement)
        done = () if before is None else before.policies
        if [each.sha256 for each in done] != [each.sha256 for each in wanted[: len(done)]]:
            logger.warning("%s: %s was measured of other policies; measured again", cell.name, name)
            done = ()
        asked = measured_options(setup.study, cell, name)
        for policy in wanted[len(done) :]:
            piece.stop_if_over()
            done = (*done, _measure(config, policy, measurement))
            finished = len(done) == len(wanted)
            save_tests(folder, cell, Tests(name, done, finished, asked))


def copy_tests(folder: Path, setup: StudySetup, job: StudyJob) -> None:
    """Copy what was measured of the same expert in another setting.

    Args:
        folder: Folder of the study.
        setup: The study.
        job: The job, which needs the one that measures.
    """
    [needed] = job.needs
    measured = find_job(setup.jobs, needed).cell
    for name in measurements_of(setup.study, job.cell):
        tests = read_tests(folder, setup.study, measured, name)
        assert tests is not None  # the job that measures it is done
        if tests.options is not None:  # an earlier version did not say them
            tests = replace(tests, options=measured_options(setup.study, job.cell, name))
        save_tests(folder, job.cell, tests)


@dataclass(frozen=True)
class MeasuredPolicy:
    """A policy to measure.

    Attributes:
        iteration: Iteration that trained it; 0 for the expert.
        frames: Number of frames that it was trained on; None for the expert.
        path: Its file; None for the expert.
    """

    iteration: int = 0
    frames: int | None = None
    path: Path | None = None

    @property
    def sha256(self) -> str | None:
        """SHA-256 of its file; None for the expert."""
        return None if self.path is None else sha256_of(self.path)


def _policies_of(
    folder: Path, study: StudyConfig, cell: Cell, measurement: Measurement
) -> list[MeasuredPolicy]:
    """The policies of a cell that a measurement covers, in the order of their iterations.

    Raises:
        RunError: The cell's run is lost, or not finished.
    """
    if study.technique(cell.technique).method == EXPERT:
        return [MeasuredPolicy()]
    run = open_run(run_folder(folder, cell))
    policies = []
    for record in run.metrics:
        if isinstance(record, Trained):
            path = run.policy_path(record.iteration)
            if measurement.policies == "all" or path == run.best_policy_path:
                policies.append(MeasuredPolicy(record.iteration, record.frames, path))
    return policies


def _measure(config: Config, policy: MeasuredPolicy, measurement: Measurement) -> PolicyTest:
    """Measure one policy, or the expert."""
    test = PolicyTest(policy.iteration, policy.frames, policy.sha256)
    if measurement.measure == "impulse":
        config = replace(config, push=replace(config.push, split=measurement.split))
        return replace(test, pushes=push_recovery(config, policy.path, ONE_WORKER))
    if measurement.measure == "imitation":
        assert policy.path is not None  # the expert does not deviate from itself
        return replace(test, imitation=imitation_error(config, policy.path, ONE_WORKER))
    robustness, _ = evaluate(config, policy.path, measurement.split, ONE_WORKER)
    return replace(test, robustness=robustness)


def job_record(
    folder: Path, setup: StudySetup, job: StudyJob, piece: Slice, finished: bool
) -> JobRecord:
    """The record of a job after one of its slices, with the time of earlier slices added.

    Args:
        folder: Folder of the study.
        setup: The study.
        job: The job.
        piece: The slice.
        finished: Whether the job is done.
    """
    config = run_config(setup, job.cell)
    now = versions(_simulator_of(setup.study, job, config))
    before = read_job(folder, job.cell, job.name)
    trains = job.kind == "train" or (job.kind == "share" and job.shared == "policy")
    record = JobRecord(
        job=job.name,
        commit=setup.commit,
        processors=(now["processor"],),
        versions=now,
        precision=config.training.precision if trains else "",
        started=piece.started.isoformat(timespec="seconds"),
        seconds=piece.spent,
        finished=finished,
    )
    if before is None:
        return record
    return replace(
        record,
        processors=tuple(dict.fromkeys((*before.processors, *record.processors))),
        started=before.started,
        seconds=before.seconds + record.seconds,
    )


def _simulator_of(study: StudyConfig, job: StudyJob, config: Config) -> Backend:
    """The simulator whose version a job's record has: PyBullet if anything in the job uses it.

    Args:
        study: The study.
        job: The job.
        config: The configuration of its cell's run.
    """
    used = [config]
    if job.kind == "measure":
        names = measurements_of(study, job.cell)
        used += [measured_config(config, study.measurement(name)) for name in names]
    return "bullet" if any(each.simulation.backend == "bullet" for each in used) else "mujoco"


def end_with_the_supervisor(parent: int) -> None:
    """Make this job end when its supervisor does, even while the job is suspended.

    Args:
        parent: Process id of the supervisor.
    """
    if sys.platform == "linux":
        # While a study is paused, no thread of a job can check on its supervisor. So the kernel
        # ends the job when the thread ends that started it and waits for it.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    end_with_the_parent(parent)


def main(arguments: Sequence[str]) -> int:
    """Do the job that the command line names, by its study's folder and its own name.

    Returns:
        0 if it is finished, 75 if it must be started again.
    """
    folder, name = arguments
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if PARENT in os.environ:
        end_with_the_supervisor(int(os.environ[PARENT]))
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(message)s", stream=sys.stdout)
    return 0 if do_job(Path(folder), name) else UNFINISHED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
