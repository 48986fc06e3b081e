"""Queries on hand-made rollouts: from which states, with which ids, and for how long."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config, DisturbanceConfig, StateNoiseConfig
from surefoot.config.sim import parse_terrains
from surefoot.learning.frames import PART, whole_episode
from surefoot.learning.samples import held_out
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.jobs import Job, disturbance_of
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.query import Query
from surefoot.scenarios.disturbance import draw_disturbances
from surefoot.scenarios.starts import load_starts
from surefoot.sim.terrain import Ground
from surefoot.types import GRID
from tests.fakes.rollouts import blank

T = 600
LENGTH = np.array([600, 400, 199, 600])
OUTCOME = np.array([Outcome.SUCCESS, Outcome.FELL, Outcome.FELL, Outcome.STALLED])
QUERY = Query(N_query=3, T_query=0.5, before_fall=0.2)


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
    robots = np.array([0, 1, 3]).repeat(3)
    elapsed = queries.starts.tick - job.starts.tick[robots]
    assert (queries.starts.tick % GRID == 0).all()
    assert (elapsed >= 0).all() and (elapsed < np.array([600, 200, 600]).repeat(3)).all()
    assert (np.diff(elapsed.reshape(3, 3), axis=1) > 0).all()
    np.testing.assert_array_equal(queries.starts.q[:, :2], 0.0)
    np.testing.assert_array_equal(queries.starts.q[:, 2:], rollouts.q[robots, elapsed, 2:])
    np.testing.assert_array_equal(queries.starts.v, rollouts.v[robots, elapsed])
    np.testing.assert_array_equal(queries.starts.command, job.starts.command[robots])
    np.testing.assert_array_equal(queries.starts.id, job.starts.id[robots])


@pytest.mark.parametrize("lost", [Outcome.FELL, Outcome.DIVERGED])
@pytest.mark.parametrize("N_query", [11, 12, 40])
def test_the_states_of_a_rollout_are_different_ones_and_all_of_them_if_there_are_too_few(
    played, N_query, lost
):
    job, rollouts = played
    outcome = np.where(OUTCOME == Outcome.FELL, lost, OUTCOME)
    rollouts = replace(rollouts, outcome=outcome)
    queries = replace(QUERY, N_query=N_query)(job, rollouts)
    assert queries is not None
    # In 0.6 s there are twelve states on the grid of 50 ms; four before the second is lost.
    counts = {200_000: min(N_query, 12), 200_001: 4, 200_003: min(N_query, 12)}
    for id_, count in counts.items():
        ticks = queries.starts.tick[whole_episode(queries.episode) == id_]
        assert len(ticks) == len(np.unique(ticks)) == count


def test_the_queries_of_a_rollout_are_held_out_together(played):
    job, rollouts = played
    held = []
    for first in range(0, 1000, 4):
        ids = replace(job.episodes, id=300_000 + first + np.arange(4))
        queries = QUERY(replace(job, episodes=ids), rollouts)
        assert queries is not None
        by_rollout = held_out(queries.episode, 0.1).reshape(3, 3)
        assert (by_rollout == held_out(ids.ids[[0, 1, 3]], 0.1)[:, None]).all()
        held.append(by_rollout)
    assert 0.05 < np.mean(held) < 0.15


def test_queries_have_ids_of_their_own_and_are_driven_by_the_expert(played):
    queries = QUERY(*played)
    assert queries is not None
    expected = [200_000 + robot + (j + 1) * PART for robot in (0, 1, 3) for j in range(3)]
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
    np.testing.assert_array_equal(alone.starts.tick, together.starts.tick[6:])
    np.testing.assert_array_equal(alone.episode, together.episode[6:])


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


DISTURBED = DisturbanceConfig(
    pushes=2,
    expert_impulse=(0.5, 1.0),
    friction=(0.5, 1.5),
    mass=(0.8, 1.2),
    noise=StateNoiseConfig(joint_position=0.01),
    delay=4,
)


def test_a_query_is_the_same_robot_on_the_same_floor(played):
    """Friction, mass, noise and the torques under way are those of its rollout at that tick."""
    job, rollouts = played
    job = replace(job, disturbance=DISTURBED)
    disturbance = disturbance_of(job)
    torque = np.random.default_rng(1).normal(size=(4, T, 12))
    queries = QUERY(job, replace(rollouts, disturbance=disturbance, torque=torque))
    assert queries is not None
    asked = queries.episodes.disturbance
    assert asked is not None and asked.pushes is not None and asked.measured is not None
    robots = np.array([0, 1, 3]).repeat(3)
    elapsed = queries.starts.tick - job.starts.tick[robots]
    for name in ("friction", "mass"):
        np.testing.assert_array_equal(getattr(asked, name), getattr(disturbance, name)[robots])
    assert [*asked.seeds] == [disturbance.seeds[robot] for robot in robots]
    np.testing.assert_array_equal(asked.measured, elapsed)
    assert (asked.noise, asked.delay) == (DISTURBED.noise, 4)
    assert queries.episodes.late is not None
    for row, (robot, tick) in enumerate(zip(robots, elapsed, strict=True)):
        if tick > 0:
            np.testing.assert_array_equal(
                queries.episodes.late[row], torque[robot, tick - 4 : tick]
            )
    # The pushes are its own: one, early, of the size that teaches.
    own = draw_disturbances(replace(DISTURBED, pushes=0), 3, queries.episode, 0.0, 0.5, 0.5)
    assert own.pushes is not None and own.pushes.tick.shape == (9, 1)
    np.testing.assert_array_equal(asked.pushes.impulse, own.pushes.impulse)
    np.testing.assert_array_equal(asked.pushes.tick, own.pushes.tick)


@pytest.mark.parametrize("text", ["slope:10", "bumps:0.05"])
def test_queries_stand_on_the_ground_that_was_below_their_robots(played, text):
    job, rollouts = played
    origin = np.random.default_rng(2).normal(size=(4, 3))
    ground = Ground(parse_terrains(text) * 4, origin, np.array([0.0, 0.5, 1.0, 3.0]))
    queries = QUERY(job, replace(rollouts, ground=ground, felt_ground=np.zeros((4, T))))
    assert queries is not None
    asked = queries.episodes.ground
    assert asked is not None
    robots = np.array([0, 1, 3]).repeat(3)
    elapsed = queries.starts.tick - job.starts.tick[robots]
    before = rollouts.q[robots, elapsed, None, :2]
    around = np.array([[0.0, 0.0], [0.2, 0.1], [-0.2, 0.1]])
    assert np.abs(before).max() > 0.5
    np.testing.assert_allclose(
        asked.heights(np.tile(around, (9, 1, 1))),
        ground[robots].heights(before + around),
        atol=1e-12,
    )


def test_failed_queries_are_dropped_whole(played):
    queries = QUERY(*played)
    assert queries is not None and queries.keep is not None
    outcome = np.array([Outcome.SUCCESS, Outcome.DIVERGED])
    keep = queries.keep(blank(2, 5, length=np.array([5, 3]), outcome=outcome))
    assert keep.tolist() == [[True] * 5, [False] * 5]
