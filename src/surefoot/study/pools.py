"""Where the jobs of a study run: side by side on this machine, or on a Ray cluster.

Each job is a separate process in either case (`supervise`). On a cluster, all machines must see the
folder of the study under the same path. The results do not depend on where a job runs, as long as
all processors are of the same model.
"""

from __future__ import annotations

import threading
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import Any, Protocol

from surefoot.study.supervise import Ended, Task, supervise
from surefoot.workers import Workers, connected

PATIENCE = 1.0
"""How long a pool waits for a job to end before it reports that none has [s]."""


class JobPool(Protocol):
    """Runs jobs."""

    @property
    def count(self) -> int:
        """How many jobs it runs at a time."""
        ...

    @property
    def has_room(self) -> bool:
        """Whether another job may be started now."""
        ...

    def start(self, task: Task) -> None:
        """Start a job."""
        ...

    def ended(self) -> list[Ended]:
        """Wait for a moment for jobs to end, and return how those that did have ended."""
        ...

    def stop(self) -> None:
        """End all jobs that are in progress; what they have finished is on disk."""
        ...


def make_pool(workers: Workers) -> JobPool:
    """The pool that runs as many jobs at a time as there are workers.

    Raises:
        ImportError: Ray is asked for and missing.
        ValueError: There is no such cluster.
    """
    return RayPool(workers) if workers.backend == "ray" else LocalPool(workers.count)


class LocalPool:
    """Runs jobs side by side on this machine, each supervised by a thread.

    Args:
        count: Number of jobs at a time.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._stop = threading.Event()
        # A job's process ends with the thread that starts it, which waits for it.
        self._threads = ThreadPoolExecutor(count)
        self._running: set[Future[Ended]] = set()

    @property
    def has_room(self) -> bool:
        """Whether another job may be started now."""
        return len(self._running) < self.count

    def start(self, task: Task) -> None:
        """Start a job."""
        self._running.add(self._threads.submit(supervise, task, self._stop))

    def ended(self) -> list[Ended]:
        """Wait for a moment for jobs to end, and return how those that did have ended."""
        done, self._running = wait(self._running, PATIENCE, FIRST_COMPLETED)
        return [future.result() for future in done]

    def stop(self) -> None:
        """End all jobs that are in progress; what they have finished is on disk."""
        self._stop.set()
        self._threads.shutdown()


class RayPool:
    """Runs jobs on a Ray cluster, each supervised by a task that takes one core.

    Args:
        workers: The cluster, and the least number of jobs to run at a time.
    """

    def __init__(self, workers: Workers) -> None:
        self._ray: Any = connected(workers)
        self.count = max(workers.count, int(self._ray.cluster_resources().get("CPU", 1)))
        self._supervise: Any = self._ray.remote(supervise).options(num_cpus=1, max_retries=0)
        self._running: dict[Any, str] = {}

    @property
    def has_room(self) -> bool:
        """Whether another job may be started now."""
        return len(self._running) < self.count

    def start(self, task: Task) -> None:
        """Start a job."""
        self._running[self._supervise.remote(task)] = task.job

    def ended(self) -> list[Ended]:
        """Wait for a moment for jobs to end, and return how those that did have ended."""
        done, _ = self._ray.wait(list(self._running), timeout=PATIENCE)
        return [self._end_of(reference, self._running.pop(reference)) for reference in done]

    def stop(self) -> None:
        """End all jobs that are in progress; what they have finished is on disk."""
        for reference in self._running:
            self._ray.cancel(reference, force=True)

    def _end_of(self, reference: Any, job: str) -> Ended:
        """How a job ended; it is lost if its machine was lost or had too little memory for it."""
        try:
            return self._ray.get(reference)
        except self._ray.exceptions.RayTaskError as error:
            raise error.cause from error
        except self._ray.exceptions.RayError as error:
            return Ended(job, "lost", f"Ray lost it: {error}")
