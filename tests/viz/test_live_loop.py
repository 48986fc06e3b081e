"""Time passes as on a clock, and what is asked for happens between two ticks."""

import threading
from typing import Any

import pytest

from surefoot.viz.live_loop import MOST_TICKS, LiveLoop, Pace


class Clock:
    def __init__(self):
        self.now = 10.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


def test_a_tick_is_due_each_millisecond_and_parts_of_one_add_up(clock):
    pace = Pace(clock)
    due = []
    for _ in range(8):
        clock.now += 0.0025
        due.append(pace.due())
    assert abs(sum(due) - 20) <= 1
    assert set(due) <= {2, 3}


def test_slow_motion_asks_for_fewer_ticks(clock):
    pace = Pace(clock)
    pace.speed = 0.1
    clock.now += 0.1001
    assert pace.due() == 10


def test_what_could_not_be_simulated_is_not_made_up_for(clock):
    pace = Pace(clock)
    clock.now += 5.0
    assert pace.due() == MOST_TICKS
    assert pace.due() == MOST_TICKS
    assert pace.due() == 0


def test_the_rate_that_was_reached_is_measured(clock):
    pace = Pace(clock)
    for _ in range(10):
        clock.now += 0.16  # each time 40 ticks at most
        pace.due()
    assert pace.rate == pytest.approx(0.25, abs=0.01)
    pace.restart()
    assert pace.rate == 1.0


class Source:
    """Counts its ticks, and notes which thread asked for them."""

    robot: Any = None
    trace: Any = None
    over = False

    def __init__(self):
        self.ticks = 0
        self.threads = set()
        self.moved = threading.Event()

    def step(self, ticks):
        self.threads.add(threading.current_thread())
        self.ticks += ticks
        if self.ticks:
            self.moved.set()

    def snapshot(self) -> Any:
        """Nobody looks."""


@pytest.fixture
def loop():
    drawn = threading.Event()
    errors = []
    loop = LiveLoop(Source(), drawn.set, errors.append, errors.append)
    loop.start()
    yield loop, drawn, errors
    loop.stop()
    assert not loop.alive


def asked(loop, function):
    """Have a function called in the loop's thread, and wait until it was."""
    done = threading.Event()
    loop.call(function)
    loop.call(done.set)
    assert done.wait(30)


def test_time_passes_and_pictures_are_drawn_in_one_other_thread(loop):
    loop, drawn, _ = loop
    assert drawn.wait(30)
    assert loop.source.moved.wait(30)
    [thread] = loop.source.threads
    assert thread is not threading.current_thread()
    seen = []
    asked(loop, lambda: seen.append(threading.current_thread()))
    assert seen == [thread]


def test_no_time_passes_in_a_pause(loop):
    loop, _, _ = loop
    ticks = []

    def pause():
        loop.paused = True
        ticks.append(loop.source.ticks)

    asked(loop, pause)
    asked(loop, lambda: ticks.append(loop.source.ticks))
    asked(loop, lambda: ticks.append(loop.source.ticks))
    assert len(set(ticks)) == 1


def test_an_error_of_what_was_asked_for_is_reported_and_ends_nothing(loop):
    loop, _, errors = loop

    def fail():
        raise ValueError("no such robot")

    asked(loop, fail)
    assert errors == ["no such robot"]
    assert loop.alive


def test_a_mistake_in_what_was_asked_for_is_logged_and_ends_nothing(loop, caplog):
    loop, _, errors = loop
    asked(loop, lambda: {}["hip"])
    assert errors == ["KeyError: 'hip'"]
    assert "Traceback" in caplog.text
    assert loop.alive


def test_an_error_of_a_picture_ends_the_thread_is_logged_and_said(caplog):
    def fail():
        raise KeyError("hip")

    said = []
    loop = LiveLoop(Source(), fail, said.append, said.append)
    loop.start()
    loop.wait()
    assert not loop.alive
    assert loop.failure == "KeyError: 'hip'"
    assert said == [loop.failure]
    assert "Traceback" in caplog.text
    loop.stop()
