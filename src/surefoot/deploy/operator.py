"""The operator: starts and stops the robot, steers it, and shows that somebody is watching.

A robot only stands up after a start. It is damped when the operator says stop or is lost: the
terminal has closed, or the promised sign of life does not come. Read `loop` next.
"""

from __future__ import annotations

import logging
import math
import os
import select
import sys
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from surefoot.deploy.interfaces import Clock, wall_clock
from surefoot.errors import shown
from surefoot.types import Command

LONGEST_LINE = 200
"""[B] Maximum length of an operator's line."""
MOST_READS = 1000
"""Number of reads after which a halt regards the input as discarded, though more may come."""
NAMES = {"vx": "vx", "vy": "vy", "yaw": "yaw_rate"}
"""The operator's words for the parts of a command."""
STOP = "stop"
"""The word that stops a robot, anywhere in a line."""
UNSTEERED = "type start, stop, stand or walk; the velocities are given"
"""What an operator who does not steer may say."""
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Vocabulary:
    """What an operator may say in addition to `start`, `stop`, `stand` and `walk`.

    Attributes:
        steers: Whether the operator may change velocity and gait.
        gaits: The names of the gaits that may be commanded, in the order of their numbers.
    """

    steers: bool = True
    gaits: tuple[str, ...] = ()

    @property
    def help(self) -> str:
        """The whole vocabulary, as the end of a sentence."""
        if not self.steers:
            return UNSTEERED
        if len(self.gaits) < 2:
            return "type start, stop, stand, walk, vx 0.2, vy 0.1 or yaw 0.5"
        return (
            "type start, stop, stand, walk, vx 0.2, vy 0.1, yaw 0.5 or gait NAME, which is one of "
            f"{', '.join(self.gaits)}"
        )


class Wish(NamedTuple):
    """What the operator wants now.

    Attributes:
        go: Whether the robot is to stand up and walk; False damps it.
        command: The commanded velocity.
        lost: Why the operator is lost; empty as long as they are there.
        rest: Whether the robot is to stand instead of walking.
        gait: The number of the commanded gait; the robot switches to it when it can.
        over: Whether nothing more is to come, so that the session ends, even before it stood up.
    """

    go: bool
    command: Command
    lost: str = ""
    rest: bool = False
    gait: int = 0
    over: bool = False


class Operator(Protocol):
    """Somebody who watches over the robot."""

    def wish(self) -> Wish:
        """What the operator wants now; called once per tick, and must not wait."""
        ...


class Scripted:
    """An operator who is always there, starts at once and stops after a time.

    Args:
        command: The commanded velocity.
        seconds: How long the robot is to be driven, standing up included; None never stops it.
        clock: Gives the time [ns].
        gait: The number of the commanded gait.
    """

    def __init__(
        self,
        command: Command,
        seconds: float | None = None,
        clock: Clock = wall_clock,
        gait: int = 0,
    ) -> None:
        self.command = command
        self._gait = gait
        self._seconds = seconds
        self._clock = clock
        self._begun: int | None = None

    def wish(self) -> Wish:
        """See `Operator`."""
        now = self._clock()
        if self._begun is None:
            self._begun = now
        over = self._seconds is not None and now - self._begun >= self._seconds * 1e9
        return Wish(not over, self.command, gait=self._gait, over=over)


def check_input(instead: str) -> None:
    """Check that an operator can type at all: a shell may have closed the standard input (`<&-`).

    Args:
        instead: What to use without a standard input.

    Raises:
        ValueError: There is no standard input.
    """
    if sys.stdin is None:
        raise ValueError(
            f"there is no standard input, so nobody could stop the robot; use {instead}"
        )


