"""Time of a training step, beside PyTorch's eager one and its matrix products."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from surefoot.bench.engine import _seconds
from surefoot.config import Config, TrainingConfig
from surefoot.learning.frames import Frames
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.policy import policy_spec
from surefoot.learning.step import has_bfloat16
from surefoot.learning.train import fit


def bench_train(config: Config, steps: int = 100) -> dict[str, Any]:
    """Time of a training step, one thread, beside PyTorch's eager float32 and its matrix products.

    Returns:
        ``step_ms`` in the configured precision; ``eager_step_ms``, the same step in float32, and
        ``ratio_to_eager``; ``floor_step_ms``, the products of a step in the configured precision,
        forward and backward, and ``ratio`` to it; ``batch``, ``precision``.
    """
    batch = config.training.batch
    training = replace(config.training, validation=0.0, threads=1, device="cpu")
    frames = _random_frames(steps * batch)
    network = PolicyNetwork(config.policy)
    short = training.precision == "bfloat16" and has_bfloat16(torch.device("cpu"))

    def step_of(training: TrainingConfig) -> float:
        # The second epoch is steps only; before the first, inputs and labels are derived.
        ends: list[float] = []
        progress = lambda *_: ends.append(time.perf_counter())  # noqa: E731
        fit(network, frames, training, policy_spec(config), 2, 0, progress)
        return (ends[1] - ends[0]) / steps

    rounds = [
        (
            step_of(training),
            step_of(replace(training, precision="float32")),
            # Backward: one product for the inputs, one for the weights.
            3 * _seconds(_network_products(network, batch, short), 30),
        )
        for _ in range(3)
    ]
    step, eager, least = (1e3 * float(np.median(times)) for times in zip(*rounds, strict=True))
    return {
        "batch": batch,
        "precision": "bfloat16" if short else "float32",
        "step_ms": step,
        "eager_step_ms": eager,
        "ratio_to_eager": step / eager,
        "floor_step_ms": least,
        "ratio": step / least,
    }


def _network_products(network: PolicyNetwork, batch: int, short: bool) -> Callable[[], None]:
    """The matrix products of one forward pass and nothing else, on one thread."""
    kind = torch.bfloat16 if short else torch.float32
    weights = [weight.to(kind) for weight, _ in network.folded()]
    inputs = [torch.randn(batch, size, dtype=kind) for size in (INPUT_SIZE, *network.hidden)]
    torch.set_num_threads(1)

    def products() -> None:
        with torch.inference_mode():
            for x, weight in zip(inputs, weights, strict=True):
                torch.mm(x, weight)

    return products


def _random_frames(n: int) -> Frames:
    """Frames of noise around a standing robot; the time of a step does not depend on them."""
    rng = np.random.default_rng(0)
    q = np.zeros((n, 19))
    q[:, 6] = 1.0
    q[:, 7:] = rng.standard_normal((n, 12))
    return Frames(
        q=q,
        v=rng.standard_normal((n, 18)),
        com=rng.standard_normal((n, 3)),
        feet=rng.standard_normal((n, 4, 3)),
        contacts=np.ones((n, 4), dtype=bool),
        tick=np.arange(n),
        command=np.zeros((n, 3)),
        torque=rng.standard_normal((n, 12)),
        expert_drove=np.ones(n, dtype=bool),
        episode=np.zeros(n, dtype=np.int64),
        outcome=np.zeros(n, dtype=np.int8),
    )
