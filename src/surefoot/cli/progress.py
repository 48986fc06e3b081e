"""Where the package's log goes while a command runs: progress to stdout, warnings to stderr."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

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
            tqdm.write(self.format(record), file=file)
        except Exception:
            self.handleError(record)


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
