"""A thread in which time passes as on a clock, and a page is drawn at regular intervals.

`Pace` computes how much time is due, and how fast it really passes. Everything that touches the
source runs in the thread of the `LiveLoop`: other threads hand it functions to call between two
ticks. Read `browser` next, which draws.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable

from surefoot.types import TICKS_PER_SECOND
from surefoot.viz.snapshot import Source

logger = logging.getLogger(__name__)

MOST_TICKS = 40
"""[ms] The most that is simulated at once, so that the page stays responsive on a slow machine."""
FRAME_SECONDS = 0.04
"""[s] Time between two pictures: 25 per second."""
IDLE_SECONDS = 0.002
"""[s] How long the thread sleeps when nothing is due."""
WAIT_SECONDS = 0.5
"""[s] Maximum time until Ctrl-C is noticed while waiting for the thread to end."""
RATE_SECONDS = 1.0
"""[s] The time over which the real rate is measured."""

Clock = Callable[[], float]
"""Something that gives the time in seconds, such as `time.perf_counter`."""


class Pace:
    """How many ticks are due, and how much time passes in the simulation per time on the clock.

    Time that could not be simulated is lost: the simulation does not catch up after a slow second.

    Args:
        clock: The clock.

    Attributes:
        speed: Time that is to pass in the simulation per time on the clock; 1 is real time.
        rate: The rate that was reached, measured over a second; it may be below the speed.
    """

    def __init__(self, clock: Clock = time.perf_counter) -> None:
        self._clock = clock
        self.speed = 1.0
        self.rate = 1.0
        self.restart()

    def restart(self) -> None:
        """Start counting now, as after a pause."""
        now = self._clock()
        self._last = now
        self._owed = 0.0
        self._since = now
        self._done = 0
        self.rate = self.speed

    def due(self) -> int:
        """The number of ticks to simulate now; they count as simulated."""
        now = self._clock()
        self._owed += (now - self._last) * self.speed * TICKS_PER_SECOND
        self._last = now
        ticks = min(int(self._owed), MOST_TICKS)
        self._owed = min(self._owed - ticks, float(MOST_TICKS))
        self._done += ticks
        if now - self._since >= RATE_SECONDS:
            self.rate = self._done / TICKS_PER_SECOND / (now - self._since)
            self._since = now
            self._done = 0
        return ticks


class LiveLoop:
    """Lets the time of a source pass, and draws it, in one thread.

    Args:
        source: What is shown first.
        draw: Called 25 times a second, in the loop's thread, to show the source.
        report: Called with the message of an error in a function that was handed over.
        fail: Called with the message of an error that ends the thread, in that thread.

    Attributes:
        failure: The message of the error that ended the thread; empty without one.
        source: What is shown; only the loop's own thread may use or change it.
        pace: The clock of the simulation.
        paused: True while no time passes.
    """

    def __init__(
        self,
        source: Source,
        draw: Callable[[], object],
        report: Callable[[str], object],
        fail: Callable[[str], object],
    ) -> None:
        self.source = source
        self.failure = ""
        self.pace = Pace()
        self.paused = False
        self._draw = draw
        self._report = report
        self._fail = fail
        self._calls: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="surefoot-view", daemon=True)

    def start(self) -> None:
        """Let time pass from now on."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread, and wait for it to end."""
        self._stopping.set()
        self._thread.join()

    def wait(self) -> None:
        """Wait until the thread has ended; Ctrl-C ends the waiting."""
        while self.alive:
            self._thread.join(WAIT_SECONDS)

    @property
    def alive(self) -> bool:
        """Whether the thread is running."""
        return self._thread.is_alive()

    def call(self, function: Callable[[], object]) -> None:
        """Have the loop's thread call a function between two ticks; any thread may use this."""
        self._calls.put(function)

    def _run(self) -> None:
        """Let time pass; an unexpected error ends the thread, and is logged and shown."""
        try:
            self._pass_time()
        except Exception as error:
            logger.exception("the thread of the page has ended")
            self.failure = f"{type(error).__name__}: {error}"
            self._fail(self.failure)

    def _pass_time(self) -> None:
        """Simulate and draw until told to stop."""
        next_picture = 0.0
        self.pace.restart()
        while not self._stopping.is_set():
            self._make_calls()
            ticks = 0
            if self.paused or self.source.over:
                self.pace.restart()
            else:
                ticks = self.pace.due()
                self.source.step(ticks)
            now = time.perf_counter()
            if now >= next_picture:
                self._draw()
                next_picture = max(next_picture + FRAME_SECONDS, now)
            elif ticks < MOST_TICKS:
                self._stopping.wait(IDLE_SECONDS)

    def _make_calls(self) -> None:
        """Call what other threads have handed over; an error is reported, and ends nothing."""
        while True:
            try:
                function = self._calls.get_nowait()
            except queue.Empty:
                return
            try:
                function()
            except (ValueError, ArithmeticError, OSError, ImportError, RuntimeError) as error:
                logger.info("%s", error)
                self._report(str(error))
            except Exception as error:  # a bug in the package, so the log has the details
                logger.exception("what was asked for has failed")
                self._report(f"{type(error).__name__}: {error}")
            # Time that a long call took is not made up for.
            self.pace.restart()
