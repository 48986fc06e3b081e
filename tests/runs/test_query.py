"""Queries on hand-made rollouts: from which states, with which ids, and for how long."""

import numpy as np
import pytest

from surefoot.config import Config, DisturbanceConfig
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.jobs import Job
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.query import Query
from surefoot.scenarios.starts import load_starts
from surefoot.types import GRID
from tests.fakes.rollouts import blank

T = 600
LENGTH = np.array([600, 400, 199, 600])
OUTCOME = np.array([Outcome.SUCCESS, Outcome.FELL, Outcome.FELL, Outcome.STALLED])
QUERY = Query(N_query=40, T_query=0.5, before_fall=0.2)


@pytest.fixture
def played() -> tuple[Job, Rollout]:
    """Four rollouts; the second fell at 0.4 s, the third before anything can be asked of it."""
    starts = load_starts()["train"][:4]
    rng = np.random.default_rng(0)
    q = rng.normal(size=(4, T, 19))
    q[..., 3:7] /= np.linalg.norm(q[..., 3:7], axis=-1, keepdims=True)
    rollouts = blank(
        4, T, q=q, v=rng.normal(size=(4, T, 18)), length=LENGTH, outcome=OUTCOME, starts=starts
    )
    job = Job(
        Config(seed=3),
        Episodes(starts, 0.6, id=200_000 + np.arange(4)),
        PolicyOnly(),
        disturbance=DisturbanceConfig(pushes=2),
        then=QUERY,
    )
    return job, rollouts


def test_queries_start_from_states_on_the_grid_that_were_visited_before_any_fall(played):
    job, rollouts = played
    queries = QUERY(job, rollouts)
    assert queries is not None
    robots = np.array([0, 1, 3]).repeat(40)
    elapsed = queries.starts.tick - job.starts.tick[robots]
    assert (queries.starts.tick % GRID == 0).all()
    assert (elapsed >= 0).all() and (elapsed < np.array([600, 200, 600]).repeat(40)).all()
    assert (np.diff(elapsed.reshape(3, 40), axis=1) >= 0).all()
    np.testing.assert_array_equal(queries.starts.q[:, :2], 0.0)
    np.testing.assert_array_equal(queries.starts.q[:, 2:], rollouts.q[robots, elapsed, 2:])
    np.testing.assert_array_equal(queries.starts.v, rollouts.v[robots, elapsed])
    np.testing.assert_array_equal(queries.starts.command, job.starts.command[robots])
    np.testing.assert_array_equal(queries.starts.id, job.starts.id[robots])
    assert len(np.unique(elapsed[:40])) == 12  # 40 draws reach every tick of the grid of 600


def test_queries_have_ids_of_their_own_and_are_driven_by_the_expert(played):
    queries = QUERY(*played)
    assert queries is not None
    expected = [210_000 + 40 * robot + j for robot in (0, 1, 3) for j in range(40)]
    assert queries.episode.tolist() == expected
    assert isinstance(queries.arbiter, ExpertOnly)
    assert queries.episodes.duration == 0.5
    assert queries.disturbance.pushes == 0
    assert queries.query and queries.then is None and queries.policy is None


def test_the_states_of_a_rollout_depend_on_its_id_and_the_seed_alone(played):
    job, rollouts = played
    together = QUERY(job, rollouts)
    alone = QUERY(job[3:], one_of(rollouts, 3))
    assert together is not None and alone is not None
    np.testing.assert_array_equal(alone.starts.tick, together.starts.tick[80:])
    np.testing.assert_array_equal(alone.episode, together.episode[80:])


def one_of(rollouts: Rollout, robot: int) -> Rollout:
    part = slice(robot, robot + 1)
    return blank(
        1,
        T,
        q=rollouts.q[part],
        v=rollouts.v[part],
        length=rollouts.length[part],
        outcome=rollouts.outcome[part],
        starts=rollouts.starts[part],
    )


def test_without_a_rollout_that_lasted_long_enough_there_is_no_query(played):
    job, rollouts = played
    assert QUERY(job[2:3], one_of(rollouts, 2)) is None


def test_failed_queries_are_dropped_whole(played):
    queries = QUERY(*played)
    assert queries is not None and queries.keep is not None
    outcome = np.array([Outcome.SUCCESS, Outcome.DIVERGED])
    keep = queries.keep(blank(2, 5, length=np.array([5, 3]), outcome=outcome))
    assert keep.tolist() == [[True] * 5, [False] * 5]
