"""Fixtures of all tests: files that wait for no disk, and the toy's worlds and finished runs."""

import gc
import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace

import pytest

# A shell starts commands in the background deaf to Ctrl-C, and the programs that tests start and
# interrupt would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def fsync() -> Iterator[Callable[[int], None]]:
    """Files of a test need not outlast a power cut: thousands of writes would wait for the disk.

    The value is what the system does; `test_files.py` tests it.
    """
    system = os.fsync
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield system


@pytest.fixture(scope="session", autouse=True)
def no_search_for_garbage() -> Iterator[None]:
    """Nothing looks for garbage before real time: after so many tests, it takes half a second."""
    from surefoot.deploy import real_time

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(real_time, "gc", SimpleNamespace(**vars(gc) | {"collect": lambda: 0}))
        yield


@pytest.fixture(scope="module")
def toys() -> Iterator[None]:
    """Every simulator of a file is a toy."""
    from tests.fakes.toy import Worlds

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds())
        yield


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    """A finished run of each method, made when it is first asked for."""
    from tests.fakes.toy_runs import CONFIG, METHODS, run_method

    done = {}

    def finished(name):
        if name not in done:
            config = replace(CONFIG, method=METHODS[name])
            done[name] = run_method(tmp_path_factory.mktemp(name), config)
        return done[name]

    return finished
