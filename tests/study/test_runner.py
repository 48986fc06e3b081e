"""Running a study: order, failures, resuming. Jobs that only sleep stand in for real ones."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.config.studies import STUDIES, named_study
from surefoot.config.study import Measurement, StudyConfig, Technique
from surefoot.study import runner
from surefoot.study.cells import cells_of, find_job, jobs_of
from surefoot.study.folder import (
    JobRecord,
    StudyError,
    StudySetup,
    Tests,
    read_study,
    results_folder,
    run_folder,
    save_job,
    save_setup,
    save_tests,
    shared_folder,
)
from surefoot.study.queue import JobQueue
from surefoot.study.runner import needed_jobs, open_study, run_study
from surefoot.study.state import FAILED_FILE, LOG_FILE, job_folder, job_statuses, pause_study
from surefoot.study.supervise import Ended, Task
from surefoot.workers import Workers

STUDY = StudyConfig(
    name="mine",
    title="My study",
    techniques=(
        Technique("safe", "LocoSafeDAGGER", "loco_safe_dagger"),
        Technique("loco", "LocoDAGGER", "loco_dagger"),
    ),
    measurements=(Measurement("test", "test"),),
    seeds=(0,),
)
SHARED, SAFE, TEST_SAFE, LOCO, TEST_LOCO = (job.name for job in jobs_of(STUDY))


class FakePool:
    """Ends each job at once, in the way that the test says; two run at a time."""

    def __init__(self, folder: Path, ends: dict[str, list[str]]) -> None:
        self.folder = folder
        self.ends = ends
        self.running: list[str] = []
        self.started: list[str] = []
        self.stopped = False
        self.count = 2

    @property
    def has_room(self) -> bool:
        return len(self.running) < 2

    def start(self, task: Task) -> None:
        self.running.append(task.job)
        self.started.append(task.job)

    def ended(self) -> list[Ended]:
        name = self.running.pop(0)
        status = self.ends.get(name, ["finished"]).pop(0)
        if status == "finished":
            finish(self.folder, name)
        return [Ended(name, status)]  # type: ignore[arg-type]

    def stop(self) -> None:
        self.stopped = True


def finish(folder: Path, name: str) -> None:
    """Leave what a finished job leaves."""
    job = find_job(jobs_of(STUDY), name)
    made = shared_folder(folder, name) if job.kind == "share" else run_folder(folder, job.cell)
    made.mkdir(parents=True, exist_ok=True)
    record = JobRecord(name, "c0ffee", ("a processor",), {}, "float32", "2026", 1.0, True)
    save_job(folder, job.cell, record)
    if job.kind == "measure":
        for measurement in STUDY.measurements:
            save_tests(folder, job.cell, Tests(measurement.name, (), True))


@pytest.fixture
def study_folder(tmp_path, monkeypatch):
    save_setup(tmp_path, StudySetup(STUDY, None, "0", "float32"))
    monkeypatch.setattr(runner, "claim_study", lambda folder: None)
    return tmp_path


def run(folder, monkeypatch, ends=None, only=()):
    pool = FakePool(folder, ends or {})
    monkeypatch.setattr(runner, "make_pool", lambda workers: pool)
    outcome = run_study(folder, Workers(2), only)
    return pool, outcome


def test_jobs_run_once_each_and_after_those_that_they_need(study_folder, monkeypatch):
    pool, outcome = run(study_folder, monkeypatch)
    assert sorted(pool.started) == sorted([SHARED, SAFE, TEST_SAFE, LOCO, TEST_LOCO])
    assert pool.started[0] == SHARED
    assert pool.started.index(TEST_SAFE) > pool.started.index(SAFE)
    assert (outcome.jobs, outcome.done, outcome.failed) == (5, 5, ())
    assert pool.stopped


def test_a_study_that_was_interrupted_goes_on_with_what_is_left(study_folder, monkeypatch):
    finish(study_folder, SHARED)
    finish(study_folder, SAFE)
    pool, outcome = run(study_folder, monkeypatch)
    assert sorted(pool.started) == sorted([TEST_SAFE, LOCO, TEST_LOCO])
    assert outcome.done == 5


def test_a_failed_job_stops_only_those_that_need_it(study_folder, monkeypatch):
    pool, outcome = run(study_folder, monkeypatch, {SAFE: ["failed"]})
    assert TEST_SAFE not in pool.started
    assert TEST_LOCO in pool.started
    assert [ended.job for ended in outcome.failed] == [SAFE]
    assert outcome.done == 3


def test_a_job_whose_slice_is_over_is_started_again(study_folder, monkeypatch):
    ends = {LOCO: ["unfinished", "unfinished", "finished"]}
    pool, outcome = run(study_folder, monkeypatch, ends)
    assert pool.started.count(LOCO) == 3
    assert outcome.done == 5


def test_a_job_that_is_lost_with_its_machine_is_started_again(study_folder, monkeypatch):
    pool, outcome = run(study_folder, monkeypatch, {LOCO: ["lost", "lost", "finished"]})
    assert pool.started.count(LOCO) == 3
    assert (outcome.done, outcome.failed) == (5, ())


def test_a_job_that_is_lost_again_and_again_fails(study_folder, monkeypatch, caplog):
    pool, outcome = run(study_folder, monkeypatch, {LOCO: ["lost"] * 5})
    assert pool.started.count(LOCO) == 3
    assert TEST_LOCO not in pool.started
    assert [ended.job for ended in outcome.failed] == [LOCO]
    assert f"{LOCO} was lost 3 times in a row" in caplog.text


def test_losses_count_only_in_a_row(study_folder, monkeypatch):
    ends = ["lost", "lost", "unfinished", "lost", "lost", "finished"]
    _, outcome = run(study_folder, monkeypatch, {LOCO: ends})
    assert (outcome.done, outcome.failed) == (5, ())


def test_a_study_that_is_paused_says_so_when_it_is_started(study_folder, monkeypatch, caplog):
    pause_study(study_folder)
    run(study_folder, monkeypatch)
    assert f"surefoot study resume {study_folder}" in caplog.text


def test_one_job_can_be_run_alone_with_what_it_needs(study_folder, monkeypatch):
    pool, outcome = run(study_folder, monkeypatch, only=[TEST_LOCO])
    assert (outcome.jobs, outcome.done) == (3, 3)
    assert pool.started == [SHARED, LOCO, TEST_LOCO]


def test_jobs_are_named_by_patterns_and_keep_the_order_of_the_study():
    names = [job.name for job in needed_jobs(jobs_of(STUDY), [TEST_LOCO, "measure--*"])]
    assert names == [job.name for job in jobs_of(STUDY)]
    assert [job.name for job in needed_jobs(jobs_of(STUDY), [LOCO])] == [SHARED, LOCO]


def test_a_pattern_that_no_job_has_is_refused():
    with pytest.raises(ValueError, match=r"no job 'mesure--\*'; did you mean 'measure--"):
        needed_jobs(jobs_of(STUDY), ["train--*", "mesure--*"])


def test_a_run_that_is_lost_is_made_again_only_if_it_was_not_measured(study_folder, monkeypatch):
    """On a new machine there are the committed results, and no runs."""
    for name in (SHARED, SAFE, TEST_SAFE, LOCO):
        finish(study_folder, name)
    for cell in cells_of(STUDY):
        run_folder(study_folder, cell).rmdir()
    shared_folder(study_folder, SHARED).rmdir()
    pool, _ = run(study_folder, monkeypatch)
    assert pool.started == [SHARED, LOCO, TEST_LOCO]


def measured_file(folder: Path, name: str) -> Path:
    """What was measured by a job."""
    measurement = STUDY.measurements[0].name
    return (
        results_folder(folder, find_job(jobs_of(STUDY), name).cell)
        / "tests"
        / f"{measurement}.json"
    )


def test_what_was_moved_away_is_measured_again(study_folder, monkeypatch):
    for name in (SHARED, SAFE, TEST_SAFE, LOCO, TEST_LOCO):
        finish(study_folder, name)
    measured_file(study_folder, TEST_SAFE).unlink()
    pool, _ = run(study_folder, monkeypatch)
    assert pool.started == [TEST_SAFE]


def test_one_damaged_file_does_not_hide_the_other_jobs(study_folder, caplog):
    for name in (SHARED, SAFE, TEST_SAFE, LOCO):
        finish(study_folder, name)
    run_folder(study_folder, find_job(jobs_of(STUDY), SAFE).cell).rmdir()
    damaged = measured_file(study_folder, TEST_SAFE)
    damaged.write_text("{")
    states = {status.job.name: status.state for status in job_statuses(study_folder)}
    assert states == {
        SHARED: "done",
        SAFE: "done",  # what needs it is there
        TEST_SAFE: "failed",
        LOCO: "done",
        TEST_LOCO: "ready",
    }
    assert str(damaged) in caplog.text


def test_workers_are_stopped_when_a_study_is_interrupted(study_folder, monkeypatch):
    pool = FakePool(study_folder, {})
    monkeypatch.setattr(pool, "ended", lambda: (_ for _ in ()).throw(KeyboardInterrupt))
    monkeypatch.setattr(runner, "make_pool", lambda workers: pool)
    with pytest.raises(KeyboardInterrupt):
        run_study(study_folder, Workers(2))
    assert pool.stopped


def test_the_state_of_every_job_is_shown(study_folder):
    finish(study_folder, SHARED)
    failed = job_folder(study_folder, SAFE)
    failed.mkdir(parents=True)
    (failed / LOG_FILE).write_text("no such thing")
    (failed / FAILED_FILE).write_text("no such thing")
    states = {status.job.name: status.state for status in job_statuses(study_folder)}
    assert states == {
        SHARED: "done",
        SAFE: "failed",
        TEST_SAFE: "waiting",
        LOCO: "ready",
        TEST_LOCO: "waiting",
    }


def test_a_queue_gives_a_stopped_job_out_again():
    queue = JobQueue(jobs_of(STUDY), {SHARED})
    first = queue.take()
    assert first is not None and first.name == SAFE
    queue.give_back(Ended(SAFE, "stopped"))
    again = queue.take()
    assert again is not None and again.name == SAFE


def test_a_study_that_was_changed_after_it_began_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "checkout_root", lambda: None)
    open_study(tmp_path, STUDY)
    open_study(tmp_path, STUDY)
    with pytest.raises(StudyError, match="other seeds, title"):
        open_study(tmp_path, replace(STUDY, seeds=(0, 1), title="Another"))
    assert read_study(tmp_path).study == STUDY


BEGIN = """
import sys
from pathlib import Path
from surefoot.study import runner
from tests.study.test_runner import STUDY

