"""The time of a training step and its lower bound, on a clock that the test moves."""

from dataclasses import replace

import pytest

import surefoot.bench.train as train_module
from surefoot.bench.train import bench_train, chosen_step_seconds
from surefoot.config import Config, PolicyConfig
from surefoot.learning.precision import PrecisionChoice
from tests.fakes.learning import FLOAT32

SMALL = Config(policy=PolicyConfig(hidden=(32, 32)), training=FLOAT32)
STEP_SECONDS = {"bfloat16": 4e-3, "float32": 10e-3}
PRODUCT_SECONDS = {"bfloat16": 1e-3, "float32": 2e-3}
STEPS = 7


@pytest.fixture
def clock(monkeypatch) -> None:
    """Everything takes the times above; plain PyTorch takes 12 ms a step."""
    now = [0.0]

    def fit(network, frames, training, spec, epochs, seed, progress):
        assert len(frames) == STEPS * training.batch
        assert (training.threads, training.device, training.validation) == (1, "cpu", 0.0)
        now[0] += 100.0  # inputs and targets are derived in the first epoch
        for epoch in range(epochs):
            now[0] += STEPS * STEP_SECONDS[training.precision]
            progress(epoch, epochs, 0.0, 0.0)

    monkeypatch.setattr(train_module.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(train_module, "fit", fit)
    monkeypatch.setattr(train_module, "_eager_step_seconds", lambda *_: 12e-3)
    monkeypatch.setattr(train_module, "_network_products", lambda network, batch, name: name)
    monkeypatch.setattr(train_module, "median_seconds", lambda name, _: PRODUCT_SECONDS[name])


def test_a_step_is_measured_in_the_precision_that_a_run_would_choose(clock, monkeypatch):
    assert chosen_step_seconds(SMALL, STEPS) == pytest.approx(STEP_SECONDS["float32"])
    choice = PrecisionChoice("bfloat16")
    monkeypatch.setattr(train_module, "choose_precision", lambda network, training: choice)
    auto = replace(SMALL, training=replace(FLOAT32, precision="auto"))
    assert chosen_step_seconds(auto, STEPS) == pytest.approx(STEP_SECONDS["bfloat16"])


def test_both_precisions_are_compared_with_plain_pytorch_and_the_products(clock):
    speed = bench_train(SMALL, STEPS)
    assert speed.batch == SMALL.training.batch
    assert speed.float32_step_ms == pytest.approx(10.0)
    assert speed.bfloat16_step_ms == pytest.approx(4.0)
    assert speed.eager_step_ms == pytest.approx(12.0)
    assert speed.ratio_to_eager == pytest.approx(4 / 12)
    assert speed.floor_step_ms == pytest.approx(3.0)  # one product forward and two backward
    assert speed.ratio == pytest.approx(4 / 3)
    assert (speed.chosen, speed.ratio_to_better) == ("float32", pytest.approx(2.5))


def test_with_auto_the_choice_of_a_run_is_compared_with_the_better_one(clock, monkeypatch):
    asked = []

    def choose(network, training):
        asked.append((network.hidden, training.precision))
        return PrecisionChoice("bfloat16")

    monkeypatch.setattr(train_module, "choose_precision", choose)
    speed = bench_train(replace(SMALL, training=replace(FLOAT32, precision="auto")), STEPS)
    assert asked == [((32, 32), "auto")]
    assert (speed.chosen, speed.ratio_to_better) == ("bfloat16", 1.0)


def test_real_steps_take_longer_than_their_products(monkeypatch):
    monkeypatch.setattr(train_module, "REPEATS", 1)
    speed = bench_train(SMALL, steps=5)
    assert speed.ratio > 1
    assert min(speed.float32_step_ms, speed.bfloat16_step_ms, speed.eager_step_ms) > 0


@pytest.mark.parametrize("layout", ["full", "proprioceptive"])
def test_a_network_of_any_layout_is_timed(layout):
    policy = PolicyConfig(hidden=(8, 8), kp=2.0, kd=0.1, layout=layout)
    training = replace(FLOAT32, batch=16)
    speed = bench_train(Config(policy=policy, training=training), 2)
    assert min(speed.float32_step_ms, speed.eager_step_ms, speed.floor_step_ms) > 0.0
