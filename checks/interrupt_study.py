"""Run the smoke study, kill it while a job works, and let the same command go on with it.

`make reproduce-smoke` runs it. The kill is a SIGKILL, which no process can prepare for, as a lost
machine is. The study has to be incomplete then, no job may go on alone, and in the end all jobs
have to be done. The report is made last.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

PATIENCE = 600.0
"""How long the study may take until it can be interrupted, and its jobs until they end [s]."""
POLL = 5.0
"""How often to look how far the study is [s]."""
SUREFOOT = (sys.executable, "-m", "surefoot")


def states_of(folder: Path) -> Counter[str]:
    """How many jobs of a study are in each state; none before it has begun."""
    if not (folder / "study.json").is_file():
        return Counter()
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "status.json"
        command = [*SUREFOOT, "study", "status", str(folder), "--json", str(file)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return Counter(job["state"] for job in json.loads(file.read_text())["jobs"])


def wait_for(
    folder: Path, condition: Callable[[Counter[str]], bool], study: subprocess.Popen[bytes] | None
) -> Counter[str]:
    """The states of a study's jobs, once they are as wanted.

    Args:
        folder: Folder of the study.
        condition: What is wanted of them.
        study: The process that runs the study, whose end is an end of the waiting; None if it has
            been killed.

    Raises:
        RuntimeError: The study ended, or too much time passed.
    """
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        states = states_of(folder)
        if condition(states):
            return states
        if study is not None and study.poll() is not None:
            raise RuntimeError(f"the study ended before it was interrupted: {dict(states)}")
        time.sleep(POLL)
    raise RuntimeError(f"after {PATIENCE:.0f} s the study is still no further: {dict(states)}")


def interrupt_study(folder: Path) -> None:
    """Run the smoke study in a folder, kill it on the way, go on, and report.

    Args:
        folder: Folder of the study; what it holds is deleted.

    Raises:
        RuntimeError: The study was not interrupted, or did not end after it.
        subprocess.CalledProcessError: A command failed.
    """
    shutil.rmtree(folder, ignore_errors=True)
    command = [*SUREFOOT, "study", "smoke", "--folder", str(folder)]
    study = subprocess.Popen(command, start_new_session=True)
    try:
        wait_for(folder, lambda states: states["done"] > 0 and states["running"] > 0, study)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(study.pid, signal.SIGKILL)
        study.wait()
    # Its jobs are in groups of their own, and end because it has.
    killed = wait_for(folder, lambda states: states["running"] == 0, None)
    print(f"killed: {dict(killed)}", flush=True)
    if killed["done"] == killed.total():
        raise RuntimeError("the study was complete before it was killed; nothing was interrupted")
    subprocess.run(command, check=True)
    ended = states_of(folder)
    if ended["done"] != ended.total():
        raise RuntimeError(f"the study went on and is not complete: {dict(ended)}")
    subprocess.run([*SUREFOOT, "report", str(folder)], check=True)


def main() -> int:
    """Interrupt the study that the command line names.

    Returns:
        0 if all is well.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the study, which is made anew")
    interrupt_study(parser.parse_args().folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