class Terminal:
    """An operator at a terminal: lines of text on the standard input.

    `start` makes the robot stand up and walk, and `stop` damps it; `stand` makes it stand until
    `walk` or `stop`; `vx 0.2`, `vy 0.1` and `yaw 0.5` change the command, and `gait bound` the
    gait. An empty line is a sign of life; any other line changes nothing and is named in a warning.
    A line that contains the word stop stops the robot, whatever else it says.

    Args:
        command: The velocity commanded at first.
        heartbeat: How often a line has to come [s]; if it is None, only the end of the input is a
            loss.
        clock: Gives the time [ns].
        descriptor: The file descriptor to read from; that of the standard input if it is None.
        vocabulary: What the operator may say.
        gait: The number of the gait commanded at first.

    Raises:
        ValueError: No descriptor is given, and there is no standard input.
    """

    def __init__(
        self,
        command: Command,
        heartbeat: float | None = None,
        clock: Clock = wall_clock,
        descriptor: int | None = None,
        vocabulary: Vocabulary | None = None,
        gait: int = 0,
    ) -> None:
        if descriptor is None:
            check_input("a descriptor, or an operator of another kind")
        self._wish = Wish(False, command, gait=gait)
        self._heartbeat = heartbeat
        self._clock = clock
        self._descriptor = sys.stdin.fileno() if descriptor is None else descriptor
        self._vocabulary = vocabulary or Vocabulary()
        self._alive_ns = clock()
        self._text = b""

    def wish(self) -> Wish:
        """See `Operator`."""
        if not self._wish.lost:
            self._listen()
        return self._wish

    def halt(self) -> None:
        """Forget the start, and what was typed since: a damped robot waits for a new start."""
        self._wish = self._wish._replace(go=False)
        for _ in range(MOST_READS):
            self.wish()
        self._wish = self._wish._replace(go=False, rest=False)
        self._text = b""

    def _listen(self) -> None:
        """Take the new input, but no more than a line's length, so that no flood delays a tick."""
        now = self._clock()
        if select.select([self._descriptor], [], [], 0.0)[0]:
            part = self._read()
            if not part:
                self._wish = self._wish._replace(go=False, lost="the operator's input has ended")
                return
            self._alive_ns = now
            *lines, self._text = (self._text + part).split(b"\n")
            if len(self._text) > LONGEST_LINE:  # what is cut off may contain a stop
                stop = STOP.encode() if _stops(self._text.decode(errors="replace")) else b""
                self._text = stop + self._text[-LONGEST_LINE:]
            texts = [line.decode(errors="replace") for line in lines]
            # Of lines that arrive together, a stop is obeyed last: a start cannot undo it.
            for text in sorted(texts, key=_stops):
                self._wish = obey(self._wish, text, self._vocabulary)
        silent = (now - self._alive_ns) / 1e9
        if self._heartbeat is not None and self._wish.go and silent > self._heartbeat:
            lost = f"the operator has given no sign of life for {silent:.2f} s"
            self._wish = self._wish._replace(go=False, lost=lost)

    def _read(self) -> bytes:
        """Some bytes of the input; none if it has ended, as when the terminal is closed."""
        try:
            return os.read(self._descriptor, LONGEST_LINE)
        except OSError:
            return b""


def obey(wish: Wish, line: str, vocabulary: Vocabulary) -> Wish:
    """What the operator wants after a line; an unknown line changes nothing, with a warning.

    Args:
        wish: What the operator wanted before.
        line: The line; an empty one is a sign of life only.
        vocabulary: What the operator may say.
    """
    words = line.lower().split()
    if not words:
        return wish
    if words == ["start"]:
        return wish._replace(go=True)
    if _stops(line):
        if not wish.go:
            logger.warning("the robot is damped already; Ctrl-C ends the program")
        return wish._replace(go=False, rest=False)
    if words in (["stand"], ["walk"]):
        return wish._replace(rest=words == ["stand"])
    if len(words) == 2 and vocabulary.steers:
        name, value = words
        if name == "gait" and value in vocabulary.gaits:
            return wish._replace(gait=vocabulary.gaits.index(value))
        number = _number(value)
        if name in NAMES and number is not None:
            return wish._replace(command=wish.command._replace(**{NAMES[name]: number}))
    logger.warning(f"{shown(line.strip())} means nothing; {vocabulary.help}")
    return wish


def _stops(line: str) -> bool:
    """Whether a line stops the robot, whatever else was typed around the word."""
    return STOP in line.lower()


def _number(text: str) -> float | None:
    """The finite number in a text; None if there is none."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
