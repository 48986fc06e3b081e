"""The number format in which training multiplies: the configured one, or the faster one.

The instructions of a processor do not tell whether bfloat16 is faster, so steps of the run's own
network are timed. The choice holds for a whole run: `runs.run.create` makes it once and records it.
Read ``step.py`` for the step.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import get_args

import numpy as np
import torch

from surefoot.config import NumberFormat, TrainingConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.step import (
    TrainingStep,
    choose_device,
    device_name,
    has_bfloat16,
    make_optimizer,
    torch_threads,
)
from surefoot.types import JOINTS

SECONDS = 0.4
"""Duration of the timing, for both formats together [s]."""
FEWEST_ROUNDS = 5
"""Fewest steps timed in each format, however long they take, after as many warm-up steps."""
MOST_ROWS = 4096
"""Most rows in a timed step, so that a huge batch does not take minutes."""
CLEARLY = 0.98
"""bfloat16 is chosen if its step takes at most this share of the time of float32, so that the more
exact format is used where both are equally fast."""


@dataclass(frozen=True)
class PrecisionChoice:
    """The number format of a run's training, and the times by which it was chosen.

    Attributes:
        chosen: Number format of the products of the hidden layers.
        float32_ms: Time of a step in float32 [ms]; None if it was not measured.
        bfloat16_ms: Time of a step in bfloat16 [ms]; None if it was not measured.
    """

    chosen: NumberFormat
    float32_ms: float | None = None
    bfloat16_ms: float | None = None

    def __str__(self) -> str:
        """The choice as text, with how much longer the other format takes."""
        if self.float32_ms is None or self.bfloat16_ms is None:
            return f"training in {self.chosen}"
        ratio = self.bfloat16_ms / self.float32_ms
        if self.chosen == "bfloat16":
            return f"training in bfloat16 (float32 would take {1 / ratio:.2f} times as long here)"
        return f"training in float32 (bfloat16 would take {ratio:.2f} times as long here)"


def choose_precision(network: PolicyNetwork, config: TrainingConfig) -> PrecisionChoice:
    """The number format to train a network in: the configured one, or for `auto` the faster one.

    Args:
        network: The network to train; it is not changed.
        config: The precision, and what the time of a step depends on: batch, threads, device.

    Raises:
        ValueError: There is no such device, or it cannot multiply in the named format.
    """
    device = choose_device(config.device)
    possible = device.type == "cpu" or has_bfloat16(device)
    if config.precision == "bfloat16" and not possible:
        raise ValueError(
            f"training.precision is bfloat16, for which {device_name(device)} has no instructions; "
            "use auto or float32. A run keeps the format that it began with: let it go on without "
            "this device (CUDA_VISIBLE_DEVICES= hides it)"
        )
    if config.precision != "auto":
        return PrecisionChoice(config.precision)
    if not possible:
        return PrecisionChoice("float32")
    return faster_of(step_seconds(network, config, device))


def faster_of(seconds: dict[NumberFormat, float]) -> PrecisionChoice:
    """The choice between the two formats, given the time of a step in each [s]."""
    clearly = seconds["bfloat16"] <= CLEARLY * seconds["float32"]
    return PrecisionChoice(
        chosen="bfloat16" if clearly else "float32",
        float32_ms=1e3 * seconds["float32"],
        bfloat16_ms=1e3 * seconds["bfloat16"],
    )


def step_seconds(
    network: PolicyNetwork, config: TrainingConfig, device: torch.device
) -> dict[NumberFormat, float]:
    """Median time of a step in each format, measured in alternation [s].

    On a CPU this is the process's own CPU time: when other programs used the cores, the ratio of
    wall times scattered between 0.4 and 1.0, that of CPU times only between 0.60 and 0.68.

    Args:
        network: The network; copies of it are trained on random data.
        config: Batch, learning rate and threads.
        device: The device that computes.
    """
    clock = time.process_time if device.type == "cpu" else time.perf_counter
    batch = min(config.batch, MOST_ROWS)
    width = len(network.mean) + len(JOINTS)
    rows = torch.randn(batch, width, generator=torch.Generator().manual_seed(0)).to(device)
    steps: dict[NumberFormat, TrainingStep] = {}
    times: dict[NumberFormat, list[float]] = {}
    with torch_threads(config.threads):
        for name in get_args(NumberFormat):
            own = copy.deepcopy(network).to(device).train()
            optimizer = make_optimizer(own, config, device)
            steps[name] = TrainingStep(own, optimizer, batch, name, device)
            times[name] = []
            for _ in range(FEWEST_ROUNDS):
                _time_of(steps[name], rows, clock)
        began = time.perf_counter()
        rounds = 0
        while rounds < FEWEST_ROUNDS or time.perf_counter() - began < SECONDS:
            for name, step in steps.items():
                times[name].append(_time_of(step, rows, clock))
            rounds += 1
    return {name: float(np.median(values)) for name, values in times.items()}


def _time_of(step: TrainingStep, rows: torch.Tensor, clock: Callable[[], float]) -> float:
    """Time of one step on a clock, until its loss has been computed [s]."""
    began = clock()
    step(rows)
    step.take_loss()  # waits for a GPU
    return clock() - began
