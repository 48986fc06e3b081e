"""One job of a study in its own process: started, suspended while the study is paused, ended.

The process runs the study's own code and writes to the job's log. It leads a process group, so it
can be suspended and ended together with everything that it started. It ends when its supervisor
does. `runner` uses this on its own machine or, through Ray, on another one that sees the same
folder.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from surefoot.files import write_atomic
from surefoot.study.state import FAILED_FILE, LOG_FILE, is_paused, job_folder
from surefoot.study.work import PARENT, UNFINISHED
from surefoot.workers import ONE_THREAD

POLL = 0.5
"""Interval at which a supervisor checks whether the study is paused or stopped [s]."""
PATIENCE = 10.0
"""How long a process may take to end by itself [s]."""
TAIL = 30
"""How many lines of a failed job's log are shown."""


@dataclass(frozen=True)
class Task:
    """A job to supervise.

    Attributes:
        folder: Folder of the study.
        job: Name of the job.
        code: Folder from which the package is imported; None for the installed package.
    """

    folder: Path
    job: str
    code: Path | None


@dataclass(frozen=True)
class Ended:
    """How a job's process ended.

    Attributes:
        job: Name of the job.
        status: ``finished``, ``unfinished`` if it is to be started again, ``failed``, ``stopped``
            by the supervisor, or ``lost`` with its supervisor.
        message: The end of its log if it failed, or how it was lost.
    """

    job: str
    status: Literal["finished", "unfinished", "failed", "stopped", "lost"]
    message: str = ""


def supervise(task: Task, stop: threading.Event | None = None) -> Ended:
    """Do a job, or a slice of it, in a separate process, and wait for that to end.

    Args:
        task: The job.
        stop: Ends the process once it is set; what it has finished is on disk.
    """
    folder = job_folder(task.folder, task.job)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FAILED_FILE).unlink(missing_ok=True)
    with (folder / LOG_FILE).open("ab") as log:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "surefoot.study.work", str(task.folder), task.job],
            env=_environment(task),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        status = _wait(process, task.folder, stop)
    except BaseException:
        _end(process)
        raise
    if status is None:
        return Ended(task.job, "stopped")
    if status == 0:
        return Ended(task.job, "finished")
    if status == UNFINISHED:
        return Ended(task.job, "unfinished")
    message = _end_of_log(folder / LOG_FILE, status)
    write_atomic(folder / FAILED_FILE, message.encode())
    return Ended(task.job, "failed", message)


def _environment(task: Task) -> dict[str, str]:
    """The environment of a job's process."""
    environment = os.environ | ONE_THREAD | {PARENT: str(os.getpid())}
    if task.code is not None:
        environment["PYTHONPATH"] = str(task.code)
    return environment


def _wait(
    process: subprocess.Popen[bytes], folder: Path, stop: threading.Event | None
) -> int | None:
    """Wait until a process ends, and suspend it while its study is paused.

    Returns:
        Its exit status, or None if it was stopped.
    """
    held = False
    while True:
        try:
            return process.wait(POLL)
        except subprocess.TimeoutExpired:
            pass
        if stop is not None and stop.is_set():
            _end(process)
            return None
        if is_paused(folder) != held:
            held = not held
            _signal(process, signal.SIGSTOP if held else signal.SIGCONT)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ask a process and all that it started to end; kill them if it has not within some seconds."""
    _signal(process, signal.SIGCONT)
    _signal(process, signal.SIGTERM)
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        _signal(process, signal.SIGKILL)
        process.wait()


def _signal(process: subprocess.Popen[bytes], number: signal.Signals) -> None:
    """Send a signal to all processes of a job."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, number)


def _end_of_log(path: Path, status: int) -> str:
    """The end of a failed job's log."""
    lines = path.read_text(errors="replace").splitlines()
    reason = f"exit status {status}" if status > 0 else f"signal {-status}"
    return "\n".join([*lines[-TAIL:], f"({reason}; the whole log: {path})"])
