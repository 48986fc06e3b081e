"""Random damage to files, and the check that a loader survives it.

`byte_mutations`, `json_mutations` and `json_texts` are strategies of damaged content; `fuzz` draws
from one, for a moment and with fixed draws in CI, or as long as the environment variable
``SUREFOOT_FUZZ_SECONDS`` says and with other draws each time. `check_loader` is the check: a loader
returns, or raises an error of its own that names the file, soon and without much memory.

    def test_damaged_bytes(tmp_path):
        content = ...
        def check(damaged):
            check_loader(load, tmp_path / "policy.safetensors", damaged, PolicyFileError)
        fuzz(byte_mutations(content), check)
"""

import copy
import json
import os
import random
import re
import signal
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from hypothesis import HealthCheck, Phase, Verbosity, given, seed, settings
from hypothesis import strategies as st

Drawn = TypeVar("Drawn")

MEMORY_BASE = 50_000_000
"""[B] A loader may allocate this much, and `MEMORY_FACTOR` times the size of its file."""
MEMORY_FACTOR = 10
LIMIT_SECONDS = 10.0
"""[s] What has not returned by then hangs; the machine may be busy."""
CI_EXAMPLES = 30
"""Draws of a test when SUREFOOT_FUZZ_SECONDS is not set."""
SECONDS = "SUREFOOT_FUZZ_SECONDS"
_TWICE = "(twice)"
"""What stands before a key that `json_texts` writes a second time."""


# --- damaged bytes


@st.composite
def byte_mutations(draw: st.DrawFn, content: bytes) -> bytes:
    """The content after one to four flips, cuts, insertions, deletions, duplications, splices."""
    damaged = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        kind = draw(st.sampled_from(sorted(_BYTE_DAMAGE)))
        _BYTE_DAMAGE[kind](draw, damaged)
    return bytes(damaged)


_RUNS = st.one_of(
    st.binary(min_size=1, max_size=16),
    st.sampled_from([b"\0", b"\xff"]).flatmap(lambda b: st.integers(1, 64).map(lambda n: b * n)),
    st.integers(0, 2**64 - 1).map(lambda n: n.to_bytes(8, "little")),
    st.sampled_from([2**31, 2**32 - 1, 2**40, 2**63 - 1]).map(lambda n: n.to_bytes(8, "little")),
)
"""Bytes to put in: random ones, many equal ones, and numbers that may be read as sizes."""


def _place(draw: st.DrawFn, content: bytearray) -> int:
    """A position in the content, or its end; headers and ends are as likely as all the rest."""
    last = len(content)
    ends = st.one_of(st.integers(0, min(256, last)), st.integers(max(0, last - 256), last))
    return draw(st.one_of(ends, st.integers(0, last)))


def _piece(draw: st.DrawFn, content: bytearray) -> bytes:
    """Some of the content."""
    begin = _place(draw, content)
    return bytes(content[begin : begin + draw(st.integers(1, 512))])


def _flip(draw: st.DrawFn, content: bytearray) -> None:
    at = _place(draw, content)
    if at < len(content):
        content[at] ^= 1 << draw(st.integers(0, 7))


def _overwrite(draw: st.DrawFn, content: bytearray) -> None:
    at = _place(draw, content)
    new = draw(_RUNS)
    content[at : at + len(new)] = new


def _insert(draw: st.DrawFn, content: bytearray) -> None:
    at = _place(draw, content)
    content[at:at] = draw(_RUNS)


def _delete(draw: st.DrawFn, content: bytearray) -> None:
    at = _place(draw, content)
    del content[at : at + draw(st.integers(1, 64))]


def _cut(draw: st.DrawFn, content: bytearray) -> None:
    del content[_place(draw, content) :]


def _duplicate(draw: st.DrawFn, content: bytearray) -> None:
    piece = _piece(draw, content)
    at = _place(draw, content)
    content[at:at] = piece


def _splice(draw: st.DrawFn, content: bytearray) -> None:
    piece = _piece(draw, content)
    at = _place(draw, content)
    content[at : at + len(piece)] = piece