def measured(study):
    print("claimed", flush=True)
    sys.stdin.read()
    return "float32"

runner.measured_precision = measured
runner.checkout_root = lambda: None
runner.open_study(Path(sys.argv[1]), STUDY)
"""


def test_of_two_processes_that_begin_a_study_the_second_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "checkout_root", lambda: None)
    command = [sys.executable, "-c", BEGIN, str(tmp_path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as first:
        assert first.stdout is not None and first.stdin is not None
        assert first.stdout.readline() == "claimed\n"
        with pytest.raises(StudyError, match="another process runs the study"):
            open_study(tmp_path, replace(STUDY, title="Another"))
        first.stdin.close()
    assert first.returncode == 0
    assert read_study(tmp_path).study == STUDY


@pytest.mark.parametrize(
    "other", [{"preset": "paper"}, {"options": {"training.precision": "float32"}}]
)
def test_a_study_whose_report_would_be_refused_for_its_precisions_does_not_begin(
    tmp_path, monkeypatch, other
):
    monkeypatch.setattr(runner, "checkout_root", lambda: None)
    monkeypatch.setattr(runner, "measured_precision", lambda study: "bfloat16")
    techniques = (STUDY.techniques[0], replace(STUDY.techniques[1], **other))
    study = replace(STUDY, techniques=techniques)
    told = r"mine would train in several precisions \(bfloat16: safe; float32: loco\)"
    with pytest.raises(StudyError, match=told):
        open_study(tmp_path, study)
    with pytest.raises(StudyError, match="holds no study"):
        read_study(tmp_path)
    monkeypatch.setattr(runner, "measured_precision", lambda study: "float32")
    assert open_study(tmp_path, study).precision == "float32"


@pytest.mark.parametrize("part", ["techniques", "settings"])
def test_a_seed_that_would_be_ignored_is_refused_before_any_work(part):
    study = named_study("smoke")
    first, *others = getattr(study, part)
    seeded = replace(first, options={**first.options, "seed": 7})
    study = replace(study, **{part: (seeded, *others)})
    with pytest.raises(StudyError, match=rf"{part}\.{first.name}: the option seed would be ign"):
        runner.check_cells(study)


def test_a_cell_that_could_not_be_run_is_refused_before_any_work(tmp_path):
    greedy = replace(STUDY.techniques[0], options={"method.velocities": 999})
    study = replace(STUDY, techniques=(greedy, STUDY.techniques[1]))
    with pytest.raises(StudyError, match=r"safe in the setting all: method\.velocities is 999"):
        open_study(tmp_path / "new", study)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("measure", "options", "message"),
    [
        ("robustness", {"evaluation.episodes": 50_000}, "50000 episodes asked for"),
        ("impulse", {"push.speeds": 999}, "999 velocities asked for"),
    ],
)
def test_a_measurement_that_could_not_be_made_is_refused_before_any_work(
    tmp_path, measure, options, message
):
    asked = Measurement("test", "test", measure, options=options)
    expert = Technique("expert", "expert", "expert")
    for technique in (STUDY.techniques[0], expert):
        study = replace(STUDY, techniques=(technique,), measurements=(asked,))
        told = f"{technique.name} in the setting all, test: {message}"
        with pytest.raises(StudyError, match=told):
            open_study(tmp_path / "new", study)
    assert not (tmp_path / "new").exists()


@pytest.mark.thorough
@pytest.mark.parametrize("name", STUDIES)
def test_every_cell_of_a_packaged_study_can_be_run(name):
    runner.check_cells(named_study(name))


def test_a_folder_without_a_study_is_refused(tmp_path):
    with pytest.raises(StudyError, match="holds no study"):
        run_study(tmp_path, Workers(1))
