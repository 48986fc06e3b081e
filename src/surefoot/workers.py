"""Chunks of work over processes of this machine, or over a Ray cluster: the same results on both.

A chunk is fixed by its argument alone, so results are the same for any number of workers. Few
chunks are under way at a time, and results are handed over as they come, so that memory does not
grow with their number. A chunk whose worker dies is run again.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TypeVar

from tqdm import tqdm

Argument = TypeVar("Argument")
Result = TypeVar("Result")

RETRIES = 2
"""How often a chunk is tried again when its worker dies."""

_PR_SET_PDEATHSIG = 1
"""Of Linux's prctl: the signal to a process whose parent ends."""

_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def default_workers() -> int:
    """The cores this process may use."""
    return len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Workers:
    """Who does the work; results never depend on it.

    Attributes:
        count: processes; one stays in this process. Of a Ray cluster all cores are used.
        backend: ``loky`` (processes of this machine) or ``ray`` (tasks on a cluster).
        ray_address: of a running cluster, ``auto`` or host:port; without it Ray is started here.
    """

    count: int = field(default_factory=default_workers)
    backend: Literal["loky", "ray"] = "loky"
    ray_address: str | None = None


def map_chunks(
    function: Callable[[Argument], Result],
    chunks: Sequence[Argument],
    workers: Workers,
    label: str,
) -> list[Result]:
    """``[function(chunk) for chunk in chunks]``; see `each_chunk`."""
    results = dict(each_chunk(function, chunks, workers, label))
    return [results[number] for number in range(len(chunks))]


def each_chunk(
    function: Callable[[Argument], Result],
    chunks: Sequence[Argument],
    workers: Workers,
    label: str,
) -> Generator[tuple[int, Result], None, None]:
    """``(number, function(chunk))`` of every chunk as it is done, in any order.

    Args:
        function: of a module's top level; runs in another process.
        chunks: picklable arguments.
        workers: who runs it.
        label: in front of the progress bar.

    Raises:
        RuntimeError: a chunk's worker died again and again (usually for want of memory), or what
            the function returns or raises cannot be pickled.
        ImportError: Ray is asked for and missing.
        ValueError: there is no such cluster, or no worker.
    """
    if workers.count < 1:
        raise ValueError(f"{workers.count} workers; use at least 1")
    if not chunks:  # a resumed run has many such stages: start nothing for them
        return
    if workers.backend == "ray":
        results = _spread(_Cluster(function, workers), chunks, label)
    elif workers.count == 1 or len(chunks) == 1:
        results = ((number, function(chunk)) for number, chunk in enumerate(chunks))
    else:
        results = _spread(_Processes(function, workers.count), chunks, label)
    with tqdm(total=len(chunks), desc=label, unit="chunk", leave=False) as bar:
        for number, result in results:
            bar.update()
            yield number, result


class _DeadWorkerError(Exception):
    """A task has no result: its process, or the machine that ran it, is gone."""


class _Pool(Protocol):
    """Runs tasks elsewhere; a task is a handle that only the pool understands."""

    def room(self) -> int:
        """How many tasks may be under way: who is done with one has the next at hand."""
        ...

    def start(self, chunk: Any) -> Any:
        """The task of a chunk."""
        ...

    def done(self, tasks: Sequence[Any]) -> Iterable[Any]:
        """Those of the tasks that have ended; waits for the first."""
        ...

    def result(self, task: Any) -> Any:
        """Of a task that has ended; raises what it raised, or `_DeadWorkerError`."""
        ...

    def stop(self, tasks: Sequence[Any]) -> None:
        """End these tasks at once."""
        ...


def _spread(pool: _Pool, chunks: Sequence[Any], label: str) -> Iterator[tuple[int, Any]]:
    """Every chunk by a pool, few at a time, and again where its worker died.

    The last try is alone: with all the memory, and nobody else to blame. (When one process of a
    pool dies, nobody knows whose it was, and all that is under way is lost.)
    """
    waiting, running, deaths = deque(range(len(chunks))), {}, Counter()

    def another_may_start() -> bool:
        if not running or not waiting:
            return bool(waiting)
        alone = any(deaths[number] == RETRIES for number in (waiting[0], *running.values()))
        return not alone and len(running) < pool.room()

    try:
        while waiting or running:
            while another_may_start():
                number = waiting.popleft()
                running[pool.start(chunks[number])] = number
            lost = []
            for task in pool.done(list(running)):
                number = running.pop(task)
                try:
                    result = pool.result(task)
                except _DeadWorkerError as death:
                    deaths[number] += 1
                    if deaths[number] > RETRIES:
                        raise RuntimeError(
                            f"{label}: a worker died {deaths[number]} times while chunk {number} "
                            "was under way, at last alone (out of memory?)"
                        ) from death
                    lost.append(number)
                else:
                    yield number, result
            if lost:
                waiting.extend(sorted(lost))
                tqdm.write(f"{label}: a worker died; run again: {_listed(lost)}")
    except BaseException:
        pool.stop(list(running))
        raise