_BYTE_DAMAGE: dict[str, Callable[[st.DrawFn, bytearray], None]] = {
    "flip": _flip,
    "overwrite": _overwrite,
    "insert": _insert,
    "delete": _delete,
    "cut": _cut,
    "duplicate": _duplicate,
    "splice": _splice,
}


# --- damaged JSON


@st.composite
def json_mutations(draw: st.DrawFn, value: Any) -> Any:
    """The JSON value after one to three changes of its structure or its values.

    Keys are dropped and renamed, types change, numbers become huge, negative, NaN or infinite,
    lists grow, and values are wrapped, moved or nested deeply. Write it with `json.dumps`, which
    writes NaN and infinity as Python's own reader takes them.
    """
    return _mutated(draw, value, twice=False)


@st.composite
def json_texts(draw: st.DrawFn, value: Any) -> bytes:
    """The JSON value as text, changed as `json_mutations` does, also with a key that is there twice
    or with more brackets than a reader can follow.
    """
    text = json.dumps(_mutated(draw, value, twice=True)).replace(_TWICE, "")
    if draw(st.integers(0, 19)) == 0:
        deep = draw(st.integers(1, 100_000))
        text = '{"a": ' * deep + text + "}" * deep if draw(st.booleans()) else "[" * deep + text
    return text.encode()


_WILD = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([0, -1, 1, 2, 10**6, 10**9, -(10**9), 2**31, 2**63, 10**30, 10**400]),
    st.integers(-(2**70), 2**70),
    st.sampled_from([float("nan"), float("inf"), -float("inf"), -0.0, 1e308, 5e-324, 1.5]),
    st.floats(),
    st.sampled_from(["", "x" * 5000, "..", "../../etc", "/", "\0", "nan", "1", "é", "\ud800"]),
    st.text(max_size=8),
    st.sampled_from([[], {}, [[]], [None], {"": None}, [{}], {"name": "x"}]),
).map(copy.deepcopy)
"""Values of every type, most of them where nobody expects them."""


def _mutated(draw: st.DrawFn, value: Any, twice: bool) -> Any:
    """A changed copy of a JSON value."""
    root = [copy.deepcopy(value)]
    for _ in range(draw(st.integers(1, 3))):
        places = list(_places(root))
        # The root is one place of hundreds: half of the draws stay near it.
        near = places[: min(len(places), 12)]
        parent, key = draw(st.sampled_from(draw(st.sampled_from([near, places]))))
        _change(draw, root, parent, key, twice)
    return root[0] if root else None


def _places(parent: Any) -> Iterator[tuple[Any, Any]]:
    """All pairs of a container and a key of it, level by level."""
    waiting = [parent]
    while waiting:
        container = waiting.pop(0)
        keys = list(container) if isinstance(container, dict) else range(len(container))
        for key in keys:
            yield container, key
            if isinstance(container[key], dict | list):
                waiting.append(container[key])


def _change(draw: st.DrawFn, root: list[Any], parent: Any, key: Any, twice: bool) -> None:
    """Change one value, in place."""
    value = parent[key]
    kinds = ["wild", "list", "object", "elsewhere"]
    if parent is not root:
        kinds.append("drop")
    if isinstance(value, list):
        kinds += ["longer", "empty"]
    if isinstance(value, int | float) and not isinstance(value, bool):
        kinds += ["negative", "huge", "near"]
    if isinstance(parent, dict):
        kinds += ["rename", "twice"] if twice else ["rename"]
    kind = draw(st.sampled_from(kinds))
    if kind == "drop":
        del parent[key]
    elif kind == "rename":
        parent[draw(st.one_of(st.text(max_size=6), st.just(key[:-1]), st.just(key + "s")))] = (
            parent.pop(key)
        )
    elif kind == "twice":
        parent[_TWICE + key] = draw(st.one_of(_WILD, st.just(copy.deepcopy(value))))
    else:
        parent[key] = _other_value(draw, root, value, kind)


