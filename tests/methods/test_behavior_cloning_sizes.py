"""Behavior cloning on the toy: a series of sizes of D, and a policy from scratch at each."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from surefoot.config import BehaviorCloningConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import load
from surefoot.learning.train import fit
from tests.fakes.learning import spec_of
from tests.fakes.runs import collected, trained
from tests.fakes.toy import Worlds
from tests.fakes.toy_runs import CONFIG, FIRST, run_method

pytestmark = pytest.mark.usefixtures("toys")


def trained_from_scratch(run, size, frames):
    """What training from random weights on these frames gives."""
    network = PolicyNetwork(CONFIG.policy, run.torch_seed("network", 0))
    order = run.torch_seed("order", size)
    return fit(network, frames, CONFIG.training, spec_of(CONFIG.policy), 2, order).network


@pytest.mark.parametrize(("size", "episodes"), [(0, 3), (1, 13), (2, 22)])
def test_cloning_at_each_size_is_from_scratch_on_the_first_whole_episodes(runs, size, episodes):
    """700 frames are three episodes of 200, 2600 are thirteen: both end within a shard of four."""
    run = runs("behavior_cloning")
    frames = run.dataset.load()
    first = frames[frames.episode < episodes]
    assert len(first) == 200 * episodes == trained(run, size).frames
    policy = load(run.policy_path(size))
    assert policy.provenance["dataset_hash"] == first.hash
    for key, tensor in trained_from_scratch(run, size, first).state_dict().items():
        assert torch.equal(tensor, policy.network.state_dict()[key]), key


def test_episodes_that_failed_do_not_count_in_the_series(tmp_path, monkeypatch):
    """Episode 1 is lost: 600 frames are episodes 0, 2 and 3."""
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds({"lost": {1: 50}}))
    method = BehaviorCloningConfig(data=FIRST, epochs=2, frames=(600, 799, 800))
    run = run_method(tmp_path, replace(CONFIG, method=method))
    frames = run.dataset.load()
    assert 1 not in frames.episode and collected(run, 0).failed_episodes == (1,)
    for size, ids in enumerate([[0, 2, 3], [0, 2, 3], [0, 2, 3, 4]]):
        first = frames[np.isin(frames.episode, ids)]
        assert load(run.policy_path(size)).provenance["dataset_hash"] == first.hash
