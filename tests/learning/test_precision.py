"""Which number format training multiplies in: the named one, or the one that takes less time."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import surefoot.learning.precision as precision_module
from surefoot.config import TrainingConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.precision import (
    MOST_ROWS,
    PrecisionChoice,
    choose_precision,
    faster_of,
    step_seconds,
)
from surefoot.learning.samples import WIDTH
from surefoot.learning.train import fit
from tests.fakes.learning import SMALL, SPEC, toy_frames

CPU = torch.device("cpu")
AUTO = TrainingConfig(batch=64)


@pytest.fixture
def measured(monkeypatch) -> list:
    """Steps seem to take 2 ms in float32 and 1 ms in bfloat16; each measurement is noted."""
    calls = []

    def seconds(network, config, device):
        calls.append((network, config, device))
        return {"float32": 2e-3, "bfloat16": 1e-3}

    monkeypatch.setattr(precision_module, "step_seconds", seconds)
    return calls


@pytest.mark.parametrize("name", ["float32", "bfloat16"])
def test_a_named_precision_is_taken_without_measuring(measured, name):
    choice = choose_precision(PolicyNetwork(SMALL), replace(AUTO, precision=name))
    assert choice == PrecisionChoice(name)
    assert str(choice) == f"training in {name}"
    assert measured == []


def test_the_precision_is_measured_by_default(measured):
    network = PolicyNetwork(SMALL)
    assert choose_precision(network, replace(AUTO, device="cpu")).chosen == "bfloat16"
    assert measured == [(network, replace(AUTO, device="cpu"), CPU)]


@pytest.mark.parametrize(
    ("float32", "bfloat16", "text"),
    [
        (4e-3, 6.68e-3, "training in float32 (bfloat16 would take 1.67 times as long here)"),
        (4e-3, 2e-3, "training in bfloat16 (float32 would take 2.00 times as long here)"),
        (4e-3, 3.96e-3, "training in float32 (bfloat16 would take 0.99 times as long here)"),
    ],
)
def test_the_clearly_faster_one_is_chosen(float32, bfloat16, text):
    """Where both take as long, that is float32."""
    choice = faster_of({"float32": float32, "bfloat16": bfloat16})
    assert str(choice) == text
    assert choice.float32_ms == pytest.approx(1e3 * float32)
    assert choice.bfloat16_ms == pytest.approx(1e3 * bfloat16)


def test_steps_are_timed_in_turns_and_each_has_its_median(monkeypatch):
    now = [0.0]
    taken = []

    class Step:
        def __init__(self, network, optimizer, batch, name, device):
            assert network.training
            self.name = name

        def __call__(self, rows):
            assert rows.shape == (MOST_ROWS, WIDTH)
            taken.append(self.name)
            # Every fifth step is disturbed by something else.
            slow = 1.0 if len(taken) % 5 == 0 else 0.0
            now[0] += slow + {"float32": 0.01, "bfloat16": 0.03}[self.name]

        def take_loss(self):
            now[0] += 0.01

    monkeypatch.setattr(precision_module, "TrainingStep", Step)
    monkeypatch.setattr(precision_module.time, "process_time", lambda: now[0])
    monkeypatch.setattr(precision_module.time, "perf_counter", lambda: now[0])
    seconds = step_seconds(PolicyNetwork(SMALL), replace(AUTO, batch=1_000_000), CPU)
    assert seconds == {"float32": pytest.approx(0.02), "bfloat16": pytest.approx(0.04)}
    assert taken == ["float32"] * 5 + ["bfloat16"] * 5 + ["float32", "bfloat16"] * 5


def test_real_steps_leave_network_threads_and_generator_alone(monkeypatch):
    monkeypatch.setattr(precision_module, "SECONDS", 0.0)
    network = PolicyNetwork(SMALL)
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    generator = torch.get_rng_state()
    threads = torch.get_num_threads()
    torch.set_num_threads(threads + 1)
    try:
        seconds = step_seconds(network, AUTO, CPU)
        assert torch.get_num_threads() == threads + 1
    finally:
        torch.set_num_threads(threads)
    assert min(seconds.values()) > 0
    assert all(torch.equal(before[name], value) for name, value in network.state_dict().items())
    assert torch.equal(torch.get_rng_state(), generator)


@pytest.mark.parametrize("name", ["float32", "bfloat16"])
def test_a_fit_by_measurement_has_the_bits_of_the_one_that_names_the_result(monkeypatch, name):
    def seconds(network, config, device):
        return {"float32": 2.0, "bfloat16": 2.0} | {name: 1.0}

    monkeypatch.setattr(precision_module, "step_seconds", seconds)
    frames = toy_frames(range(20))
    chosen = fit(PolicyNetwork(SMALL), frames, AUTO, SPEC, 2, 0)
    named = fit(PolicyNetwork(SMALL), frames, replace(AUTO, precision=name), SPEC, 2, 0)
    assert chosen.precision == named.precision == name
    assert chosen.train_loss == named.train_loss
    for one, other in zip(chosen.network.parameters(), named.network.parameters(), strict=True):
        np.testing.assert_array_equal(one.detach().numpy(), other.detach().numpy())


def test_a_gpu_without_bfloat16_trains_in_float32_and_refuses_the_other(monkeypatch, measured):
    gpu = torch.device("cuda")
    monkeypatch.setattr(precision_module, "choose_device", lambda name: gpu)
    monkeypatch.setattr(precision_module, "has_bfloat16", lambda device: False)
    monkeypatch.setattr(precision_module, "device_name", lambda device: "Old GPU")
    network = PolicyNetwork(SMALL)
    assert choose_precision(network, AUTO) == PrecisionChoice("float32")
    assert measured == []
    with pytest.raises(ValueError, match=r"bfloat16, for which Old GPU has no .*auto or float32"):
        choose_precision(network, replace(AUTO, precision="bfloat16"))
