"""Messages that name what was given, what is allowed, and the nearest name."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def unknown(what: str, given: str, allowed: Iterable[str]) -> str:
    """Message for a name that does not exist: the nearest one that does, and all of them."""
    names = list(allowed)
    near = get_close_matches(given, names, n=1, cutoff=0.4)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    return f"there is no {what} {given!r}{hint} Known: {', '.join(names)}"
