"""The entry point of `python -m surefoot` and of the command `surefoot`.

It sets the number of threads before NumPy and PyTorch are loaded, and what Ctrl-C does. Read
`cli.main` next.
"""

import os
import signal
import sys
from time import monotonic
from types import FrameType

from surefoot.errors import HangUp, interrupt_behind
from surefoot.workers import ONE_THREAD

os.environ.update(ONE_THREAD)

INTERRUPTED = 130
"""Exit status of an interrupted command, as for any command that Ctrl-C ends."""
PATIENCE = 5.0
"""[s] Time after a first Ctrl-C in which others are ignored: processes end, files are closed."""


class Interrupt:
    """The answer to Ctrl-C, to a closed terminal (SIGHUP), and to SIGTERM of a batch system.

    The first signal interrupts the work. Others within a few seconds, as from a user who presses
    Ctrl-C twice, are ignored, since they would interrupt the cleanup; a later one ends this process
    at once, and the workers end with it.
    """

    def __init__(self) -> None:
        self.first: float | None = None

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Answer a signal.

        Raises:
            HangUp: It is the first one, and the terminal has been closed.
            KeyboardInterrupt: It is the first one, and any other signal.
        """
        if self.first is None:
            self.first = monotonic()
            raise HangUp if number == signal.SIGHUP else KeyboardInterrupt
        if monotonic() - self.first > PATIENCE:
            os._exit(INTERRUPTED)


def answer_signals() -> None:
    """Answer Ctrl-C, a closed terminal and SIGTERM; the first two only where they are not ignored.

    A shell without a terminal makes its background processes ignore Ctrl-C, and `nohup` makes its
    command ignore a closed terminal.
    """
    interrupt = Interrupt()
    signal.signal(signal.SIGTERM, interrupt)
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, interrupt)


def leave_signals(status: int) -> None:
    """Set what signals do while Python itself shuts down, when no function can answer them.

    Args:
        status: The exit status. After an interrupt, signals are ignored, so that it stays.
    """
    answer = signal.SIG_IGN if status == INTERRUPTED else signal.SIG_DFL
    signal.signal(signal.SIGTERM, answer)
    for number in (signal.SIGINT, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, answer)


def main() -> int:
    """Run the command line, and return its exit status."""
    status = INTERRUPTED
    try:  # loading takes a second or two
        answer_signals()
        from surefoot.cli.main import main as command_line

        status = command_line()
    except KeyboardInterrupt:
        pass
    except Exception as error:
        if interrupt_behind(error) is None:
            raise
    try:
        leave_signals(status)
    except KeyboardInterrupt:  # between the command's end and here: what it did stands
        leave_signals(status)
    if "viser" in sys.modules:
        # All is closed and written by now, and an interpreter that has served a page often crashes
        # while it ends, when its libraries are unloaded under their own threads.
        sys.stderr.flush()
        os._exit(status)
    return status


if __name__ == "__main__":
    sys.exit(main())