def _other_value(draw: st.DrawFn, root: list[Any], value: Any, kind: str) -> Any:
    """What takes the place of a value."""
    if kind == "list":
        return [value]
    if kind == "object":
        return {draw(st.sampled_from(["0", "value", ""])): value}
    if kind == "elsewhere":
        container, key = draw(st.sampled_from(list(_places(root))))
        return copy.deepcopy(container[key])
    if kind == "longer":
        many = 1000 if len(json.dumps(value)) < 1000 else 3
        return (value or [0]) * draw(st.sampled_from([2, many]))
    if kind == "empty":
        return []
    if kind == "negative":
        return -value
    if kind == "huge":
        return draw(st.sampled_from([1e300, 10**15, 10**9, 10**6]))
    if kind == "near":
        near = draw(st.sampled_from([1, -1, 0.5, 1e-9]))
        # An integer may be too large to be a float.
        return value + (int(near) if isinstance(value, int) and abs(value) > 2**53 else near)
    return draw(_WILD)


# --- the check


def check_loader(
    load: Callable[[Path], object],
    path: Path,
    content: bytes,
    allowed: type[Exception] | tuple[type[Exception], ...],
) -> None:
    """Check that a loader takes a file, or refuses it as it should.

    Args:
        load: The loader. What it imports must be imported before, or counts as its memory.
        path: Where the file is written; its folder exists.
        content: Content of the file.
        allowed: What the loader may raise, with the file's name in the message.

    Raises:
        AssertionError: It raised something else, hung, or allocated too much.
    """
    path.write_bytes(content)
    limit = MEMORY_FACTOR * len(content) + MEMORY_BASE
    _reset_peak()
    before = _peak()
    tracemalloc.start()
    try:
        with _time_limit(LIMIT_SECONDS):
            load(path)
    except allowed as error:
        assert path.name in str(error), f"{path.name} is not named: {error!r}"
    finally:
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak <= limit, f"{peak} bytes in Python for a file of {len(content)}"
    resident = _peak() - before
    assert resident <= limit, f"{resident} bytes in all for a file of {len(content)}"


def fuzz(
    strategy: st.SearchStrategy[Drawn],
    check: Callable[[Drawn], object],
    examples: int = CI_EXAMPLES,
) -> None:
    """Check what a strategy draws: the same few in CI, or others for SUREFOOT_FUZZ_SECONDS.

    Args:
        strategy: What is drawn.
        check: Raises if what is drawn shows a defect; Hypothesis then looks for a smaller one.
        examples: Draws in CI; choose it so that a test takes one to two seconds at most.
    """
    seconds = float(os.environ.get(SECONDS, "0"))
    common = settings(
        deadline=None,
        database=None,
        max_examples=examples,
        phases=(Phase.generate, Phase.shrink),
        # Instead of printing kilobytes of bytes, the smallest case stays as a file in its folder.
        verbosity=Verbosity.quiet,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )

    # What is checked is called by no name of its own: `given` wants a function that it can wrap.
    def body(drawn: Drawn) -> None:
        check(drawn)

    if seconds <= 0:
        settings(common, derandomize=True)(given(strategy)(body))()
        return
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        number = random.SystemRandom().getrandbits(32)
        seed(number)(settings(common, max_examples=200)(given(strategy)(body)))()


@contextmanager
def _time_limit(seconds: float) -> Iterator[None]:
    """A context that ends what hangs in it, also in a read of a pipe; only in the main thread."""

    def hangs(*_: object) -> None:
        raise AssertionError(f"no answer after {seconds} s")

    former = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former)


def _reset_peak() -> None:
    """Let the highest memory of this process be that of now (Linux)."""
    clear = Path("/proc/self/clear_refs")
    try:
        clear.write_text("5")
    except OSError:
        return  # not Linux, or not allowed: the peak only grows, what NumPy allocates is seen


def _peak() -> int:
    """The highest memory of this process [B], what compiled libraries allocate included."""
    try:
        found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    except OSError:
        return 0
    return int(found[1]) * 1024 if found else 0
