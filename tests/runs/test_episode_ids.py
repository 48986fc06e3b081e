"""Ids of episodes and names of shards: what an id says, and that no two episodes share one."""

import numpy as np
import pytest

from surefoot.learning.frames import PART, whole_episode
from surefoot.runs.episode_ids import (
    EpisodeId,
    end_of_iteration,
    iteration_of_shard,
    rollout_ids,
    shard_name,
)


@pytest.mark.parametrize(
    ("number", "iteration", "index", "query"),
    [
        (0, 0, 0, None),
        (300_001, 3, 1, None),
        (199_999, 1, 99_999, None),
        (1_000_000_000_000, 0, 0, 0),
        (5_000_000_300_001, 3, 1, 4),
        (-5, -1, 99_995, None),
    ],
)
def test_a_number_says_iteration_and_index_and_query(number, iteration, index, query):
    place = EpisodeId.from_number(number)
    assert place == EpisodeId(iteration, index, query)
    assert place.number == number


def test_rollouts_count_from_the_first_id_of_their_iteration():
    assert rollout_ids(3, 2).tolist() == [300_000, 300_001]
    assert rollout_ids(0, 3).dtype == np.int64
    assert end_of_iteration(3) == 400_000


def test_queries_are_parts_of_the_rollout_they_start_from():
    rollouts = [EpisodeId(i, n) for i in (0, 3, 10_000) for n in (0, 7, 99_999)]
    queries = [EpisodeId(r.iteration, r.index, j) for r in rollouts for j in range(600)]
    assert [query.rollout for query in queries] == [r for r in rollouts for _ in range(600)]
    numbers = np.array([query.number for query in queries])
    np.testing.assert_array_equal(
        whole_episode(numbers), np.repeat([rollout.number for rollout in rollouts], 600)
    )
    everything = np.concatenate([numbers, [rollout.number for rollout in rollouts]])
    assert len(np.unique(everything)) == len(everything)
    assert EpisodeId(3, 7).rollout == EpisodeId(3, 7)


def test_rollouts_of_the_longest_run_have_ids_below_the_parts():
    assert end_of_iteration(10_000) < PART  # the most iterations that a configuration may have


@pytest.mark.parametrize(("iteration", "chunk"), [(0, 0), (1, 27), (999, 999), (1000, 1234)])
def test_a_shards_name_says_its_iteration(iteration, chunk):
    name = shard_name(iteration, chunk)
    assert iteration_of_shard(name) == iteration
    if iteration == 1:
        assert name == "iteration_001-027"
