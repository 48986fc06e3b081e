"""Ids of a run's episodes and names of its shards: the only place that computes either.

An id, together with the run's seed, fixes an episode. Iteration i owns the ids from 100 000 i on:
rollout n has the index n in it, and query j of rollout n (LocoDAGGER, Algorithm 3) has the index
``10_000 + n N_query + j``. Each chunk of an iteration's episodes is stored as one shard, whose name
holds the iteration and the number of the chunk. Read `runs.sampling` and `runs.query` next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.types import IntArray

EPISODES_PER_ITERATION = 100_000
"""Number of ids that each iteration owns."""
FIRST_QUERY = 10_000
"""Index of an iteration's first query; rollouts have the indices below it."""


@dataclass(frozen=True)
class EpisodeId:
    """The place of an episode in a run.

    Attributes:
        iteration: Iteration that collects the episode.
        index: Index of the episode in its iteration; rollouts count from 0, queries from
            `FIRST_QUERY`.
    """

    iteration: int
    index: int

    @classmethod
    def from_number(cls, number: int) -> EpisodeId:
        """The place of the episode that has this number as its id."""
        iteration, index = divmod(number, EPISODES_PER_ITERATION)
        return cls(iteration, index)

    @property
    def number(self) -> int:
        """The id as one number, as frames and summaries store it."""
        return self.iteration * EPISODES_PER_ITERATION + self.index

    @property
    def is_query(self) -> bool:
        """Whether the episode is an expert rollout from a state of another rollout."""
        return self.index >= FIRST_QUERY

    def query(self, j: int, N_query: int) -> EpisodeId:
        """The id of this rollout's query j.

        Args:
            j: Number of the query among those of the rollout, from 0 on.
            N_query: Number of queries of each rollout.

        Raises:
            ValueError: The id would belong to the next iteration.
        """
        index = FIRST_QUERY + self.index * N_query + j
        if index >= EPISODES_PER_ITERATION:
            raise ValueError(
                f"rollout {self.index} has no ids left for {N_query} queries: an iteration has "
                f"{EPISODES_PER_ITERATION - FIRST_QUERY} ids for all queries of its rollouts; "
                "use fewer queries (method.N_query) or fewer rollouts"
            )
        return EpisodeId(self.iteration, index)

    def parent(self, N_query: int) -> EpisodeId:
        """The id of the rollout that a query starts from; a rollout is its own parent."""
        if not self.is_query:
            return self
        return EpisodeId(self.iteration, (self.index - FIRST_QUERY) // N_query)


def rollout_ids(iteration: int, count: int) -> IntArray:
    """Ids ``(count,)`` of an iteration's rollouts, which no other iteration of a run uses."""
    return EpisodeId(iteration, 0).number + np.arange(count)


def end_of_iteration(iteration: int) -> int:
    """The smallest id that is larger than all ids of an iteration."""
    return EpisodeId(iteration + 1, 0).number


def shard_name(iteration: int, chunk: int) -> str:
    """Name of the shard that holds one chunk of an iteration's episodes."""
    return f"iteration_{iteration:03d}-{chunk:03d}"


def iteration_of_shard(name: str) -> int:
    """The iteration that collected a shard; the inverse of `shard_name`."""
    iteration, _, _ = name.removeprefix("iteration_").partition("-")
    return int(iteration)
