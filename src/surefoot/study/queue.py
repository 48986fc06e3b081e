"""The order in which the jobs of a study are done, and how long that takes.

Read `runner` next, which does them.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from surefoot.study.cells import StudyJob
from surefoot.study.supervise import Ended

MOST_LOSSES = 3
"""A job that is lost this many times in a row fails."""


class JobQueue:
    """The jobs of a study that are left to do, in its order.

    Args:
        jobs: The jobs, each after those that it needs.
        done: Names of those that are done.

    Attributes:
        done: Names of the jobs that are done.
        running: The jobs that are in progress, by name.
        failed: How each failed job ended.
    """

    def __init__(self, jobs: Sequence[StudyJob], done: Collection[str] = ()) -> None:
        self.done = set(done)
        self.running: dict[str, StudyJob] = {}
        self.failed: list[Ended] = []
        self._losses: Counter[str] = Counter()
        self._waiting = [job for job in jobs if job.name not in done]

    def take(self) -> StudyJob | None:
        """Take the next job that can be done now, and count it as running; None without any."""
        for number, job in enumerate(self._waiting):
            if self.done.issuperset(job.needs):
                self.running[job.name] = self._waiting.pop(number)
                return job
        return None

    def give_back(self, ended: Ended) -> Ended:
        """Record how a job ended; one that neither finished nor failed is the next to be taken.

        Returns:
            How it ended; a job that was lost too often has failed.
        """
        job = self.running.pop(ended.job)
        if ended.status == "lost":
            self._losses[job.name] += 1
            if self._losses[job.name] == MOST_LOSSES:
                ended = replace(
                    ended,
                    status="failed",
                    message=f"{job.name} was lost {MOST_LOSSES} times in a row, and is not started "
                    "again; see whether the machines stay, and have the memory for it. "
                    f"{ended.message}",
                )
        else:
            del self._losses[job.name]
        if ended.status == "finished":
            self.done.add(job.name)
        elif ended.status == "failed":
            self.failed.append(ended)
        else:
            self._waiting.insert(0, job)
        return ended


def wall_seconds(
    jobs: Sequence[StudyJob],
    seconds: Mapping[str, float],
    workers: int,
    done: Collection[str] = (),
) -> float:
    """How long jobs take together, each begun once a worker is free and what it needs is done [s].

    A long job at the end, or one that many others need, leaves workers without work; their time
    counts too.

    Args:
        jobs: The jobs, each after those that it needs.
        seconds: Job -> how long it takes [s].
        workers: Number of jobs that run at a time.
        done: Names of the jobs that are done.
    """
    queue = JobQueue(jobs, done)
    running: list[tuple[float, str]] = []
    now = 0.0
    while True:
        while len(running) < workers and (job := queue.take()) is not None:
            heapq.heappush(running, (now + seconds[job.name], job.name))
        if not running:
            return now
        now, name = heapq.heappop(running)
        queue.give_back(Ended(name, "finished"))
