"""Messages that name what was given, what is allowed, and the nearest name; and interrupts."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from difflib import get_close_matches
from reprlib import Repr
from threading import current_thread, main_thread

_BRIEF = Repr()
_BRIEF.maxstring = 200
_BRIEF.maxother = 200


class HangUp(KeyboardInterrupt):
    """The terminal has been closed (SIGHUP), which interrupts the work as Ctrl-C does."""


def interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """The interrupt that an error hides; None if there is none.

    If Ctrl-C arrives while compiled code is called or loaded, that code may raise another error,
    such as a SystemError or an ImportError, of which the interrupt is only the cause.

    Args:
        error: The error; its causes and contexts are searched too.
    """
    waiting: list[BaseException | None] = [error]
    seen: set[int] = set()
    while waiting:
        candidate = waiting.pop()
        if candidate is None or id(candidate) in seen:
            continue
        if isinstance(candidate, KeyboardInterrupt):
            return candidate
        seen.add(id(candidate))
        waiting += [candidate.__context__, candidate.__cause__]
    return None


@contextmanager
def interrupts_held_back() -> Iterator[list[int]]:
    """A context that Ctrl-C, a closed terminal and SIGTERM do not interrupt; it lists those sent.

    Only signals that a Python function handles are held back; the system's own actions stay. Python
    interrupts the main thread alone, so nothing is held back in others.
    """
    came: list[int] = []
    with ExitStack() as restoring:
        for each in (signal.SIGINT, signal.SIGHUP, signal.SIGTERM):
            answer = signal.getsignal(each)
            if callable(answer) and current_thread() is main_thread():
                restoring.callback(signal.signal, each, answer)
                signal.signal(each, lambda number, frame: came.append(number))
        yield came


def shown(value: object) -> str:
    """A value as a message shows it; a long or nested one, as from a file, is shortened.

    Args:
        value: What was given.
    """
    return _BRIEF.repr(value)


def unknown(what: str, value: str, allowed: Iterable[str]) -> str:
    """Message for a name that does not exist.

    Args:
        what: What kind of thing the name stands for.
        value: The name that does not exist.
        allowed: The names that do exist.

    Returns:
        A sentence with the closest known name, if one is close, and all known names.
    """
    names = list(allowed)
    lower = {name.lower(): name for name in names}
    near = get_close_matches(value.lower(), lower, n=1, cutoff=0.5)
    hint = f"; did you mean {lower[near[0]]!r}?" if near else "."
    return f"there is no {what} {value!r}{hint} Known: {', '.join(names)}"
