"""Standard output and error that do not end the work: their reader may leave, their disk be full.

An hour of measurement is not lost because `head` has read enough. What cannot be written is
dropped, and the command goes on; its exit status tells. Characters that the terminal's encoding
lacks are written as escapes.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO


class LastingStream(io.TextIOWrapper):
    """A stream whose failures are kept instead of raised.

    Args:
        stream: A stream of the process, whose buffer is used until `detach`.

    Attributes:
        failure: The first error of writing; None if all was written.
    """

    def __init__(self, stream: io.TextIOWrapper) -> None:
        super().__init__(
            stream.buffer,
            stream.encoding,
            "backslashreplace",
            line_buffering=True,  # so that a failure shows where it happens
        )
        self.failure: OSError | None = None
        self._in_bar = False

    def write(self, text: str, /) -> int:
        """Write a text, or drop it if the stream has failed.

        In a file, what follows a progress bar begins a line of its own: nothing erases bars there.
        """
        begins_line = self._in_bar and text[:1] not in "\r\n\x1b" and not self.isatty()
        if text:
            self._in_bar = not text.endswith("\n") and (self._in_bar or text.startswith("\r"))
        try:
            super().write(f"\n{text}" if begins_line else text)
        except OSError as error:
            self._fail(error)
        return len(text)

    def flush(self) -> None:
        """Write what is buffered, or drop it if the stream has failed."""
        try:
            super().flush()
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        """Keep the first error, and let what follows, and what is buffered still, go nowhere."""
        if self.failure is None:
            self.failure = error
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
        self.flush()


@contextmanager
def lasting_output() -> Iterator[TextIO]:
    """Use such streams as standard output and error; the value is the output's.

    A stream that is closed (``>&-``) goes nowhere; one that is no file of text, as in a notebook,
    is left as it is.
    """
    before = (sys.stdout, sys.stderr)
    sys.stdout = _lasting(sys.stdout)
    sys.stderr = _lasting(sys.stderr)
    try:
        yield sys.stdout
    finally:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, LastingStream):
                stream.flush()
                stream.detach()
        sys.stdout, sys.stderr = before


def _lasting(stream: TextIO | None) -> TextIO:
    """The stream as one that lasts, if it is one of the process."""
    if stream is None:
        return open(os.devnull, "w")
    return LastingStream(stream) if isinstance(stream, io.TextIOWrapper) else stream


def failure_of(stream: TextIO) -> OSError | None:
    """The first error of writing to a stream; None if all was written."""
    return stream.failure if isinstance(stream, LastingStream) else None
