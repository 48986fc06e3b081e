"""The network: its initial weights, its normalizers, and the folding of both into plain layers."""

from typing import Any

import numpy as np
import pytest
import torch

from surefoot.config import PolicyConfig
from surefoot.learning.network import PolicyNetwork, network_from_tensors, tensor_kinds
from surefoot.learning.observation import INPUT_SIZE
from tests.fakes.learning import SMALL, trained_network


def test_initial_weights_are_kaiming_normal():
    network: Any = PolicyNetwork(PolicyConfig(), seed=3)
    for layer in network.linear:
        weight = layer.weight.detach()
        assert not layer.bias.detach().any()
        expected = np.sqrt(2 / weight.shape[1])
        assert weight.std().item() == pytest.approx(expected, rel=0.1)
    assert [tuple(layer.weight.shape) for layer in network.linear] == [
        (512, 47),
        (512, 512),
        (512, 512),
        (12, 512),
    ]


def test_the_seed_fixes_the_weights_and_leaves_the_global_generator_alone():
    torch.manual_seed(0)
    one = PolicyNetwork(SMALL, 1).state_dict()
    drawn = torch.rand(3)
    torch.manual_seed(0)
    assert torch.equal(drawn, torch.rand(3))
    same = PolicyNetwork(SMALL, 1).state_dict()
    other = PolicyNetwork(SMALL, 2).state_dict()
    assert all(torch.equal(one[name], same[name]) for name in one)
    assert not torch.equal(one["linear.0.weight"], other["linear.0.weight"])


def test_normalizers_center_and_scale_all_inputs_but_constant_ones():
    torch.manual_seed(0)
    inputs = torch.randn(1000, INPUT_SIZE) * 3 + 5
    inputs[:, 4] = 0.1  # constant, and not exact in binary
    inputs[:, 45] *= 1e-9  # constant, and about zero
    network = PolicyNetwork(SMALL)
    assert not network.has_normalisers
    network.set_normalizers(inputs.double().mean(0), inputs.double().std(0, correction=0))
    assert network.has_normalisers
    assert network.scale[4] == 1
    assert network.scale[45] == 1
    normal = (inputs - network.mean) / network.scale
    varying = [i for i in range(INPUT_SIZE) if i not in (4, 45)]
    assert normal.mean(0).abs().max() < 1e-5
    assert (normal[:, varying].std(0, correction=0) - 1).abs().max() < 1e-5


@pytest.mark.parametrize("config", [SMALL, PolicyConfig()], ids=["small", "paper"])
def test_folded_layers_compute_what_the_network_computes(config):
    network = trained_network(config)
    inputs = torch.randn(30, INPUT_SIZE, generator=torch.Generator().manual_seed(1))
    values = inputs.double()
    layers = network.folded()
    for number, (weight, bias) in enumerate(layers):
        values = values @ weight.double() + bias.double()
        if number < len(layers) - 1:
            values = values.relu()
    with torch.no_grad():
        expected = network(inputs).double()
    torch.testing.assert_close(values, expected, atol=2e-5, rtol=2e-5)


@pytest.mark.parametrize("hidden", [(64, 64), (5,)])
def test_the_table_of_tensors_is_that_of_a_network(hidden):
    state = PolicyNetwork(PolicyConfig(hidden=hidden)).state_dict()
    kinds = {kind.name: (kind.shape, kind.dtype) for kind in tensor_kinds(hidden, INPUT_SIZE)}
    assert kinds == {name: (tuple(t.shape), t.dtype) for name, t in state.items()}


def test_a_network_comes_back_from_its_tensors():
    network = trained_network(SMALL)
    again = network_from_tensors(SMALL, network.state_dict())
    assert not again.training
    inputs = torch.randn(9, INPUT_SIZE)
    assert torch.equal(again(inputs), network(inputs))


def test_folding_leaves_the_network_as_it_is():
    network = trained_network(SMALL)
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    network.folded()
    assert all(torch.equal(tensor, before[name]) for name, tensor in network.state_dict().items())
