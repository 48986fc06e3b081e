"""Chunks of work over processes: results in order, progress, and a second try after a dead worker.

A chunk is fixed by its argument alone, so results are the same for any number of workers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from typing import TypeVar

from tqdm import tqdm

Argument = TypeVar("Argument")
Result = TypeVar("Result")

RETRIES = 2
"""How often a chunk is tried again when its process dies."""


def default_workers() -> int:
    """The cores this process may use."""
    return len(os.sched_getaffinity(0))


def each_chunk(
    function: Callable[[Argument], Result],
    chunks: Sequence[Argument],
    workers: int,
    label: str,
) -> Iterator[tuple[int, Result]]:
    """``(number, function(chunk))`` of every chunk as it is done, in any order."""
    yield from enumerate(map_chunks(function, chunks, workers, label))


def map_chunks(
    function: Callable[[Argument], Result],
    chunks: Sequence[Argument],
    workers: int,
    label: str,
) -> list[Result]:
    """``[function(chunk) for chunk in chunks]``, spread over processes, with a progress bar.

    Args:
        function: of a module's top level; runs in another process.
        chunks: picklable arguments.
        workers: processes; 1 stays in this one.
        label: in front of the progress bar.

    Raises:
        RuntimeError: a chunk's process died again and again (usually for want of memory).
    """
    results: dict[int, Result] = {}
    with tqdm(total=len(chunks), desc=label, unit="chunk", leave=False) as bar:
        if workers == 1 or len(chunks) == 1:
            for number, chunk in enumerate(chunks):
                results[number] = function(chunk)
                bar.update()
            return list(results.values())

        from loky import get_reusable_executor
        from loky.process_executor import BrokenProcessPool

        one_thread = dict.fromkeys(
            ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
        )
        for _ in range(RETRIES + 1):
            missing = [number for number in range(len(chunks)) if number not in results]
            if not missing:
                break
            executor = get_reusable_executor(workers, env=one_thread, timeout=300)
            try:
                futures = {executor.submit(function, chunks[n]): n for n in missing}
                for future in as_completed(futures):
                    results[futures[future]] = future.result()
                    bar.update()
            except BrokenProcessPool:
                tqdm.write("a worker process died; trying the missing chunks again")
            except BaseException:
                executor.shutdown(wait=False, kill_workers=True)
                raise
    if len(results) < len(chunks):
        raise RuntimeError(
            f"{label}: a process died {RETRIES + 1} times (out of memory?); use fewer --workers"
        )
    return [results[number] for number in range(len(chunks))]
