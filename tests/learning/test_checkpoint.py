"""Checkpoints: they bring a fit back to the bit, or change nothing."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from surefoot.learning.checkpoint import key_of, load_checkpoint, save_checkpoint
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE
from tests.fakes.learning import FLOAT32, SMALL, SPEC, toy_frames
from tests.fuzz.tensors import contents, sealed

LOSSES = [(0.1, float("nan")), (1 / 3, 0.2)]


def network_and_optimizer(seed, steps=0):
    network = PolicyNetwork(SMALL, seed).train()
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
    inputs = torch.randn(32, INPUT_SIZE, generator=torch.Generator().manual_seed(seed))
    for _ in range(steps):
        optimizer.zero_grad()
        network(inputs).abs().mean().backward()
        optimizer.step()
    return network, optimizer


def tensors_of(network, optimizer):
    """Copies of all weights and of all of Adam's moments, by name."""
    tensors = dict(network.state_dict())
    for number, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"{number} {name}": tensor for name, tensor in moments.items()}
    return {name: tensor.clone() for name, tensor in tensors.items()}


def assert_same_tensors(one, other):
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)


@pytest.fixture
def stored(tmp_path):
    """A checkpoint of the fit "key", and what it holds."""
    path = tmp_path / "fit.safetensors"
    network, optimizer = network_and_optimizer(1, steps=3)
    save_checkpoint(path, "key", network, optimizer, LOSSES)
    return path, tensors_of(network, optimizer)


def test_network_optimizer_and_losses_come_back_to_the_bit(stored):
    path, expected = stored
    network, optimizer = network_and_optimizer(2)
    losses = load_checkpoint(path, "key", network, optimizer)
    np.testing.assert_array_equal(losses, LOSSES)
    assert any("exp_avg" in name for name in expected)
    assert_same_tensors(tensors_of(network, optimizer), expected)


def test_a_fit_of_anything_else_has_another_key():
    def key(seed_of_network=0, episode=0, config=FLOAT32, spec=SPEC, epochs=2, seed=0):
        network = PolicyNetwork(SMALL, seed_of_network)
        cpu = torch.device("cpu")
        return key_of(network, toy_frames([episode]), config, spec, epochs, seed, cpu)

    others = [
        key(seed_of_network=1),
        key(episode=1),
        key(config=replace(FLOAT32, batch=64)),
        key(spec=replace(SPEC, kp=9.0)),
        key(epochs=3),
        key(seed=1),
    ]
    assert len({key(), key(), *others}) == 7


def flip(content):
    return content[:-50] + bytes([content[-50] ^ 1]) + content[-49:]


@pytest.mark.parametrize("damage", [flip, lambda content: content[:-9], lambda content: b""])
def test_a_damaged_file_changes_nothing(stored, damage):
    path, _ = stored
    path.write_bytes(damage(path.read_bytes()))
    assert_nothing_changes(path, "key")


def test_a_file_of_another_fit_or_none_changes_nothing(stored):
    path, _ = stored
    assert_nothing_changes(path, "another key")
    assert_nothing_changes(path.with_name("no file"), "key")


def assert_nothing_changes(path, key):
    network, optimizer = network_and_optimizer(2)
    before = tensors_of(network, optimizer)
    assert load_checkpoint(path, key, network, optimizer) == []
    assert_same_tensors(tensors_of(network, optimizer), before)


def test_many_epochs_do_not_make_the_header_too_long(tmp_path):
    losses = [(1 / 3, 2 / 3)] * 200_000
    network, optimizer = network_and_optimizer(1, steps=1)
    save_checkpoint(tmp_path / "fit.safetensors", "key", network, optimizer, losses)
    assert load_checkpoint(tmp_path / "fit.safetensors", "key", network, optimizer) == losses


@pytest.mark.parametrize(
    "change",
    [
        lambda tensors: tensors.pop("network.mean"),
        lambda tensors: tensors.update({"network.mean": torch.zeros(46)}),
        lambda tensors: tensors.update({"other": torch.zeros(1)}),
        lambda tensors: tensors.pop("optimizer.0.step"),
        lambda tensors: tensors.update({"optimizer.0.exp_avg": torch.zeros(1)}),
        lambda tensors: tensors.pop("losses"),
        lambda tensors: tensors.update({"losses": torch.zeros(3)}),
        lambda tensors: tensors["network.linear.0.bias"].fill_(torch.nan),
        lambda tensors: tensors["network.norm.0.running_var"].fill_(-1.0),
        lambda tensors: tensors["optimizer.0.step"].fill_(-1.0),  # Adam divides by zero
        lambda tensors: tensors["optimizer.0.step"].fill_(-1e38),
        lambda tensors: tensors["optimizer.0.exp_avg_sq"].fill_(-1.0),
    ],
)
def test_other_tensors_with_a_valid_hash_change_nothing(stored, change):
    path, _ = stored
    tensors, header = contents(path)
    change(tensors)
    path.write_bytes(sealed(tensors, header))
    assert_nothing_changes(path, "key")
