"""The number format that training multiplies in: named, or the one in which a step takes less time.

Whether bfloat16 is faster does not follow from the instructions that a processor has, so steps of
the run's own network are timed. The choice belongs to a whole run: `runs.run.create` makes it once
and writes it down. Read ``step.py`` for the step.
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
"""How long steps are timed, in both formats together [s]."""
FEWEST_ROUNDS = 5
"""Steps that are timed in each format, however long they take; as many before them are not."""
MOST_ROWS = 4096
"""Rows in a step that is timed, so that a huge batch does not take minutes."""
CLEARLY = 0.98
"""bfloat16 is chosen if its step takes at most this share of the time of float32: where both are
equal, the more exact one is."""


@dataclass(frozen=True)
class PrecisionChoice:
    """The number format of a run's training, and the times by which it was chosen.

    Attributes:
        chosen: Number format of the products of the hidden layers.
        float32_ms: Time of a step in float32 [ms]; None where the format was not measured.
        bfloat16_ms: Time of a step in bfloat16 [ms]; None where the format was not measured.
    """

    chosen: NumberFormat
    float32_ms: float | None = None
    bfloat16_ms: float | None = None

    def __str__(self) -> str:
        """The choice in words, with how much longer the other format takes."""
        if self.float32_ms is None or self.bfloat16_ms is None:
            return f"training in {self.chosen}"
        ratio = self.bfloat16_ms / self.float32_ms
        if self.chosen == "bfloat16":
            return f"training in bfloat16 (float32 would take {1 / ratio:.2f} times as long here)"
        return f"training in float32 (bfloat16 would take {ratio:.2f} times as long here)"


def choose_precision(network: PolicyNetwork, config: TrainingConfig) -> PrecisionChoice:
    """The number format to train a network in: the one that is named, or the faster one.

    Args:
        network: The network to train; it is left as it is.
        config: The precision, and what the time of a step depends on: batch, threads, device.

    Raises:
        ValueError: There is no such device, or it cannot multiply in the named format.
    """
    device = choose_device(config.device)
    possible = device.type == "cpu" or has_bfloat16(device)
    if config.precision == "bfloat16" and not possible:
        raise ValueError(
            f"training.precision is bfloat16, for which {device_name(device)} has no instructions; "
            "use auto or float32"
        )
    if config.precision != "auto":
        return PrecisionChoice(config.precision)
    if not possible:
        return PrecisionChoice("float32")
    return faster_of(step_seconds(network, config, device))


def faster_of(seconds: dict[NumberFormat, float]) -> PrecisionChoice:
    """The choice between two formats in which a step takes that long [s]."""
    clearly = seconds["bfloat16"] <= CLEARLY * seconds["float32"]
    return PrecisionChoice(
        chosen="bfloat16" if clearly else "float32",
        float32_ms=1e3 * seconds["float32"],
        bfloat16_ms=1e3 * seconds["bfloat16"],
    )


def step_seconds(
    network: PolicyNetwork, config: TrainingConfig, device: torch.device
) -> dict[NumberFormat, float]:
    """Median time of a step in each format, one format after the other in turns [s].

    On a CPU it is this process's own time: where other programs held the cores, the ratio of wall
    times scattered between 0.4 and 1.0, and that of the processor's times between 0.60 and 0.68.

    Args:
        network: The network; copies of it take the steps, on noise.
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
    """Time of one step on a clock, until its loss is known [s]."""
    began = clock()
    step(rows)
    step.take_loss()  # waits for a GPU
    return clock() - began
