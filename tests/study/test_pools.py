"""A pool on this machine runs jobs beside each other. Tiny programs are the jobs."""

import pytest

from surefoot.study.pools import LocalPool
from tests.fakes.tiny_jobs import study_of_tiny_jobs, task


@pytest.fixture
def folder(tmp_path):
    return study_of_tiny_jobs(tmp_path)


def all_ended(pool, count):
    """How so many jobs ended, by name."""
    ended = {}
    while len(ended) < count:
        ended |= {each.job: each.status for each in pool.ended()}
    return ended


def test_a_pool_runs_so_many_jobs_at_a_time_and_says_how_each_ended(folder):
    pool = LocalPool(2)
    pool.start(task(folder, "ends"))
    assert pool.has_room
    pool.start(task(folder, "fails"))
    assert not pool.has_room
    assert all_ended(pool, 2) == {"ends": "finished", "fails": "failed"}
    assert pool.has_room
    pool.stop()


def test_a_pool_that_is_stopped_ends_its_jobs(folder):
    pool = LocalPool(1)
    pool.start(task(folder, "long"))
    assert pool.ended() == []
    pool.stop()
    assert all_ended(pool, 1) == {"long": "stopped"}
