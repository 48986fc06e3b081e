"""Priorities of the threads beside the one that drives a robot."""

import os
from typing import Any

import pytest

from surefoot.deploy.drive import PRIORITY, beside_real_time, take_real_time_priority


@pytest.fixture
def asked(monkeypatch) -> list[tuple[int, int]]:
    """The policies and priorities that the system is asked for."""
    asked: list[tuple[int, int]] = []

    def scheduler(process: int, policy: int, parameters: Any) -> None:
        asked.append((policy, parameters.sched_priority))

    monkeypatch.setattr(os, "sched_setscheduler", scheduler)
    return asked


@pytest.mark.skipif(not hasattr(os, "SCHED_FIFO"), reason="no real-time priorities here")
def test_who_shares_python_with_the_thread_that_drives_goes_right_after_it(asked):
    take_real_time_priority()
    with pytest.raises(KeyboardInterrupt), beside_real_time():
        raise KeyboardInterrupt
    assert asked == [
        (os.SCHED_FIFO, PRIORITY),
        (os.SCHED_FIFO, PRIORITY - 1),
        (os.SCHED_OTHER, 0),
    ]


@pytest.mark.skipif(not hasattr(os, "SCHED_FIFO"), reason="no real-time priorities here")
def test_without_the_right_to_it_there_is_a_warning_and_no_error(monkeypatch, caplog):
    def refused(*arguments: object) -> None:
        raise PermissionError("not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    with beside_real_time():
        pass
    assert "its ticks may be late" in caplog.text
