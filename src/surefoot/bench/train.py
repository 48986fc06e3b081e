"""Time of a training step in both precisions, compared with plain PyTorch and with a lower bound.

Plain PyTorch is the usual loop: `l1_loss`, `backward`, the fused Adam, in float32. The lower bound
is the time of the step's matrix products alone. The figures depend on the machine and the moment:
trust the ratios. Next: `end_to_end`.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import torch

from surefoot.bench.engine import median_seconds
from surefoot.config import Config, NumberFormat, TrainingConfig
from surefoot.learning.frames import Frames
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import PolicySpec, policy_spec
from surefoot.learning.precision import choose_precision
from surefoot.learning.step import torch_threads
from surefoot.learning.train import fit
from surefoot.types import JOINTS

REPEATS = 5
"""Number of times that everything is measured, in turns."""


@dataclass(frozen=True)
class TrainSpeed:
    """Wall time of a training step, on one thread.

    Attributes:
        batch: Number of frames of a step.
        float32_step_ms: Time of a step in float32 [ms].
        bfloat16_step_ms: Time of a step whose hidden layers multiply in bfloat16 [ms].
        eager_step_ms: Time of a step of a plain PyTorch loop in float32 [ms].
        chosen: The configured precision; with `auto`, the one that a run would choose now.
        ratio_to_better: Step time in the chosen precision over that in the faster one; 1 at best.
        ratio_to_eager: Step time in the faster precision over ``eager_step_ms``.
        floor_step_ms: Lower bound: time of the matrix products in the faster precision, forward and
            backward [ms].
        ratio: Step time in the faster precision over ``floor_step_ms``; 1 at best.
    """

    batch: int
    float32_step_ms: float
    bfloat16_step_ms: float
    eager_step_ms: float
    chosen: NumberFormat
    ratio_to_better: float
    ratio_to_eager: float
    floor_step_ms: float
    ratio: float


def bench_train(config: Config, steps: int = 50) -> TrainSpeed:
    """Measure a training step, on one thread.

    Args:
        config: Configuration of policy and training.
        steps: Number of steps that are timed together.
    """
    batch = config.training.batch
    training = _alone_on_a_thread(config.training)
    frames = _random_frames(steps * batch)
    spec = policy_spec(config)
    network = PolicyNetwork(config.policy, inputs=spec.observation.input_size)
    names: tuple[NumberFormat, ...] = get_args(NumberFormat)
    # The medians of the parts, which are measured in turns.
    measured = {f"{part} {name}": [] for part in ("step", "products") for name in names}
    measured["eager"] = []
    for _ in range(REPEATS):
        for name in names:
            named = replace(training, precision=name)
            measured[f"step {name}"].append(_step_seconds(network, frames, spec, named, steps))
            products = _network_products(network, batch, name)
            measured[f"products {name}"].append(median_seconds(products, 30))
        measured["eager"].append(_eager_step_seconds(network, batch, steps))
    ms = {part: 1e3 * float(np.median(seconds)) for part, seconds in measured.items()}
    better = min(names, key=lambda name: ms[f"step {name}"])
    step_ms = ms[f"step {better}"]
    chosen = choose_precision(network, training).chosen
    # The backward pass has two products for each forward one: for the inputs and the weights.
    floor_step_ms = 3 * ms[f"products {better}"]
    return TrainSpeed(
        batch=batch,
        float32_step_ms=ms["step float32"],
        bfloat16_step_ms=ms["step bfloat16"],
        eager_step_ms=ms["eager"],
        chosen=chosen,
        ratio_to_better=ms[f"step {chosen}"] / step_ms,
        ratio_to_eager=step_ms / ms["eager"],
        floor_step_ms=floor_step_ms,
        ratio=step_ms / floor_step_ms,
    )


def chosen_step_seconds(config: Config, steps: int = 50) -> float:
    """Measure a training step in the precision that a run would choose now, on one thread [s].

    Args:
        config: Configuration of policy and training.
        steps: Number of steps that are timed together.
    """
    training = _alone_on_a_thread(config.training)
    spec = policy_spec(config)
    network = PolicyNetwork(config.policy, inputs=spec.observation.input_size)
    training = replace(training, precision=choose_precision(network, training).chosen)
    frames = _random_frames(steps * training.batch)
    seconds = [_step_seconds(network, frames, spec, training, steps) for _ in range(REPEATS)]
    return float(np.median(seconds))


def _alone_on_a_thread(training: TrainingConfig) -> TrainingConfig:
    """The training without what a step does not need, on one thread of the processor."""
    return replace(training, validation=0.0, threads=1, device="cpu")


def _step_seconds(
    network: PolicyNetwork, frames: Frames, spec: PolicySpec, training: TrainingConfig, steps: int
) -> float:
    """Wall time of one step of a fit [s]."""
    ends: list[float] = []

    def progress(*_: object) -> None:
        ends.append(time.perf_counter())

    fit(network, frames, training, spec, 2, 0, progress)
    # The second epoch is steps only; before the first, inputs and targets are derived.
    return (ends[1] - ends[0]) / steps


def _eager_step_seconds(network: PolicyNetwork, batch: int, steps: int) -> float:
    """Wall time of one step of a plain PyTorch loop in float32 [s]."""
    network = copy.deepcopy(network).train()
    optimizer = torch.optim.Adam(network.parameters(), fused=True)
    inputs = network.mean.shape[0]
    rows = torch.randn(
        steps * batch, inputs + len(JOINTS), generator=torch.Generator().manual_seed(0)
    )
    with torch_threads(1):
        began = time.perf_counter()
        for part in rows.split(batch):
            optimizer.zero_grad()
            outputs = network(part[:, :inputs])
            torch.nn.functional.l1_loss(outputs, part[:, inputs:]).backward()
            optimizer.step()
        return (time.perf_counter() - began) / steps


def _network_products(
    network: PolicyNetwork, batch: int, precision: NumberFormat
) -> Callable[[], None]:
    """The matrix products of one forward pass and nothing else, on one thread."""
    kind = torch.bfloat16 if precision == "bfloat16" else torch.float32
    weights = [weight.to(kind) for weight, _ in network.folded()]
    inputs = [torch.randn(batch, weight.shape[0], dtype=kind) for weight in weights]
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
        elapsed=np.arange(n, dtype=np.int32),
    )
