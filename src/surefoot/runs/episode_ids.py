"""Ids of a run's episodes and names of its shards, which are computed only here.

An id, together with the run's seed, fixes an episode. Iteration i owns the ids from 100 000 i on:
rollout n has the id 100 000 i + n. Query j of a rollout (LocoDAGGER, Algorithm 3) is part j + 1 of
the rollout: its id is the rollout's plus ``(j + 1) PART``, so that learning can tell which episodes
belong together (`learning.frames.whole_episode`). Earlier versions gave queries the indices from
10 000 on. Each chunk of an iteration's episodes is stored as one shard, named by the iteration and
the number of the chunk. Read `runs.sampling` and `runs.query` next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surefoot.learning.frames import PART
from surefoot.types import IntArray

EPISODES_PER_ITERATION = 100_000
"""Number of ids that the rollouts of each iteration own."""


@dataclass(frozen=True)
class EpisodeId:
    """The place of an episode in a run.

    Attributes:
        iteration: Iteration that collects the episode.
        index: Index of the rollout in its iteration, from 0 on.
        query: Number of the rollout's query, from 0 on; None is the rollout itself.
    """

    iteration: int
    index: int
    query: int | None = None

    @classmethod
    def from_number(cls, number: int) -> EpisodeId:
        """The place of the episode with this id."""
        part = max(number, 0) // PART
        iteration, index = divmod(number - part * PART, EPISODES_PER_ITERATION)
        return cls(iteration, index, part - 1 if part else None)

    @property
    def number(self) -> int:
        """The id as one number, as frames and summaries store it."""
        part = 0 if self.query is None else self.query + 1
        return part * PART + self.iteration * EPISODES_PER_ITERATION + self.index

    @property
    def rollout(self) -> EpisodeId:
        """The id of the rollout that a query starts from; for a rollout, its own id."""
        return replace(self, query=None)


def rollout_ids(iteration: int, count: int) -> IntArray:
    """Ids ``(count,)`` of an iteration's rollouts, which no other iteration of a run uses."""
    return EpisodeId(iteration, 0).number + np.arange(count)


def end_of_iteration(iteration: int) -> int:
    """The first id after those that an iteration owns."""
    return EpisodeId(iteration + 1, 0).number


def shard_name(iteration: int, chunk: int) -> str:
    """Name of the shard that holds one chunk of an iteration's episodes."""
    return f"iteration_{iteration:03d}-{chunk:03d}"


def iteration_of_shard(name: str) -> int:
    """The iteration that collected a shard; the inverse of `shard_name`."""
    iteration, _, _ = name.removeprefix("iteration_").partition("-")
    return int(iteration)
