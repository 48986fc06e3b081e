"""Behaviour cloning, DAGGER and LocoDAGGER on the toy: sizes, coins, and queries."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from surefoot.config import BehaviorCloningConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import load, policy_spec
from surefoot.learning.train import fit
from surefoot.rollouts.arbiters import RandomMix
from surefoot.rollouts.jobs import play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.run import Run
from surefoot.types import State
from tests.fakes.runs import figures_of
from tests.fakes.toy import Worlds
from tests.fakes.toy_runs import (
    CONFIG,
    FIRST,
    GRID,
    answers,
    collection,
    kept_in,
    replayed,
    run_method,
)

pytestmark = pytest.mark.usefixtures("toys")


# --- behaviour cloning


def scratch(run, size, frames):
    """What training from random weights on these frames gives."""
    network = PolicyNetwork(CONFIG.policy, run.torch_seed("network", 0))
    order = run.torch_seed("order", size)
    return fit(network, frames, CONFIG.training, policy_spec(CONFIG), 2, order).network


@pytest.mark.parametrize(("size", "episodes"), [(0, 3), (1, 13), (2, 22)])
def test_cloning_at_each_size_is_from_scratch_on_the_first_whole_episodes(runs, size, episodes):
    """700 frames are three episodes of 200, 2600 are thirteen: both end within a shard of four."""
    run = runs("behavior_cloning")
    frames = run.dataset.load()
    first = frames[frames.episode < episodes]
    assert len(first) == 200 * episodes == figures_of(run, "train", size)["frames"]
    policy = load(run.policy_path(size))
    assert policy.provenance["dataset_hash"] == first.hash
    for key, tensor in scratch(run, size, first).state_dict().items():
        assert torch.equal(tensor, policy.network.state_dict()[key]), key


def test_episodes_that_failed_do_not_count_in_the_series(tmp_path, monkeypatch):
    """Episode 1 is lost: 600 frames are episodes 0, 2 and 3."""
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds({"lost": {1: 50}}))
    method = BehaviorCloningConfig(data=FIRST, epochs=2, frames=(600, 799, 800))
    run = run_method(tmp_path, replace(CONFIG, method=method))
    frames = run.dataset.load()
    assert 1 not in frames.episode and figures_of(run, "collect", 0)["failed_episodes"] == [1]
    for size, ids in enumerate([[0, 2, 3], [0, 2, 3], [0, 2, 3, 4]]):
        first = frames[np.isin(frames.episode, ids)]
        assert load(run.policy_path(size)).provenance["dataset_hash"] == first.hash


# --- DAGGER


def test_daggers_coin_is_thrown_at_every_tick_for_every_episode(runs):
    run = runs("dagger")
    assert replayed(run, 0)[0][1].expert_drove.all()  # beta_1 = 1
    drove = {}
    for i, p in ((1, 0.6), (2, 0.36)):
        ((job, record),) = replayed(run, i)
        assert job.ask_always
        for b, episode in enumerate(job.episode.tolist()):
            throws = record.expert_drove[b, : record.length[b]]
            n, change = len(throws), 2 * p * (1 - p)
            drove[episode] = throws
            assert n >= 500
            assert abs(throws.mean() - p) < 4 * np.sqrt(p * (1 - p) / n)
            changes = (throws[1:] != throws[:-1]).mean()
            assert abs(changes - change) < 6 * np.sqrt(change * (1 - change) / n)
        # Two episodes agree as often as two coins do.
        one, other = (drove[e][:500] for e in job.episode[:2].tolist())
        alike = p * p + (1 - p) * (1 - p)
        assert abs((one == other).mean() - alike) < 4 * np.sqrt(alike * (1 - alike) / 500)
    ticks = np.concatenate(list(drove.values()))
    assert 0.3 < ticks.mean() < 0.7


def shifted(job, by):
    """The same rollouts, each begun between two ticks of the grid."""
    starts = replace(job.starts, tick=job.starts.tick + by)
    return replace(job, episodes=replace(job.episodes, starts=starts))


def test_dagger_plans_on_the_grid_wherever_it_begins_and_whoever_drives(runs):
    job = shifted(collection(runs("dagger"), 2), 17)
    record, _ = play_out(job)
    assert not record.expert_drove.all(axis=1).any()
    torque = answers(record, record.happened)
    given = record.expert_torque[record.happened]
    np.testing.assert_allclose(given, torque[record.happened], rtol=0, atol=1e-9)
    drove = record.expert_drove & record.happened
    np.testing.assert_array_equal(record.torque[drove], record.expert_torque[drove])
    policy = record.happened & ~drove
    assert (np.abs(record.torque - record.expert_torque)[policy].max(-1) > 1e-6).mean() > 0.9


# --- LocoDAGGER


@pytest.mark.parametrize("by", [0, 17])
@pytest.mark.parametrize("alpha", [0.5, 0.8])
def test_locodaggers_coin_is_thrown_once_per_expert_period(runs, alpha, by):
    run = runs(f"loco_dagger-{alpha}")
    assert replayed(run, 1)[0][1].expert_drove.all()  # alpha^0 = 1
    method = replace(run.config.method, velocities=10, perturbations=6, T=0.3)
    many = Run(run.folder, replace(run.config, method=method))
    job = shifted(replace(collection(many, 2), then=None), by)
    record, _ = play_out(job)
    assert (record.length == 300).all()
    throws = []
    for b in range(60):
        drove, clock = record.expert_drove[b], job.starts.tick[b] + np.arange(300)
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
        ids, still = np.arange(2000), np.zeros(2000, int)
        coin.reset(ids)
        nobody: State = None  # type: ignore[assignment]
        said = [coin.choose(nobody, still + 50 * t, np.zeros((2000, 3))) for t in range(20)]
        sd = np.sqrt(share * (1 - share) / 40_000)
        assert abs(np.mean(said) - share) <= 4.5 * sd


@pytest.mark.parametrize("alpha", [0.5, 0.8])
@pytest.mark.parametrize("i", [1, 2])
def test_queries_are_of_states_that_the_rollout_visited(runs, alpha, i):
    run = runs(f"loco_dagger-{alpha}")
    method = run.config.method
    (job, record), (queries, answered) = replayed(run, i)
    N, T = method.N_query, round(1000 * method.T_query)
    assert len(queries.starts) == N * len(job.starts)
    assert len(np.unique([*queries.episode, *job.episode])) == (N + 1) * len(job.starts)
    assert answered.duration == T and answered.expert_drove.all()
    seen = []
    for n, first in enumerate(queries.episode.tolist()):
        b = n // N
        start = queries.starts[n : n + 1]
        elapsed = int(start.tick[0] - record.starts.tick[b])
        seen.append(elapsed)
        failed = record.outcome[b] == Outcome.FELL
        assert 0 <= elapsed <= record.length[b] - (200 if failed else 1)
        assert start.tick[0] % GRID == 0
        np.testing.assert_array_equal(start.q[0, 2:], record.q[b, elapsed, 2:])
        np.testing.assert_array_equal(start.v[0], record.v[b, elapsed])
        np.testing.assert_array_equal(start.command[0], record.starts.command[b])
        np.testing.assert_array_equal(answered.q[n, 0], start.q[0])
        assert first // 100_000 == i
    assert len(set(seen)) > 5
    figures = figures_of(run, "collect", i)
    assert figures["queries"] == N * len(job.starts)
    failures = int((answered.outcome == Outcome.FELL).sum())
    assert figures["queries_failed"] == failures
    frames = kept_in(run, i)
    assert len(frames) == (len(queries.starts) - failures) * T == figures["frames_kept"]
    assert set(frames.episode) <= set(queries.episode)