def _listed(numbers: list[int]) -> str:
    """``chunk 3``, ``chunks 1, 2, 3``."""
    return f"chunk{'s' * (len(numbers) > 1)} {', '.join(map(str, sorted(numbers)))}"


class _Processes:
    """Processes of this machine, by loky."""

    def __init__(self, function: Callable[[Any], Any], count: int) -> None:
        from loky.process_executor import TerminatedWorkerError

        self.function, self.count, self.executor = function, count, None
        self.died = TerminatedWorkerError

    def room(self) -> int:
        return 2 * self.count

    def start(self, chunk: Any) -> Any:
        from multiprocessing.resource_tracker import ensure_running

        from loky import get_reusable_executor

        ensure_running()  # loky starts it too, and its start lets Ctrl-C through again
        while True:
            # The one in use, or a new one if a process of it died.
            self.executor = get_reusable_executor(
                self.count,
                env=_ONE_THREAD,
                timeout=300,
                initializer=_end_with_the_parent,
                initargs=(os.getpid(),),
            )
            try:
                with _ctrl_c_held_back():
                    return self.executor.submit(self.function, chunk)
            except self.died:  # just now
                continue

    def done(self, tasks: Sequence[Any]) -> Iterable[Any]:
        from concurrent.futures import FIRST_COMPLETED, wait

        return wait(tasks, return_when=FIRST_COMPLETED).done

    def result(self, task: Any) -> Any:
        try:
            return task.result()
        except self.died as error:
            raise _DeadWorkerError from error

    def stop(self, tasks: Sequence[Any]) -> None:
        if self.executor is not None:
            self.executor.shutdown(wait=False, kill_workers=True)


@contextmanager
def _ctrl_c_held_back() -> Iterator[None]:
    """Hold Ctrl-C back for a moment; processes started meanwhile never see it.

    It goes to all processes of a terminal. This one ends its workers itself; they would only print
    where they were, and may do so before any code of ours runs in them.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with_the_parent(parent: int) -> None:
    """In a worker: end when the parent does, however it ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it is gone already
        os._exit(1)


class _Cluster:
    """Tasks on a Ray cluster."""

    def __init__(self, function: Callable[[Any], Any], workers: Workers) -> None:
        self.ray, self.count = _connected(workers), workers.count
        # `_spread` tries again and says so; Ray itself would be quiet about it, and try forever
        # where memory is short (its task_oom_retries is -1, and 0 for a task without retries).
        self.task: Any = self.ray.remote(function).options(
            max_retries=0, runtime_env={"env_vars": _ONE_THREAD}
        )

    def room(self) -> int:
        return 2 * max(self.count, int(self.ray.cluster_resources().get("CPU", 1)))

    def start(self, chunk: Any) -> Any:
        return self.task.remote(chunk)

    def done(self, tasks: Sequence[Any]) -> Iterable[Any]:
        return self.ray.wait(tasks, num_returns=1)[0]

    def result(self, task: Any) -> Any:
        errors = self.ray.exceptions
        try:
            return self.ray.get(task)
        except errors.RayTaskError as error:
            raise error.cause from error
        except (
            errors.WorkerCrashedError,
            errors.NodeDiedError,
            errors.OutOfMemoryError,
            errors.ObjectLostError,
        ) as error:
            raise _DeadWorkerError from error
        except errors.RayError as error:
            raise RuntimeError(f"Ray: {error}") from error

    def stop(self, tasks: Sequence[Any]) -> None:
        for task in tasks:
            self.ray.cancel(task, force=True)


def _connected(workers: Workers) -> Any:
    """Ray, connected to its cluster, or to one started here for this process."""
    try:
        import ray
    except ImportError as error:
        raise ImportError("the backend 'ray' needs Ray: pip install 'surefoot[ray]'") from error
    if not ray.is_initialized():
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        options: dict[str, Any] = {"log_to_driver": False, "logging_level": "error"}
        if workers.ray_address is None:
            options |= {"num_cpus": workers.count, "include_dashboard": False}
        terminate = signal.getsignal(signal.SIGTERM)
        try:
            # "local", or Ray would join any cluster that it finds.
            ray.init(address=workers.ray_address or "local", **options)
        except ConnectionError as error:
            raise ValueError(
                f"there is no Ray cluster at {workers.ray_address!r} ({error}); start one with "
                "`ray start --head`, or leave --ray-address out"
            ) from error
        finally:
            _answer_sigterm_by(terminate)
    return ray


def _answer_sigterm_by(handler: Any) -> None:
    """Ray takes SIGTERM over; what our caller does with it stands."""
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)
