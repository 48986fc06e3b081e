"""A collection's rollouts are run chunk by chunk, and each chunk is stored as soon as it is done.

Each file of a chunk is written whole or not at all, the shard of D last, so a collection that was
killed only runs the missing chunks again. A budget ends the collection at the same rollout for any
number of workers. Read `stages` next, where `collect_data` is the stage that uses this module.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from surefoot.config.array_io import load_arrays
from surefoot.files import save_arrays
from surefoot.rollouts.jobs import ChunkResult, Job, chunks_of, expert_name, run_chunk
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.budget import affordable_part
from surefoot.runs.episode_ids import shard_name
from surefoot.runs.layout import RunError
from surefoot.runs.run import Run
from surefoot.workers import Workers, each_chunk

PlayChunks = Callable[[Sequence[Job], Workers, str], Generator[tuple[int, ChunkResult]]]
"""Runs chunks, and yields the number and the result of each as soon as it is done."""


def simulate_chunks(
    jobs: Sequence[Job], workers: Workers, title: str
) -> Generator[tuple[int, ChunkResult]]:
    """Simulate chunks in processes; see `each_chunk`."""
    return each_chunk(run_chunk, jobs, workers, title)


@dataclass(frozen=True)
class Limit:
    """The limit at which a collection ends before its job does.

    Attributes:
        solves: Number of MPC solves that the collection may spend.
        rollouts: Number of its rollouts, if it was done before; otherwise None.
    """

    solves: int
    rollouts: int | None = None


@dataclass(frozen=True)
class _Chunks:
    """The chunks of a collection, and which of them are stored.

    Attributes:
        run: The run.
        jobs: The chunks, in the order of their episodes.
        names: Names of their shards.
        stored: Names of the shards whose files all exist.
        title: Text of the progress bar.
        play: Runs the chunks.
    """

    run: Run
    jobs: list[Job]
    names: list[str]
    stored: set[str]
    title: str
    play: PlayChunks
    _summaries: dict[int, Summary] = field(default_factory=dict, init=False)

    def run_missing(
        self, first: int, end: int, workers: Workers
    ) -> Generator[tuple[int, ChunkResult]]:
        """Run the chunks from first to end that are not stored, and yield each when it is done."""
        missing = [n for n in range(first, end) if self.names[n] not in self.stored]
        jobs = [self.jobs[number] for number in missing]
        with closing(self.play(jobs, workers, self.title)) as results:
            for done, result in results:
                yield missing[done], result

    def summary(self, number: int) -> Summary:
        """The stored summary of a chunk, which is read once."""
        if number not in self._summaries:
            path = self.run.summary_path(self.names[number])
            self._summaries[number] = load_arrays(path, Summary)
        return self._summaries[number]


def run_and_store(
    run: Run,
    iteration: int,
    job: Job,
    workers: Workers,
    limit: Limit | None,
    play: PlayChunks,
) -> Summary | None:
    """Run the chunks of a job that are not stored yet, and store each as soon as it is done.

    Args:
        run: The run.
        iteration: The iteration i.
        job: The iteration's rollouts.
        workers: Processes that run the rollouts.
        limit: The limit at which the collection ends before the job does; None without a budget.
        play: Runs the chunks.

    Returns:
        The summary of all episodes within the budget, including those that were stored before;
        None if the budget affords none.

    Raises:
        ValueError: The run's folder holds chunks of another job.
        RunError: No frame can be learned from, since the expert failed in all rollouts; or the
            budget does not pay for the first rollout. In both cases nothing is stored.
    """
    jobs = chunks_of(job)
    names = [shard_name(iteration, number) for number in range(len(jobs))]
    title = f"iteration {iteration}: collect"
    chunks = _Chunks(run, jobs, names, _stored_shards(run, job) & set(names), title, play)
    _check_stored(chunks, iteration, whole=limit is None)
    if limit is None:
        results = chunks.run_missing(0, len(jobs), workers)
    else:
        results = _affordable_results(chunks, workers, limit)
    # Chunks of an expert that does not work are held back until one of its chunks teaches
    # something: once the expert has been fixed, it must not find those chunks stored.
    held_back: list[tuple[str, ChunkResult]] = []
    done = set(chunks.stored)
    teaches = iteration > 0 or run.dataset.frames > 0
    with closing(results):  # if anything goes wrong here, the workers stop too
        for number, result in results:
            done.add(names[number])
            teaches = teaches or bool(result.recording.kept.any())
            if teaches and result.summary.ticks.any():
                _store(run, names[number], result)
            else:
                held_back.append((names[number], result))
    if not done and iteration == 0:
        raise RunError(
            f"{run.folder}: budget.expert_seconds does not pay for the first rollout; use more of "
            "it, or shorter rollouts"
        )
    if not teaches or 0 < len(held_back) == len(done):
        old = [chunks.summary(n) for n, name in enumerate(names) if name in chunks.stored]
        text = _failure_text(job, [*old, *(result.summary for _, result in held_back)])
        advice = "fix the plan, or the options that it depends on, and "
        advice += f"begin another run: {run.folder} holds these" if old else "try again"
        raise RunError(f"{text}; {advice}")
    for name, result in held_back:
        _store(run, name, result)
    summaries = [chunks.summary(n) for n, name in enumerate(names) if name in done]
    return join_summaries(summaries) if summaries else None


def _check_stored(chunks: _Chunks, iteration: int, whole: bool) -> None:
    """Check that the stored chunks belong to this job.

    Args:
        chunks: The chunks.
        iteration: The iteration i.
        whole: Whether each chunk has to be whole; a budget cuts the last one short.

    Raises:
        ValueError: A stored chunk belongs to another job.
    """
    for number, (chunk, name) in enumerate(zip(chunks.jobs, chunks.names, strict=True)):
        if name in chunks.stored and not _is_of(chunks.summary(number), chunk, whole):
            raise ValueError(
                f"{chunks.run.folder} holds rollouts of iteration {iteration} from other starts or "
                f"by another expert than {expert_name(chunk)}; resume it as it was begun, or begin "
                "another run"
            )


def _affordable_results(
    chunks: _Chunks, workers: Workers, limit: Limit
) -> Generator[tuple[int, ChunkResult]]:
    """Run chunks, and yield the results in order, until the budget cuts one short.

    Chunks beyond that one are dropped, so the results are the same for any number of workers.
    """
    end = len(chunks.jobs)
    if limit.rollouts is not None:
        sizes = [len(job.episodes) for job in chunks.jobs]
        begins = np.cumsum([0, *sizes[:-1]])
        end = int(np.count_nonzero(begins < limit.rollouts))
    left = limit.solves
    waiting: dict[int, ChunkResult] = {}
    with closing(chunks.run_missing(0, end, workers)) as results:
        for number in range(end):
            if chunks.names[number] in chunks.stored:
                summary = chunks.summary(number)
            else:
                while number not in waiting:
                    waiting.update([next(results)])
                part = affordable_part(waiting.pop(number), left)
                summary = part.summary
                if len(summary.episode):
                    yield number, part
            left -= int(summary.plans.sum())
            if int((~summary.query).sum()) < len(chunks.jobs[number].episodes):
                return


def _failure_text(job: Job, summaries: list[Summary]) -> str:
    """The error message for rollouts from which nothing can be learned."""
    count = sum(int((~summary.query).sum()) for summary in summaries)
    name = expert_name(job)
    if not any(summary.ticks.any() for summary in summaries):
        return (
            f"the expert {name} gave up on all {count} rollouts in their first tick: its plans are "
            "not valid, or not finite"
        )
    outcome = np.concatenate([summary.outcome for summary in summaries])
    return (
        f"no frame is left of {count} rollouts of the expert {name}: it gave up on "
        f"{(outcome == Outcome.DIVERGED).sum()}, and {(outcome == Outcome.FELL).sum()} fell"
    )


def lost_files(run: Run, iteration: int, job: Job) -> list[Path]:
    """Files of an iteration's chunks that were stored but no longer exist.

    Args:
        run: The run.
        iteration: The iteration i.
        job: The iteration's rollouts.
    """
    names = {shard_name(iteration, number) for number in range(len(chunks_of(job)))}
    lost = names & set(run.dataset.shards) - _stored_shards(run, job)
    paths = [path for name in sorted(lost) for path in _paths_of(run, name, job.trace)]
    return [path for path in paths if not path.exists()]


def _paths_of(run: Run, name: str, trace: bool) -> tuple[Path, ...]:
    """The files in which a chunk is stored."""
    paths = (run.dataset.shard_path(name), run.summary_path(name))
    return (*paths, run.trace_path(name)) if trace else paths


def _store(run: Run, name: str, result: ChunkResult) -> None:
    """Store a chunk, its shard last, because a chunk counts as done once its shard is in D.

    Raises:
        RunError: The chunk was stored before with different frames; nothing is replaced.
    """
    stored = run.dataset
    if name in stored.shards and not stored.holds(name, result.recording):
        paths = _paths_of(run, name, result.trace is not None)
        lost = next((path for path in paths if not path.exists()), stored.shard_path(name))
        raise RunError(
            f"{lost} is lost, and playing the rollouts again gave others: restore it from a copy, "
            "or go on where it was made, with the same versions"
        )
    if result.trace is not None:
        save_arrays(run.trace_path(name), result.trace)
    save_arrays(run.summary_path(name), result.summary)
    run.dataset.append(name, result.recording)


def _stored_shards(run: Run, job: Job) -> set[str]:
    """Names of the shards for which all of the job's files exist."""
    return {
        name
        for name in run.dataset.shards
        if all(path.exists() for path in _paths_of(run, name, job.trace))
    }


def _is_of(summary: Summary, chunk: Job, whole: bool) -> bool:
    """Whether a summary is of all (or only the first) episodes of a chunk, and by its expert."""
    rollouts = summary[~summary.query]
    count = len(chunk.episodes) if whole else len(rollouts.episode)
    return (
        np.array_equal(rollouts.episode, chunk.episode[:count])
        and np.array_equal(rollouts.start, chunk.starts.id[:count])
        and bool((rollouts.expert == expert_name(chunk)).all())
    )
