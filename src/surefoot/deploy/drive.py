"""One drive: ticks until the robot is damped for good, and a report.

Read `recorder` for what is recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surefoot.deploy.loop import Runtime
from surefoot.deploy.real_time import without_pauses
from surefoot.deploy.recorder import save_flight
from surefoot.deploy.timing import Times
from surefoot.errors import HangUp, interrupts_held_back
from surefoot.files import WriteError, is_stream

LAST_WORDS = 20
"""Number of times a robot is told to damp its joints, since datagrams may be lost."""


@dataclass(frozen=True)
class DriveReport:
    """What happened on a robot.

    Attributes:
        fault: The name of the fault that ended the drive; empty if the operator ended it.
        detail: What was measured, and what is allowed.
        seconds: How long the policy or the expert drove [s].
        expert_seconds: How long the expert drove [s].
        takeovers: How often the expert took over.
        ticks: How many ticks there were, those before and after driving included.
        missed: How many ticks of the robot had no command in time.
        work: Times from a measurement to the written command.
        round_trip: Times from a command to the state that answers it.
        recording: The file with the last ten seconds; empty if none was written.
        unwritten: Why that file could not be written; empty if it was, or need not be.
    """

    fault: str
    detail: str
    seconds: float
    expert_seconds: float
    takeovers: int
    ticks: int
    missed: int
    work: Times
    round_trip: Times
    recording: str
    unwritten: str = ""


def drive(runtime: Runtime, recording: Path | None, always: bool = False) -> DriveReport:
    """Tick until the robot is damped for good; an interrupt damps it, too.

    Args:
        runtime: The loop.
        recording: The file for the last ten seconds, which are written after a fault; if it
            exists, the first of NAME-2, NAME-3, ... that does not. None writes none.
        always: Whether they are also written without a fault.

    Returns:
        What happened, and why the recording could not be written, if so.
    """
    try:
        with without_pauses():
            while not runtime.over:
                runtime.tick()
    except HangUp:
        runtime.lose("the terminal has been closed")
    except KeyboardInterrupt:
        runtime.stop()
    finally:
        with interrupts_held_back():
            for _ in range(LAST_WORDS):
                runtime.damp()
    # The drive is over; a Ctrl-C that comes now would only destroy the recording.
    with interrupts_held_back():
        return _recorded(runtime, recording, always)


def _recorded(runtime: Runtime, recording: Path | None, always: bool) -> DriveReport:
    """Write the recording of a drive that has ended, and report; the arguments are `drive`'s."""
    if recording is None or not (always or runtime.fault is not None):
        return report_of(runtime)
    file = unused(recording)
    report = report_of(runtime, str(file))
    try:
        save_flight(file, runtime.recorder.flight(report.fault, report.detail))
    except WriteError as error:  # the reason for the fault must not be lost with the recording
        return report_of(runtime, unwritten=str(error))
    return report


def unused(path: Path) -> Path:
    """A path without a file: this one, or the first of NAME-2, NAME-3, ... that is free.

    Args:
        path: The path; a device or a pipe is taken as it is.
    """
    free = path
    number = 1
    while free.exists() and not is_stream(free):
        number += 1
        free = path.with_stem(f"{path.stem}-{number}")
    return free


def report_of(runtime: Runtime, recording: str = "", unwritten: str = "") -> DriveReport:
    """The report of a drive.

    Args:
        runtime: The loop, which has ended.
        recording: The file with the last ten seconds.
        unwritten: Why that file could not be written.
    """
    fault = runtime.fault
    return DriveReport(
        fault="" if fault is None else fault.kind,
        detail="" if fault is None else fault.detail,
        seconds=runtime.drivers.driven / runtime.recorder.rate_hz,
        expert_seconds=runtime.drivers.expert_ticks / runtime.recorder.rate_hz,
        takeovers=runtime.drivers.takeovers,
        ticks=runtime.ticks,
        missed=runtime.deadlines.missed,
        work=runtime.work.times,
        round_trip=runtime.round_trips.times,
        recording=recording,
        unwritten=unwritten,
    )
