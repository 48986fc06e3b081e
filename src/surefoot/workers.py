"""Runs chunks of work in processes of this machine or on a Ray cluster, with the same results.

The result of a chunk depends on its argument alone, not on the number of workers. Few chunks are in
progress at a time, and results are handed over as they arrive, so memory does not grow with their
number. A chunk whose worker dies is run again. Read `rollouts.jobs` next for the work that is run.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TypeVar
from urllib.parse import urlsplit

Argument = TypeVar("Argument")
Result = TypeVar("Result")

logger = logging.getLogger(__name__)

RETRIES = 2
"""How often a chunk is tried again when its worker dies."""

PROCESSES_PER_CORE = 4
"""Maximum number of processes started for each core; more would only take memory."""

CONNECTION_TIMEOUT = 5.0
"""[s] Time in which a cluster's address must accept a connection."""

RAY_TIMEOUT = 60.0
"""[s] Time in which a cluster must answer once it has accepted a connection."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of every process: the work is spread over processes, and the last bits of results
may depend on the number of threads. It must be set before NumPy and PyTorch are loaded."""

PARENT_INTERVAL = 0.5
"""[s] Interval at which a worker checks whether its parent is still there."""


def default_workers() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Workers:
    """The processes that do the work; results never depend on them.

    Attributes:
        count: Number of processes; with 1, this process does the work. A Ray cluster uses all its
            cores. On this machine, at most four are started for each core.
        backend: Where the processes run: ``loky`` (on this machine) or ``ray`` (on a cluster).
        ray_address: Address of a running cluster, ``auto`` or host:port; without one, Ray is
            started on this machine.

    Raises:
        ValueError: The number of processes is not positive.
    """

    count: int = field(default_factory=default_workers)
    backend: Literal["loky", "ray"] = "loky"
    ray_address: str | None = None

    def __post_init__(self) -> None:
        """Check the number of processes."""
        if self.count < 1:
            raise ValueError(f"{self.count} workers; use at least 1")

    @property
    def started(self) -> int:
        """Number of processes that are started on this machine."""
        return min(self.count, PROCESSES_PER_CORE * default_workers())


def map_chunks(
    function: Callable[[Argument], Result],
    chunks: Sequence[Argument],
    workers: Workers,
    title: str,
) -> list[Result]:
    """The results ``[function(chunk) for chunk in chunks]``, in that order; see `each_chunk`."""
    results = dict(each_chunk(function, chunks, workers, title))
    return [results[number] for number in range(len(chunks))]


def each_chunk(
    function: Callable[[Argument], Result],
    chunks: Sequence[Argument],
    workers: Workers,
    title: str,
) -> Generator[tuple[int, Result], None, None]:
    """Yield ``(number, function(chunk))`` for every chunk, in the order in which they are done.

    Args:
        function: A function at a module's top level; it runs in another process.
        chunks: Its arguments, which can be pickled.
        workers: The processes that run it.
        title: Text of the progress bar.

    Raises:
        RuntimeError: A chunk's worker died again and again (usually because memory ran out), or
            what the function returns or raises cannot be pickled.
        ImportError: Ray is asked for and missing.
        ValueError: There is no such cluster.
    """
    from tqdm import tqdm  # which a robot's computer does not have

    if not chunks:  # as in many stages of a resumed run, for which no process should start
        return
    if workers.backend == "ray":
        results = _spread(_Cluster(function, workers), chunks, title)
    elif workers.count == 1 or len(chunks) == 1:
        results = ((number, function(chunk)) for number, chunk in enumerate(chunks))
    else:
        results = _spread(_Processes(function, workers.started), chunks, title)
    with tqdm(total=len(chunks), desc=title, unit="chunk", leave=False) as bar:
        for number, result in results:
            bar.update()
            yield number, result


class _DeadWorkerError(Exception):
    """A task has no result: its process, or the machine that ran it, is gone."""


class _Pool(Protocol):
    """Runs tasks elsewhere; a task is a handle that only the pool understands."""

    def room(self) -> int:
        """How many tasks may be in progress: enough that no worker waits for its next one."""
        ...

    def start(self, chunk: Any) -> Any:
        """Start the task of a chunk."""
        ...

    def done(self, tasks: Sequence[Any]) -> Iterable[Any]:
        """Wait until one of the tasks has ended, and return those that have."""
        ...

    def result(self, task: Any) -> Any:
        """The result of a task that has ended.

        Raises:
            _DeadWorkerError: Its worker is gone. Whatever else the task raised is raised too.
        """
        ...

    def stop(self, tasks: Sequence[Any]) -> None:
        """End these tasks at once."""
        ...


