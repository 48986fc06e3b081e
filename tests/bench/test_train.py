"""The time of a training step and its lower bound, on a clock that the test moves."""

import pytest

import surefoot.bench.train as train_module
from surefoot.bench.train import bench_train
from surefoot.config import Config, PolicyConfig

SMALL = Config(policy=PolicyConfig(hidden=(32, 32)))
STEP_SECONDS = {"bfloat16": 4e-3, "float32": 10e-3}


def test_a_step_is_compared_with_eager_pytorch_and_with_its_products(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(train_module.time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(train_module, "median_seconds", lambda products, repeats: 1e-3)
    steps = 7

    def fit(network, frames, training, spec, epochs, seed, progress):
        assert len(frames) == steps * training.batch
        assert (training.threads, training.device, training.validation) == (1, "cpu", 0.0)
        now[0] += 100.0  # inputs and targets are derived in the first epoch
        for epoch in range(epochs):
            now[0] += steps * STEP_SECONDS[training.precision]
            progress(epoch, epochs, 0.0, 0.0)

    monkeypatch.setattr(train_module, "fit", fit)
    speed = bench_train(SMALL, steps)
    assert speed.batch == SMALL.training.batch
    assert speed.step_ms == pytest.approx(4.0)
    assert speed.eager_step_ms == pytest.approx(10.0)
    assert speed.ratio_to_eager == pytest.approx(0.4)
    assert speed.floor_step_ms == pytest.approx(3.0)  # one product forward and two backward
    assert speed.ratio == pytest.approx(4 / 3)


def test_a_step_takes_longer_than_its_products():
    speed = bench_train(SMALL, steps=5)
    assert speed.precision in ("float32", "bfloat16")
    assert speed.step_ms > speed.floor_step_ms > 0
    assert speed.eager_step_ms > 0
