"""Time of a training step, compared with PyTorch's eager step and with a lower bound.

The lower bound is the time of the step's matrix products alone. The figures are of one machine and
moment: trust the ratios. Next: `end_to_end`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from surefoot.bench.engine import median_seconds
from surefoot.config import Config, TrainingConfig
from surefoot.learning.frames import Frames
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.policy import policy_spec
from surefoot.learning.step import has_bfloat16
from surefoot.learning.train import fit


@dataclass(frozen=True)
class TrainSpeed:
    """Wall time of a training step, on one thread.

    Attributes:
        batch: Number of frames of a step.
        precision: Precision of the matrix products: the configured one, if the processor has it.
        step_ms: Time of a step [ms].
        eager_step_ms: Time of PyTorch's eager step in float32 [ms].
        ratio_to_eager: ``step_ms`` over ``eager_step_ms``.
        floor_step_ms: Lower bound: time of the step's products, forward and backward [ms].
        ratio: ``step_ms`` over ``floor_step_ms``; 1 at best.
    """

    batch: int
    precision: str
    step_ms: float
    eager_step_ms: float
    ratio_to_eager: float
    floor_step_ms: float
    ratio: float


def bench_train(config: Config, steps: int = 100) -> TrainSpeed:
    """Measure a training step, on one thread.

    Args:
        config: Configuration of policy and training.
        steps: Number of steps that are timed together.
    """
    batch = config.training.batch
    training = replace(config.training, validation=0.0, threads=1, device="cpu")
    eager = replace(training, precision="float32")
    frames = _random_frames(steps * batch)
    network = PolicyNetwork(config.policy)
    short = training.precision == "bfloat16" and has_bfloat16(torch.device("cpu"))
    step_seconds = []
    eager_seconds = []
    product_seconds = []
    for _ in range(3):
        step_seconds.append(_step_seconds(network, frames, config, training, steps))
        eager_seconds.append(_step_seconds(network, frames, config, eager, steps))
        product_seconds.append(median_seconds(_network_products(network, batch, short), 30))
    step_ms = 1e3 * float(np.median(step_seconds))
    eager_step_ms = 1e3 * float(np.median(eager_seconds))
    # Backward there are two products for each forward: for the inputs, and for the weights.
    floor_step_ms = 3 * 1e3 * float(np.median(product_seconds))
    return TrainSpeed(
        batch=batch,
        precision="bfloat16" if short else "float32",
        step_ms=step_ms,
        eager_step_ms=eager_step_ms,
        ratio_to_eager=step_ms / eager_step_ms,
        floor_step_ms=floor_step_ms,
        ratio=step_ms / floor_step_ms,
    )


def _step_seconds(
    network: PolicyNetwork, frames: Frames, config: Config, training: TrainingConfig, steps: int
) -> float:
    """Wall time of one step of a fit [s]."""
    ends: list[float] = []

    def progress(*_: object) -> None:
        ends.append(time.perf_counter())

    fit(network, frames, training, policy_spec(config), 2, 0, progress)
    # The second epoch is steps only; before the first, inputs and targets are derived.
    return (ends[1] - ends[0]) / steps


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
