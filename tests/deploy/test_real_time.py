"""Priority and memory of the process that drives a robot."""

import mmap
import os
import re
from pathlib import Path
from typing import Any

import pytest

from surefoot.deploy import real_time
from surefoot.deploy.real_time import PRIORITY, beside_real_time, take_real_time_priority


@pytest.fixture
def asked(monkeypatch) -> list[tuple[int, int] | str]:
    """What the system is asked for: policies with their priorities, and to lock memory or not."""
    asked: list[tuple[int, int] | str] = []

    def scheduler(process: int, policy: int, parameters: Any) -> None:
        asked.append((policy, parameters.sched_priority))

    monkeypatch.setattr(os, "sched_setscheduler", scheduler)
    monkeypatch.setattr(real_time, "lock_memory", lambda: asked.append("lock"))
    monkeypatch.setattr(real_time, "unlock_memory", lambda: asked.append("unlock"))
    return asked


@pytest.mark.skipif(not hasattr(os, "SCHED_FIFO"), reason="no real-time priorities here")
def test_who_shares_python_with_the_thread_that_drives_goes_right_after_it(asked):
    take_real_time_priority()
    with pytest.raises(KeyboardInterrupt), beside_real_time():
        raise KeyboardInterrupt
    assert asked == [
        (os.SCHED_FIFO, PRIORITY),
        "lock",
        (os.SCHED_FIFO, PRIORITY - 1),
        "lock",
        (os.SCHED_OTHER, 0),
        "unlock",
    ]


@pytest.mark.skipif(not hasattr(os, "SCHED_FIFO"), reason="no real-time priorities here")
def test_without_the_right_to_it_there_is_a_warning_and_no_error(monkeypatch, caplog):
    def refused(*arguments: object) -> None:
        raise PermissionError("not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    monkeypatch.setattr(real_time, "lock_memory", refused)
    with beside_real_time():
        pass
    assert "no real-time priority (not permitted); its ticks may be late" in caplog.text
    assert "the memory of this process is not locked (not permitted)" in caplog.text


def locked() -> int:
    """The memory of this process that the system may not drop [kB]."""
    found = re.search(r"VmLck:\s*(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1])


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="not Linux")
def test_memory_is_locked_and_so_is_what_is_allocated_later():
    try:
        real_time.lock_memory()
    except OSError as error:
        pytest.skip(f"no right to lock memory: {error}")
    try:
        before = locked()
        assert before > 10_000
        with mmap.mmap(-1, 50_000_000) as allocated:  # never out of memory that was freed before
            assert locked() - before > 0.9 * len(allocated) / 1024
    finally:
        real_time.unlock_memory()
    assert locked() == 0
