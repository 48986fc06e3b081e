"""A single step of training, and the devices that compute it."""

import pytest
import torch

from surefoot.config import TrainingConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.samples import WIDTH
from surefoot.learning.step import TrainingStep, choose_device, device_name, make_optimizer
from tests.fakes.learning import SMALL

CPU = torch.device("cpu")
ROWS = torch.randn(64, WIDTH, generator=torch.Generator().manual_seed(0))


def weights_of(network):
    return network.state_dict()["linear.0.weight"].clone()


def make_step(network, weight_decay=0.0):
    config = TrainingConfig(learning_rate=1e-2, weight_decay=weight_decay)
    return TrainingStep(network, make_optimizer(network, config, CPU), 64, "float32", CPU)


def test_a_step_lowers_the_l1_loss_and_reports_the_loss_before_it():
    network = PolicyNetwork(SMALL).train()
    step = make_step(network)
    with torch.no_grad():
        before = torch.nn.functional.l1_loss(network(ROWS[:, :INPUT_SIZE]), ROWS[:, INPUT_SIZE:])
    step(ROWS)
    assert step.take_loss() == pytest.approx(before.item(), rel=1e-6)
    for _ in range(20):
        step(ROWS)
    assert step.take_loss() / 20 < 0.9 * before.item()
    assert step.take_loss() == 0.0


def test_the_learning_rate_can_be_changed_between_steps():
    network = PolicyNetwork(SMALL).train()
    step = make_step(network)
    before = weights_of(network)
    step.set_learning_rate(0.0)
    step(ROWS)
    assert torch.equal(weights_of(network), before)
    step.set_learning_rate(1e-2)
    step(ROWS)
    assert not torch.equal(weights_of(network), before)


def test_without_weight_decay_the_steps_are_those_of_plain_adam_to_the_bit():
    one = PolicyNetwork(SMALL).train()
    other = PolicyNetwork(SMALL).train()
    adam = torch.optim.Adam(other.parameters(), lr=torch.tensor(1e-2), fused=True)
    step = make_step(one)
    plain = TrainingStep(other, adam, 64, "float32", CPU)
    for _ in range(5):
        step(ROWS)
        plain(ROWS)
    for mine, theirs in zip(one.parameters(), other.parameters(), strict=True):
        assert torch.equal(mine, theirs)


def test_weight_decay_shrinks_weights_that_no_gradient_holds():
    network = PolicyNetwork(SMALL).train()
    unused = ROWS.clone()
    unused[:, 0] = 0.0  # the first input says nothing, so that its weights have no gradient
    before = weights_of(network)
    step = make_step(network, weight_decay=5.0)
    for _ in range(10):
        step(unused)
    after = weights_of(network)
    torch.testing.assert_close(after[:, 0], before[:, 0] * (1 - 1e-2 * 5.0) ** 10)
    assert not torch.allclose(after[:, 1], before[:, 1] * (1 - 1e-2 * 5.0) ** 10, rtol=1e-3)


def test_devices_are_chosen_by_name():
    assert choose_device("cpu").type == "cpu"
    assert device_name(CPU) == "cpu"
    if not torch.cuda.is_available():
        assert choose_device("auto").type == "cpu"
        with pytest.raises(ValueError, match=r"finds no GPU; use --device cpu"):
            choose_device("cuda")
    with pytest.raises(ValueError, match=r"no device 'tpu'.*auto, cpu, cuda"):
        choose_device("tpu")  # pyright: ignore[reportArgumentType]
