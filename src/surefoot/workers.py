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
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

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
        count: processes; one stays in this process. On Ray, tasks at a time on this machine.
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
) -> Iterator[tuple[int, Result]]:
    """``(number, function(chunk))`` of every chunk as it is done, in any order.

    Args:
        function: of a module's top level; runs in another process.
        chunks: picklable arguments.
        workers: who runs it.
        label: in front of the progress bar.

    Raises:
        RuntimeError: a chunk's worker died again and again (usually for want of memory).
        ImportError: Ray is asked for and missing.
        ValueError: there is no such cluster, or no worker.
    """
    if workers.count < 1:
        raise ValueError(f"{workers.count} workers; use at least 1")
    if workers.backend == "ray":
        results = _on_ray(function, chunks, workers, label)
    elif workers.count == 1 or len(chunks) == 1:
        results = ((number, function(chunk)) for number, chunk in enumerate(chunks))
    else:
        results = _on_processes(function, chunks, workers.count, label)
    with tqdm(total=len(chunks), desc=label, unit="chunk", leave=False) as bar:
        for number, result in results:
            bar.update()
            yield number, result


def _on_processes(
    function: Callable[[Argument], Result], chunks: Sequence[Argument], count: int, label: str
) -> Iterator[tuple[int, Result]]:
    """By loky, two chunks under way for each process."""
    from concurrent.futures import FIRST_COMPLETED, Future, wait

    from loky import get_reusable_executor
    from loky.process_executor import BrokenProcessPool

    waiting, tries = deque(range(len(chunks))), Counter()
    while waiting:
        running: dict[Future, int] = {}
        executor = get_reusable_executor(
            count,
            env=_ONE_THREAD,
            timeout=300,
            initializer=_follow_the_parent,
            initargs=(os.getpid(),),
        )
        try:
            while waiting or running:
                while waiting and len(running) < 2 * count:
                    number = waiting.popleft()
                    running[executor.submit(function, chunks[number])] = number
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    yield running.pop(future), result
        except BrokenProcessPool:
            # Nobody knows whose process it was: all that were under way are tried again.
            for number in sorted(running.values()):
                tries[number] += 1
                _check_tries(tries[number], number, label)
                waiting.append(number)
            tqdm.write("a worker process died; its chunks are run again")
        except BaseException:
            executor.shutdown(wait=False, kill_workers=True)
            raise


def _on_ray(
    function: Callable[[Argument], Result],
    chunks: Sequence[Argument],
    workers: Workers,
    label: str,
) -> Iterator[tuple[int, Result]]:
    """By Ray, which tries a task again itself when its worker or node dies."""
    ray = _connected(workers)
    task: Any = ray.remote(function).options(
        max_retries=RETRIES, runtime_env={"env_vars": _ONE_THREAD}
    )
    cores = int(ray.cluster_resources().get("CPU", 1))
    waiting, running = deque(range(len(chunks))), {}
    try:
        while waiting or running:
            while waiting and len(running) < 2 * max(workers.count, cores):
                number = waiting.popleft()
                running[task.remote(chunks[number])] = number
            done, _ = ray.wait(list(running), num_returns=1)
            number = running.pop(done[0])
            try:
                yield number, ray.get(done[0])
            except ray.exceptions.RayTaskError as error:
                raise error.cause from None
            except ray.exceptions.RayError as error:
                raise RuntimeError(_died(number, label)) from error
    finally:
        for reference in running:
            ray.cancel(reference, force=True)


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
        try:
            ray.init(address=workers.ray_address, **options)
        except ConnectionError as error:
            raise ValueError(
                f"there is no Ray cluster at {workers.ray_address!r} ({error}); start one with "
                "`ray start --head`, or leave --ray-address out"
            ) from error
    return ray


def _check_tries(tries: int, number: int, label: str) -> None:
    if tries > RETRIES:
        raise RuntimeError(_died(number, label))


def _died(number: int, label: str) -> str:
    return (
        f"{label}: a worker died {RETRIES + 1} times while chunk {number} was under way (out of "
        "memory?); use fewer --workers"
    )


def _follow_the_parent(parent: int) -> None:
    """In a worker: end with the parent, however it ends, and leave Ctrl-C to it.

    It ends its workers itself; they would only print where they were.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it is gone already
        os._exit(1)
