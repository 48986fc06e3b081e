"""A job in a process of its own: how it ends, is held, and is ended. A tiny program is the job."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from surefoot.study.state import (
    FAILED_FILE,
    LOG_FILE,
    job_folder,
    pause_study,
    resume_study,
)
from surefoot.study.supervise import supervise
from tests.fakes.tiny_jobs import study_of_tiny_jobs, task


@pytest.fixture
def folder(tmp_path):
    return study_of_tiny_jobs(tmp_path)


def wait_for(condition):
    until = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)


@pytest.mark.parametrize(("job", "status"), [("ends", "finished"), ("later", "unfinished")])
def test_the_exit_status_says_how_a_job_ended_and_its_log_stays(folder, job, status):
    ended = supervise(task(folder, job))
    assert (ended.job, ended.status) == (job, status)
    assert (job_folder(folder, job) / LOG_FILE).read_text() == f"working on {job} 1\n"


def test_a_failed_job_leaves_the_end_of_its_log_until_it_is_tried_again(folder):
    ended = supervise(task(folder, "fails"))
    failed = job_folder(folder, "fails") / FAILED_FILE
    assert ended.status == "failed"
    assert "ValueError: no such thing" in ended.message
    assert "exit status 1" in ended.message
    assert failed.read_text() == ended.message
    (folder / "code" / "surefoot" / "study" / "work.py").write_text("print('fixed')")
    assert supervise(task(folder, "fails")).status == "finished"
    assert not failed.exists()


def state_of(pid):
    """The state of a process: S sleeps, T is stopped."""
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]


def test_a_job_is_held_while_the_study_is_paused_and_ends_when_it_is_stopped(folder):
    stop = threading.Event()
    results = []
    thread = threading.Thread(target=lambda: results.append(supervise(task(folder, "long"), stop)))
    thread.start()
    pid_file = folder / "pid"
    wait_for(lambda: pid_file.exists() and pid_file.read_text())
    pid = pid_file.read_text()
    pause_study(folder)
    wait_for(lambda: state_of(pid) == "T")
    resume_study(folder)
    wait_for(lambda: state_of(pid) == "S")
    pause_study(folder)
    wait_for(lambda: state_of(pid) == "T")
    stop.set()  # a job that is held can be ended too
    thread.join(20.0)
    assert [ended.status for ended in results] == ["stopped"]
    assert not Path(f"/proc/{pid}").exists()


SUPERVISOR = """
import os, subprocess, sys
job = [sys.executable, "-c", sys.argv[1]]
with subprocess.Popen(job, stdout=subprocess.PIPE, start_new_session=True) as process:
    process.stdout.readline()
    os.kill(process.pid, 19)
    print(process.pid, flush=True)
    process.wait()
"""
JOB = """
import os, time
from surefoot.study.work import end_with_the_supervisor
end_with_the_supervisor(os.getppid())
print("works", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a process that is held")
def test_a_job_that_is_held_ends_with_its_supervisor():
    command = [sys.executable, "-c", SUPERVISOR, JOB]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as supervisor:
        assert supervisor.stdout is not None
        pid = supervisor.stdout.readline().strip()
        wait_for(lambda: state_of(pid) == "T")
        supervisor.kill()
    # Whoever adopts it may not have asked for its exit status yet.
    wait_for(lambda: not Path(f"/proc/{pid}").exists() or state_of(pid) == "Z")
