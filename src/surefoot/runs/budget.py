"""A run's budget of expert-seconds: how much a collection may spend, and which rollouts fit.

The unit is an MPC solve, which counts as 50 ms of the expert. The run's metrics record what is
spent, and thereby fix what an iteration may spend, so that a resumed run spends the same. Within a
collection the rollouts are counted in the order of their ids, whichever process ran them. Read
`collecting` next, which ends a collection at its budget.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from surefoot.config import Config, IterativeConfig
from surefoot.learning.frames import whole_episode
from surefoot.rollouts.jobs import ChunkResult
from surefoot.runs.run import Run
from surefoot.types import GRID, TICKS_PER_SECOND

SECONDS_PER_SOLVE = GRID / TICKS_PER_SECOND
"""[s] the time of the expert that one MPC solve counts as."""
_ROUNDING = 1e-9
"""Tolerance, in solves, within which a number of seconds counts as whole solves."""


def solves_of(seconds: float) -> int:
    """How many MPC solves a time of the expert pays for.

    Args:
        seconds: The time [s].
    """
    return math.floor(seconds / SECONDS_PER_SOLVE + _ROUNDING)


def first_allowance(config: Config) -> int | None:
    """MPC solves that the first collection may spend; None without a budget.

    This is the only collection of behavior cloning, and the pre-training of iterative methods.
    """
    budget = config.budget
    if budget.expert_seconds is None:
        return None
    if isinstance(config.method, IterativeConfig):
        return solves_of(budget.pretraining * budget.expert_seconds)
    return solves_of(budget.expert_seconds)


def allowance(run: Run, i: int) -> int | None:
    """MPC solves that the collection of iteration i may spend; None without a budget.

    What is left is shared equally among all iterations from this one on.

    Args:
        run: The run, which has done all earlier collections.
        i: The iteration; 0 is the first collection.
    """
    method = run.config.method
    if i == 0 or not isinstance(method, IterativeConfig):
        return first_allowance(run.config)
    left = solves_left(run, i)
    return None if left is None else left // (method.iterations - i + 1)


def solves_left(run: Run, i: int) -> int | None:
    """MPC solves that are left when iteration i begins; None without a budget."""
    seconds = run.config.budget.expert_seconds
    if seconds is None:
        return None
    return max(solves_of(seconds) - solves_spent(run, i), 0)


def solves_spent(run: Run, i: int) -> int:
    """MPC solves that are spent before iteration i begins."""
    collected = [run.collected(before) for before in range(i)]
    return sum(record.plans for record in collected if record is not None)


def iterations_within_budget(run: Run, iterations: int, first: int = 1) -> Iterator[int]:
    """The iterations of a method, in order, until nothing is left to spend.

    Args:
        run: The run; each iteration must do its collection before the next one is requested.
        iterations: Number N of iterations.
        first: Number of the first iteration.
    """
    for i in range(first, iterations + 1):
        if solves_left(run, i) == 0:
            return
        yield i


def affordable_part(result: ChunkResult, left: int) -> ChunkResult:
    """The first rollouts of a chunk, in the order of their ids, that fit into the budget left.

    Args:
        result: The result of the chunk.
        left: Number of MPC solves that may be spent.
    """
    summary = result.summary
    ids, which = np.unique(whole_episode(summary.episode), return_inverse=True)
    solves = np.zeros(len(ids), dtype=np.int64)
    np.add.at(solves, which, summary.plans)  # those of a rollout's queries, too
    fits = np.cumsum(solves) <= left
    if fits.all():
        return result
    chosen = ids[fits]
    trace = result.trace
    if trace is not None:
        rows = np.isin(trace.episode, chosen)
        trace = replace(
            trace, episode=trace.episode[rows], inputs=trace.inputs[rows], label=trace.label[rows]
        )
    recording = result.recording
    return ChunkResult(
        summary[np.isin(whole_episode(summary.episode), chosen)],
        recording[np.isin(whole_episode(recording.episode), chosen)],
        trace,
    )
