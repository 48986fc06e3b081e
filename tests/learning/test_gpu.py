"""Training on a GPU; this file imports no robotics, so that it runs where only PyTorch is."""

from dataclasses import replace

import pytest
import torch

from surefoot.config import TrainingConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.precision import choose_precision
from surefoot.learning.train import FitResult, fit
from tests.fakes.killed import Killed
from tests.fakes.learning import SMALL, SPEC, toy_frames

pytestmark = pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU on this machine")

FRAMES = toy_frames(range(100))
CPU = TrainingConfig(batch=64, schedule="cosine", device="cpu", precision="float32")
GPU = replace(CPU, device="cuda")


def learned(config: TrainingConfig, **kwargs) -> FitResult:
    return fit(PolicyNetwork(SMALL, seed=0), FRAMES, config, SPEC, 10, 0, **kwargs)


def assert_same_bits(one: FitResult, other: FitResult) -> None:
    assert one.train_loss == other.train_loss
    assert one.validation_loss == other.validation_loss
    states = (one.network.state_dict(), other.network.state_dict())
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_gpu_learns_as_well_as_a_cpu(precision):
    cpu = learned(CPU)
    gpu = learned(replace(GPU, precision=precision))
    assert gpu.device != "cpu"
    assert gpu.network.mean.device.type == "cpu"
    assert gpu.train_loss[0] == pytest.approx(cpu.train_loss[0], rel=0.05)
    assert gpu.validation_loss[-1] < 1.1 * cpu.validation_loss[-1]


def test_two_fits_on_a_gpu_have_the_same_bits():
    assert_same_bits(learned(GPU), learned(GPU))


def test_a_fit_killed_on_a_gpu_resumes_to_the_same_bits(tmp_path):
    path = tmp_path / "fit.safetensors"

    def die(done, *_):
        if done == 5:
            raise Killed

    with pytest.raises(Killed):
        learned(GPU, checkpoint=path, progress=die)
    assert path.exists()
    assert_same_bits(learned(GPU, checkpoint=path), learned(GPU))


def test_the_precision_is_chosen_by_measuring_on_the_gpu():
    choice = choose_precision(PolicyNetwork(SMALL, seed=0), replace(GPU, precision="auto"))
    assert choice.chosen in ("float32", "bfloat16")
    assert choice.float32_ms is not None and choice.float32_ms > 0.0
    assert choice.bfloat16_ms is not None and choice.bfloat16_ms > 0.0
