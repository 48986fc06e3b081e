"""Ids of episodes and names of shards: what an id says, and that no two episodes share one."""

import numpy as np
import pytest

from surefoot.config import LocoDaggerConfig
from surefoot.runs.episode_ids import (
    FIRST_QUERY,
    EpisodeId,
    end_of_iteration,
    iteration_of_shard,
    rollout_ids,
    shard_name,
)
from surefoot.scenarios.starts import load_starts

MOST_QUERIES = 600
"""The largest N_query that a configuration may have."""


@pytest.mark.parametrize(
    ("number", "iteration", "index", "is_query"),
    [
        (0, 0, 0, False),
        (300_001, 3, 1, False),
        (209_999, 2, 9_999, False),
        (110_000, 1, 10_000, True),
        (199_999, 1, 99_999, True),
        (-5, -1, 99_995, True),
    ],
)
def test_a_number_says_iteration_and_index(number, iteration, index, is_query):
    place = EpisodeId.from_number(number)
    assert place == EpisodeId(iteration, index)
    assert place.number == number
    assert place.is_query == is_query


def test_rollouts_count_from_the_first_id_of_their_iteration():
    assert rollout_ids(3, 2).tolist() == [300_000, 300_001]
    assert rollout_ids(0, 3).dtype == np.int64
    assert end_of_iteration(3) == 400_000


@pytest.mark.parametrize("index", [0, 3, 9_999])
def test_the_parent_of_a_query_is_the_rollout_it_starts_from(index):
    rollout = EpisodeId(3, index)
    queries = [rollout.query(j, 5) for j in range(5)]
    first = 310_000 + 5 * index
    assert [query.number for query in queries] == [*range(first, first + 5)]
    assert {query.parent(5) for query in queries} == {rollout}
    assert rollout.parent(5) == rollout


def test_the_ids_of_the_largest_iteration_are_enough_for_the_most_queries():
    """Every velocity and every perturbation that the pre-training leaves."""
    perturbations, _, velocities = load_starts().rows("train").shape
    count = velocities * (perturbations - LocoDaggerConfig().pretraining.perturbations)
    assert count <= FIRST_QUERY
    last = EpisodeId(1, count - 1).query(MOST_QUERIES - 1, MOST_QUERIES)
    assert last.iteration == 1 and last.number < end_of_iteration(1)


def test_a_query_without_an_id_is_an_error():
    with pytest.raises(ValueError, match="rollout 89 has no ids left for 1001 queries"):
        EpisodeId(1, 89).query(1000, 1001)


@pytest.mark.parametrize(("iteration", "chunk"), [(0, 0), (1, 27), (999, 999), (1000, 1234)])
def test_a_shards_name_says_its_iteration(iteration, chunk):
    name = shard_name(iteration, chunk)
    assert iteration_of_shard(name) == iteration
    if iteration == 1:
        assert name == "iteration_001-027"
