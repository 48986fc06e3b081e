"""What is shown while a command runs: the log, and bars with an estimate of the time that is left.

Progress that is logged goes to stdout, warnings go to stderr, and so do the bars. What takes longer
than ten seconds has a bar, here or where it is done, such as in `workers` and in `runs.progress`.
"""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, TextIO

from surefoot.types import TICKS_PER_SECOND

if TYPE_CHECKING:
    from tqdm import tqdm


class TqdmHandler(logging.Handler):
    """Writes each message as a line that does not tear progress bars apart."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a message.

        Args:
            record: The message; warnings and errors go to stderr, everything else to stdout.
        """
        try:
            file = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
            write_line(self.format(record), file)
        except Exception:
            self.handleError(record)


def write_line(text: str, file: TextIO) -> None:
    """Write a line above the bars, if there are any; a robot's computer may not have tqdm at all.

    Args:
        text: The line.
        file: Standard output or error.
    """
    if "tqdm" in sys.modules:
        from tqdm import tqdm

        tqdm.write(text, file=file)
    else:
        print(text, file=file)


def duration_text(seconds: float) -> str:
    """A duration in words: hours, and below an hour whole minutes, at least one.

    Args:
        seconds: The duration [s].
    """
    if seconds >= 3600.0:
        return f"{seconds / 3600.0:.1f} hours"
    minutes = max(round(seconds / 60.0), 1)
    return f"{minutes} minute{'s' if minutes > 1 else ''}"


def seconds_bar(seconds: float, title: str) -> tqdm:
    """A bar of simulated time; give its `update` to `surefoot.rollouts.jobs.play_out`.

    Args:
        seconds: How long the robot walks [s].
        title: Text of the bar.
    """
    from tqdm import tqdm

    ticks = round(seconds * TICKS_PER_SECOND)
    return tqdm(total=ticks, desc=title, unit="ms", leave=False)


@contextmanager
def log_shown() -> Iterator[None]:
    """Show what the package logs, from level INFO on."""
    logger = logging.getLogger("surefoot")
    handler = TqdmHandler()
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeHandler(handler)
