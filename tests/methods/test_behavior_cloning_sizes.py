"""Behavior cloning on the toy: a series of sizes of D, and a policy from scratch at each."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from surefoot.config import BehaviorCloningConfig
from surefoot.config.presets import preset
from surefoot.files import save_arrays
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import load
from surefoot.learning.train import fit
from surefoot.runs.run import create
from surefoot.runs.sampling import series_order
from surefoot.runs.stages import first_frames
from surefoot.scenarios.starts import load_starts
from tests.fakes.learning import spec_of
from tests.fakes.rollouts import summary_of
from tests.fakes.runs import collected, trained
from tests.fakes.toy import Worlds
from tests.fakes.toy_runs import CONFIG, FIRST, collection, run_method

pytestmark = pytest.mark.usefixtures("toys")


def trained_from_scratch(run, size, frames):
    """What training from random weights on these frames gives."""
    network = PolicyNetwork(CONFIG.policy, run.torch_seed("network", 0))
    order = run.torch_seed("order", size)
    return fit(network, frames, CONFIG.training, spec_of(CONFIG.policy), 2, order).network


def shuffled(run):
    """The episodes in the order of the series: at any time each phase has had its share."""
    phase = load_starts().phases(collection(run, 0).starts.id)
    return series_order(phase, np.random.default_rng(run.seed("series", 0)))


@pytest.mark.parametrize(("size", "episodes"), [(0, 3), (1, 13), (2, 22)])
def test_cloning_at_each_size_is_from_scratch_on_whole_episodes_in_random_order(
    runs, size, episodes
):
    """700 frames are three episodes of 200, 2600 are thirteen."""
    run = runs("behavior_cloning")
    frames = run.dataset.load()
    order = shuffled(run)
    assert (np.diff(order[:episodes]) < 0).any()
    first = frames[np.isin(frames.episode, order[:episodes])]
    record = trained(run, size)
    assert len(first) == 200 * episodes == record.frames
    assert (record.episodes, record.dataset_hash) == (episodes, first.hash)
    policy = load(run.policy_path(size))
    assert policy.provenance["dataset_hash"] == first.hash
    for key, tensor in trained_from_scratch(run, size, first).state_dict().items():
        assert torch.equal(tensor, policy.network.state_dict()[key]), key


def test_a_series_may_end_with_its_largest_size(tmp_path, runs):
    method = BehaviorCloningConfig(data=FIRST, epochs=2, frames=(700, 2600), all_frames=False)
    run = run_method(tmp_path, replace(CONFIG, method=method))
    whole = runs("behavior_cloning")
    assert run.trained(2) is None
    assert run.best_policy_path == run.policy_path(1)
    assert run.dataset.hash == whole.dataset.hash
    for size in (0, 1):
        assert run.policy_path(size).read_bytes() == whole.policy_path(size).read_bytes()


def test_episodes_that_failed_do_not_count_in_the_series(tmp_path, monkeypatch):
    """One of the first four of the order is lost: 600 frames are three others."""
    method = BehaviorCloningConfig(data=FIRST, epochs=2, frames=(600, 799, 800))
    config = replace(CONFIG, method=method)
    order = shuffled(create(tmp_path / "other", config)).tolist()
    lost = next(id_ for id_ in order[:4] if id_ < CONFIG.chunk)
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds({"lost": {lost: 50}}))
    run = run_method(tmp_path, config)
    frames = run.dataset.load()
    assert collected(run, 0).failed_episodes == (lost,)
    order.remove(lost)
    for size, count in enumerate([3, 3, 4]):
        first = frames[np.isin(frames.episode, order[:count])]
        assert load(run.policy_path(size)).provenance["dataset_hash"] == first.hash


@pytest.mark.parametrize("seed", range(20))
def test_the_smallest_size_of_the_papers_series_has_all_phases(tmp_path, monkeypatch, seed):
    """112k frames of 400 rollouts of 3 s; they used to be the first two phases."""
    config = replace(preset("behavior_cloning", "paper"), seed=seed)
    run = create(tmp_path / "run", config)
    starts = collection(run, 0).starts
    summary = summary_of(np.zeros(400), episode=np.arange(400), start=starts.id, kept=[3000] * 400)
    save_arrays(run.summary_path("all"), summary)
    chosen = []
    dataset = SimpleNamespace(shards=("all",), only=chosen.extend)
    monkeypatch.setattr(run, "dataset", dataset)
    first_frames(run, 112_000)
    assert len(chosen) == 37
    phases, counts = np.unique(starts.tick[chosen], return_counts=True)
    assert phases.tolist() == [50 * phase for phase in range(10)]
    assert set(counts) == {3, 4}
    assert len(np.unique(starts.command[chosen, 0])) > 12
