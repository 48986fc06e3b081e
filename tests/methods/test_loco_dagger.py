"""LocoDAGGER on the toy: a coin for each expert period, and queries of states that were visited."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import DisturbanceConfig, LocoDaggerConfig, StateNoiseConfig
from surefoot.learning.frames import PART
from surefoot.rollouts.arbiters import RandomMix
from surefoot.rollouts.jobs import play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.query import Query
from surefoot.runs.run import Run
from surefoot.scenarios.disturbance import draw_disturbances
from tests.fakes.rollouts import blank
from tests.fakes.runs import collected
from tests.fakes.toy_runs import (
    CONFIG,
    FIRST,
    GRID,
    SMALL_METHODS,
    collection,
    kept_in,
    replayed,
)
from tests.fakes.toy_worlds import (
    FALLEN,
    NEVER,
    expected_kicks,
    kicks,
    one_iteration,
    shifted,
    spells,
    with_random_policy,
)

pytestmark = pytest.mark.usefixtures("toys")


@pytest.mark.parametrize("by", [0, 17])
@pytest.mark.parametrize("alpha", [0.5, 0.8])
def test_the_coin_is_thrown_once_per_expert_period(runs, alpha, by):
    run = runs(f"loco_dagger-{alpha}")
    assert replayed(run, 1)[0][1].expert_drove.all()  # alpha^0 = 1
    method = replace(run.config.method, velocities=10, perturbations=6, T=0.3)
    many = Run(run.folder, replace(run.config, method=method))
    job = shifted(replace(collection(many, 2), then=None), by)
    rollouts, _ = play_out(job)
    assert (rollouts.length == 300).all()
    throws = []
    for b in range(60):
        drove = rollouts.expert_drove[b]
        clock = job.starts.tick[b] + np.arange(300)
        changes = 1 + np.flatnonzero(drove[1:] != drove[:-1])
        assert (clock[changes] % GRID == 0).all()
        throws.append(drove[(clock % GRID == 0) | (np.arange(300) == 0)])
    throws = np.array(throws)
    assert throws.shape == (60, 6 if by == 0 else 7)
    sd = np.sqrt(alpha * (1 - alpha))
    assert abs(throws.mean() - alpha) < 4 * sd / np.sqrt(throws.size)
    assert abs(throws[:, 0].mean() - alpha) < 4 * sd / np.sqrt(60)  # the first tick is a throw
    assert len(np.unique(throws, axis=0)) > 10


def test_the_share_of_iteration_i_is_alpha_to_the_i_minus_one(runs):
    run = runs("loco_dagger-0.5")
    for i, share in ((1, 1.0), (2, 0.5), (3, 0.25), (4, 0.125)):
        coin = collection(run, i).arbiter
        assert isinstance(coin, RandomMix)
        ids = np.arange(2000)
        still = np.zeros(2000, int)
        coin.reset(ids)
        state = blank(2000, 1).seen[:, 0]
        drives = [coin.choose(state, still + 50 * t, np.zeros((2000, 3))) for t in range(20)]
        sd = np.sqrt(share * (1 - share) / 40_000)
        assert abs(np.mean(drives) - share) <= 4.5 * sd


@pytest.mark.parametrize("alpha", [0.5, 0.8])
@pytest.mark.parametrize("i", [1, 2])
def test_queries_are_of_states_that_the_rollout_visited(runs, alpha, i):
    run = runs(f"loco_dagger-{alpha}")
    method = run.config.method
    (job, rollouts), (queries, answered) = replayed(run, i)
    N = method.N_query
    T = round(1000 * method.T_query)
    assert len(queries.starts) == N * len(job.starts)
    assert len(np.unique([*queries.episode, *job.episode])) == (N + 1) * len(job.starts)
    assert answered.duration == T and answered.expert_drove.all()
    seen = []
    for n, first in enumerate(queries.episode.tolist()):
        b = n // N
        start = queries.starts[n : n + 1]
        elapsed = int(start.tick[0] - rollouts.starts.tick[b])
        seen.append(elapsed)
        failed = rollouts.outcome[b] == Outcome.FELL
        assert 0 <= elapsed <= rollouts.length[b] - (200 if failed else 1)
        assert start.tick[0] % GRID == 0
        np.testing.assert_array_equal(start.q[0, 2:], rollouts.q[b, elapsed, 2:])
        np.testing.assert_array_equal(start.v[0], rollouts.v[b, elapsed])
        np.testing.assert_array_equal(start.command[0], rollouts.starts.command[b])
        np.testing.assert_array_equal(answered.q[n, 0], start.q[0])
        assert first % PART == job.episode[b]
    assert len(set(seen)) > 5
    cost = collected(run, i)
    assert cost.queries == N * len(job.starts)
    failures = int((answered.outcome == Outcome.FELL).sum())
    assert cost.queries_failed == failures
    frames = kept_in(run, i)
    assert len(frames) == (len(queries.starts) - failures) * T == cost.frames_kept
    assert set(frames.episode) <= set(queries.episode)


QUERY = LocoDaggerConfig(
    pretraining=FIRST, iterations=2, velocities=3, perturbations=2, T=0.7, N_query=3, T_query=0.52
)


def test_queries_have_the_methods_number_and_times(tmp_path):
    config = replace(CONFIG, method=replace(QUERY, before_fall=0.35))
    assert collection(Run(tmp_path / "run", config), 1).then == Query(3, 0.52, before_fall=0.35)


def test_queries_of_rollouts_that_ended_early_and_queries_that_fail(tmp_path, monkeypatch):
    main = {
        "heights": {1: spells((550, NEVER, FALLEN)), 4: spells((300, NEVER, FALLEN))},
        "lost": {2: 150, 3: 201, 5: 200},
    }
    # Robots 2 and 5 have no state 0.2 s before their end, robot 3 has its first and no other.
    asked = {"heights": {4: spells((500, NEVER, FALLEN))}, "lost": {7: 10}}
    run, cost, ((_, rollouts), (queries, answered)) = one_iteration(
        tmp_path, monkeypatch, QUERY, main, asked
    )
    assert rollouts.length.tolist() == [700, 550, 150, 201, 500, 200]
    rows = [0, 0, 0, 1, 1, 1, 3, 4, 4, 4]
    parts = [1, 2, 3, 1, 2, 3, 1, 1, 2, 3]
    ids = [100_000 + b + part * PART for b, part in zip(rows, parts, strict=True)]
    assert queries.episode.tolist() == ids
    elapsed = queries.starts.tick - rollouts.starts.tick[rows]
    assert (elapsed % GRID == 0).all() and (elapsed >= 0).all()
    latest = np.array([699, 350, 1, 300]).repeat([3, 3, 1, 3])
    assert (elapsed <= latest).all() and elapsed[6] == 0
    assert len(set(zip(rows, elapsed.tolist(), strict=True))) == 10  # no state twice
    assert elapsed[:3].max() > 350  # a robot that did not fall is asked about its whole rollout
    assert answered.length.tolist() == [520] * 4 + [500, 520, 520, 10] + [520] * 2
    frames = run.dataset.load()
    good = [e for n, e in enumerate(ids) if n not in (4, 7)]
    assert np.unique(frames.episode).tolist() == sorted(good)
    assert len(frames) == 8 * 520 == cost.frames_kept
    assert (cost.queries, cost.queries_failed, cost.falls) == (10, 2, 5)


def test_no_queries_if_every_rollout_ended_too_early(tmp_path, monkeypatch):
    lost = {"lost": dict.fromkeys(range(6), 200)}
    run, cost, pairs = one_iteration(tmp_path, monkeypatch, QUERY, lost)
    assert len(pairs) == 1
    assert (cost.queries, cost.frames_kept, run.dataset.frames) == (0, 0, 0)
    assert (cost.falls, cost.takeovers) == (6, 0)  # iteration 1 is the expert's


def test_queries_are_pushed_early_and_once_by_the_experts_impulse(tmp_path):
    """Once each, early, by nothing else: as if they were all tail."""
    method = replace(SMALL_METHODS["loco_dagger"], T_query=0.3)
    for name, impulse in (("a", (0.2, 0.3)), ("b", (0.0, 0.0))):
        disturbance = DisturbanceConfig(pushes=2, impulse=(0.05, 0.06), expert_impulse=impulse)
        config = replace(CONFIG, method=method, collection=disturbance)
        run = with_random_policy(tmp_path / name, config)
        _, (job, rollouts) = replayed(run, 1)
        drawn = draw_disturbances(
            replace(disturbance, pushes=0), CONFIG.seed, job.episode, 0.0, 0.5, 0.3
        ).pushes
        assert (drawn is None) == (impulse[1] == 0.0)
        if drawn is not None:
            size = np.linalg.norm(drawn.impulse[:, 0], axis=1)
            assert drawn.tick.shape == (12, 1) and drawn.tick.max() < 200 and np.ptp(drawn.tick) > 9
            assert size.min() > 0.2 and size.max() < 0.3
        for b in range(12):
            expected = 0.0 if drawn is None else expected_kicks(drawn, rollouts, b)
            np.testing.assert_allclose(kicks(rollouts, b), expected, rtol=0, atol=1e-9)


def test_a_query_of_the_experts_own_rollout_goes_on_as_the_rollout_did(tmp_path):
    """In iteration 1 the expert drives, with noise and late torques; the toy rounds its roll."""
    disturbance = DisturbanceConfig(noise=StateNoiseConfig(*[1e-3] * 6), delay=5)
    method = replace(SMALL_METHODS["loco_dagger"], T_query=0.1)
    run = with_random_policy(tmp_path, replace(CONFIG, method=method, collection=disturbance))
    (job, rollouts), (queries, answered) = replayed(run, 1)
    compared = 0
    for n, id_ in enumerate(queries.episode.tolist()):
        b = int(np.flatnonzero(job.episode == id_ % PART)[0])
        begin = int(queries.starts.tick[n] - rollouts.starts.tick[b])
        ticks = min(100, int(rollouts.length[b]) - begin)
        for name in ("v", "torque"):
            expected = getattr(rollouts, name)[b, begin : begin + ticks]
            actual = getattr(answered, name)[n, :ticks]
            np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9)
        compared += ticks
    assert compared > 900
