"""What a 1 ms loop needs from the system: to run first, to stay in memory, and not to be paused.

Priority and locked memory need Linux and permissions; where one is not granted, there is a warning.
Read `loop` for what has to be in time.
"""

from __future__ import annotations

import ctypes
import gc
import logging
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

logger = logging.getLogger(__name__)

PRIORITY = 50
"""The real-time priority: in the middle, below the kernel's own."""
_LOCKED = 1 | 2 | 4  # MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT of <sys/mman.h>
_IPC_LOCK = 14  # CAP_IPC_LOCK of <linux/capability.h>


def take_real_time_priority(priority: int = PRIORITY) -> None:
    """Ask the system to run this thread before all threads that are not in real time.

    What this process has touched stays in memory from then on. Otherwise, code and data that are
    not used for seconds, such as those for states outside a gate, may be dropped, and reading them
    again takes many ticks. Without the permissions (CAP_SYS_NICE, CAP_IPC_LOCK), or on a system
    other than Linux, it warns.

    Args:
        priority: Its priority; a larger one runs first.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError) as error:
        logger.warning("this process has no real-time priority (%s); its ticks may be late", error)
    try:
        lock_memory()
    except (AttributeError, OSError) as error:
        logger.warning("the memory of this process is not locked (%s); ticks may be late", error)


@contextmanager
def beside_real_time() -> Iterator[None]:
    """A context in which this thread runs in real time too, one priority below the default.

    Both take turns under Python's lock: if the system made this thread wait while it has the lock,
    the real-time thread would wait with it, whatever its priority.
    """
    take_real_time_priority(PRIORITY - 1)
    try:
        yield
    finally:
        with suppress(AttributeError, OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        with suppress(AttributeError, OSError):
            unlock_memory()


@contextmanager
def without_pauses() -> Iterator[None]:
    """A context in which Python does not stop to look for garbage."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_enabled:
            gc.enable()


def lock_memory() -> None:
    """Keep in memory what this process touches.

    Raises:
        OSError: It may not, or only up to a limit.
    """
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    # Beyond a limit, later allocations would fail.
    if limit != resource.RLIM_INFINITY and not _has_no_limit():
        raise PermissionError(f"it may lock {limit} bytes of memory; use `ulimit -l unlimited`")
    _call("mlockall", _LOCKED)


def _has_no_limit() -> bool:
    """Whether this process has the capability CAP_IPC_LOCK, to which the limit does not apply."""
    found = re.search(r"CapEff:\s*([0-9a-f]+)", Path("/proc/self/status").read_text())
    return found is not None and bool(int(found[1], 16) >> _IPC_LOCK & 1)


def unlock_memory() -> None:
    """Let the system drop parts of the memory again.

    Raises:
        OSError: The system refuses.
    """
    _call("munlockall")


def _call(function: str, *arguments: int) -> None:
    """Call a function of the C library.

    Raises:
        OSError: It fails.
    """
    if ctypes.CDLL(None, use_errno=True)[function](*arguments) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{function}: {os.strerror(number)}")