def _spread(pool: _Pool, chunks: Sequence[Any], title: str) -> Iterator[tuple[int, Any]]:
    """Run every chunk in a pool, few at a time, and again if its worker died.

    The last try runs alone, with all the memory and no other chunk to blame. (When one process of a
    pool dies, it is unknown which chunk it ran, and all chunks in progress are lost.)
    """
    waiting = deque(range(len(chunks)))
    running: dict[Any, int] = {}
    deaths: Counter[int] = Counter()

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
                            f"{title}: a worker died {deaths[number]} times while chunk {number} "
                            "was in progress, the last time alone (out of memory?)"
                        ) from death
                    lost.append(number)
                else:
                    yield number, result
            if lost:
                waiting.extend(sorted(lost))
                logger.warning("%s: a worker died; run again: %s", title, _listed(lost))
    except BaseException:
        pool.stop(list(running))
        raise


def _listed(numbers: list[int]) -> str:
    """The numbers as words: ``chunk 3``, or ``chunks 1, 2, 3``."""
    noun = "chunk" if len(numbers) == 1 else "chunks"
    return f"{noun} {', '.join(str(number) for number in sorted(numbers))}"


class _Processes:
    """Processes of this machine, started by loky."""

    def __init__(self, function: Callable[[Any], Any], count: int) -> None:
        from loky.process_executor import TerminatedWorkerError

        self.function = function
        self.count = count
        self.executor = None
        self.died = TerminatedWorkerError

    def room(self) -> int:
        return 2 * self.count

    def start(self, chunk: Any) -> Any:
        from multiprocessing.resource_tracker import ensure_running

        from loky import get_reusable_executor

        ensure_running()  # loky starts it too, and its start lets Ctrl-C through again
        while True:
            # The executor in use, or a new one if one of its processes died.
            self.executor = get_reusable_executor(
                self.count,
                env=ONE_THREAD,
                timeout=300,
                initializer=end_with_the_parent,
                initargs=(os.getpid(),),
            )
            try:
                with _ctrl_c_held_back():
                    return self.executor.submit(self.function, chunk)
            except self.died:  # between the two calls
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
    """Hold back the signals of Ctrl-C and a closed terminal, also from processes started meanwhile.

    A terminal sends them to all of its processes. This process ends its workers itself; they would
    only print a traceback, perhaps before any of this package's code runs in them.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_the_parent(parent: int) -> None:
    """Make this worker end when its parent, given by its process id, ends for any reason.

    A thread checks for that: Linux's own signal comes as soon as the thread that started the worker
    ends, even if the parent runs on.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_INTERVAL)
        os._exit(1)

    threading.Thread(target=watch, name="end with the parent", daemon=True).start()


class _Cluster:
    """Tasks on a Ray cluster."""

    def __init__(self, function: Callable[[Any], Any], workers: Workers) -> None:
        self.ray = connected(workers)
        self.count = workers.started
        # `_spread` tries again and logs it; Ray itself would do so silently, and try forever where
        # memory is short (its task_oom_retries is -1, and 0 for a task without retries).
        self.task: Any = self.ray.remote(function).options(
            max_retries=0, runtime_env={"env_vars": ONE_THREAD}
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


def connected(workers: Workers) -> Any:
    """Ray, connected to its cluster, or to one started here for this process."""
    try:
        import ray
    except ImportError as error:
        raise ImportError("the backend 'ray' needs Ray: pip install 'surefoot[ray]'") from error
    if ray.is_initialized():
        return ray
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    terminate = signal.getsignal(signal.SIGTERM)

    def connect(address: str, **options: Any) -> None:
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **options)

    try:
        address = workers.ray_address or "local"  # otherwise Ray joins any cluster that it finds
        if address == "local":
            connect(address, num_cpus=workers.started, include_dashboard=False)
        else:
            _join(address, connect)
    finally:
        _answer_sigterm_by(terminate)
    return ray


def _join(address: str, connect: Callable[[str], object]) -> None:
    """Connect to a cluster, or find out quickly that there is none.

    Ray tries for minutes, and ignores signals meanwhile. So the address is tried first, and Ray
    connects in a separate thread, which is abandoned if it does not return.

    Args:
        address: Host and port, or a word such as ``auto``.
        connect: The function that connects to the address.

    Raises:
        ValueError: There is no cluster. Whatever else connecting raises is raised too.
    """
    done: Future[object] = Future()

    def call() -> None:
        try:
            done.set_result(connect(address))
        except BaseException as error:
            done.set_exception(error)

    try:
        parts = urlsplit(address if "://" in address else f"//{address}")
        if parts.hostname and parts.port:
            socket.create_connection((parts.hostname, parts.port), CONNECTION_TIMEOUT).close()
        threading.Thread(target=call, daemon=True).start()
        done.result(RAY_TIMEOUT)
    except (OSError, ValueError) as error:  # or the port is not a number
        reason = str(error) or f"no answer within {RAY_TIMEOUT:.0f} s"
        raise ValueError(
            f"there is no Ray cluster at {address!r} ({reason}); start one with "
            "`ray start --head`, or leave --ray-address out"
        ) from error


def _answer_sigterm_by(handler: Any) -> None:
    """Give SIGTERM back to the handler that the caller had set, since Ray replaces it."""
    if handler is not None and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)
