"""Supervised training: Adam on the L1 loss, fixed to the bit, on a CPU or a GPU.

Minimises mean |pi(o, g) - a|, a the joint targets with which the policy's PD gives the expert's
torque. Episodes are held out for validation by a hash of their id, so an episode stays on its side
however much data is added later. Needs no robotics. Read ``examples.py`` first, then ``policy.py``
for the network and the label.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from surefoot.config import PolicyConfig, TrainingConfig
from surefoot.learning.checkpoint import Losses, load_checkpoint, save_checkpoint
from surefoot.learning.dataset import Dataset, Frames
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.samples import WIDTH, Examples, derive, held_out
from surefoot.types import Array

SCHEDULES = ("constant", "cosine")

Progress = Callable[[int, int, float, float], None]
"""``progress(epoch, epochs, train_loss, validation_loss)`` after each epoch, counted from 1."""

_ROWS = 16384
"""Frames validated at a time, to bound the memory."""


@dataclass(frozen=True)
class FitResult:
    """What a fit gives.

    Attributes:
        network: trained, in eval mode.
        train_loss: mean L1 over each epoch's minibatches [rad], in training mode.
        validation_loss: mean L1 on the held-out episodes after each epoch [rad]; NaN without any.
        steps: number of optimiser steps.
        frames: number of frames, held out or not.
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s] and yaw rate [rad/s] of them.
        device: on which it was computed, as PyTorch names it.
    """

    network: PolicyNetwork
    train_loss: tuple[float, ...]
    validation_loss: tuple[float, ...]
    steps: int
    frames: int
    command_range: Array
    device: str


def fit(
    network: PolicyNetwork,
    data: Frames | Dataset,
    config: TrainingConfig,
    policy_config: PolicyConfig,
    epochs: int,
    seed: int,
    period_ticks: int,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
) -> FitResult:
    """Train a copy of the network on frames; same arguments, same bits.

    The weights are carried over, the optimiser is new. Normalisers are fitted if the network has
    none, and stay as they are from then on.

    Args:
        network: to start from; is left as it is.
        data: whole episodes, in memory or on disk.
        config: optimiser, batch, schedule, threads, precision, device, memory, held-out share.
        policy_config: kp and kd, for the labels.
        epochs: passes over the frames that are not held out.
        seed: of the order of the frames.
        period_ticks: gait period [ms].
        progress: is called after each epoch.
        checkpoint: file that each epoch leaves; a fit of the same data, network and arguments, on
            the same kind of device, goes on from it.

    Raises:
        ValueError: too few frames, numbers that are not finite, an unknown schedule, or no such
            device.
        FloatingPointError: the loss is not finite.
        DatasetError: a shard is damaged.
        WriteError: the disk is full.
    """
    if config.schedule not in SCHEDULES:
        raise ValueError(f"schedule {config.schedule!r} is unknown; use one of {SCHEDULES}")
    if epochs < 1:
        raise ValueError(f"{epochs} epochs: at least 1 is needed")
    device = choose_device(config.device)
    training, held, command_range = split(data, config, policy_config, period_ticks)
    frames, batches = len(training) + len(held), training.batches(config.batch)
    if batches == 0 and len(training) >= config.batch:
        raise ValueError(
            f"a batch of {config.batch} examples does not fit in training.memory, "
            f"{config.memory} MB; use more memory or a smaller batch"
        )
    if batches == 0:
        raise ValueError(
            f"{frames} frames, {len(training)} of them for training, are less than one "
            f"batch of {config.batch}: collect more episodes or use a smaller batch"
        )
    key = ""
    if checkpoint is not None:
        where = [torch.__version__, _name(device), has_bfloat16(device)]
        key = _fingerprint(network, data, config, policy_config, epochs, seed, period_ticks, where)
    network = copy.deepcopy(network).to(device)
    with _threads(config.threads):
        if not network.has_normalisers:
            mean, deviation = training.moments()
            network.set_normalisers(mean[:INPUT_SIZE], deviation[:INPUT_SIZE])
        rate = torch.tensor(config.learning_rate, device=device)
        optimizer = torch.optim.Adam(
            network.parameters(), lr=rate, fused=True, capturable=device.type == "cuda"
        )
        losses: Losses = []
        if checkpoint is not None:
            losses = load_checkpoint(checkpoint, key, network, optimizer)
        step = _Step(network, optimizer, config, device)
        for epoch in range(len(losses), epochs):
            network.train()
            order = _generator(seed, epoch)
            done = epoch * batches
            for rows in _minibatches(training, config.batch, order, device):
                if config.schedule == "cosine":
                    share = 0.5 * (1 + math.cos(math.pi * done / (epochs * batches)))
                    optimizer.param_groups[0]["lr"].fill_(config.learning_rate * share)
                step(rows)
                done += 1
            losses.append((step.take_loss() / batches, _validate(network, held, device)))
            if not np.isfinite(losses[-1][0]):
                raise FloatingPointError(
                    f"the loss is {losses[-1][0]} in epoch {epoch + 1}: use a learning rate below "
                    f"{config.learning_rate}, and look for frames far outside the rest"
                )
            if checkpoint is not None:
                save_checkpoint(checkpoint, key, network, optimizer, losses)
            if progress is not None:
                progress(epoch + 1, epochs, *losses[-1])
    train_loss, validation_loss = zip(*losses, strict=True)
    return FitResult(
        network.eval().cpu(),
        train_loss,
        validation_loss,
        epochs * batches,
        frames,
        command_range,
        _name(device),
    )


def split(
    data: Frames | Dataset, config: TrainingConfig, policy_config: PolicyConfig, period_ticks: int
) -> tuple[Examples, Examples, Array]:
    """Examples to train on and held-out ones, and the range of the commands ``(2, 3)``."""
    folder = data.folder if isinstance(data, Dataset) else None
    limit = config.memory * 1_000_000
    held = Examples(round(limit * config.validation), folder)
    training = Examples(limit - round(limit * config.validation), folder)
    lowest, highest = np.full(3, np.inf), np.full(3, -np.inf)
    for part in data.parts() if isinstance(data, Dataset) else [data]:
        if not len(part):
            continue
        rows = derive(part, policy_config, period_ticks)
        out = held_out(part.episode, config.validation)
        training.append(rows[~out])
        held.append(rows[out])
        low, high = part.command_range
        lowest, highest = np.minimum(lowest, low), np.maximum(highest, high)
    return training, held, np.stack([lowest, highest])


def choose_device(name: str) -> torch.device:
    """The device asked for; `auto` is a GPU if there is one.

    Raises:
        ValueError: a GPU is asked for and there is none, or no such device.
    """
    if name not in ("auto", "cpu", "cuda"):
        raise ValueError(f"device {name!r} is unknown; use auto, cpu or cuda")
    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError(
            f"PyTorch {torch.__version__} finds no GPU; use --device cpu, or install a CUDA build"
        )
    cuda = name != "cpu" and torch.cuda.is_available()
    return torch.device("cuda" if cuda else "cpu")


def has_bfloat16(device: torch.device) -> bool:
    """Whether the device multiplies in bfloat16 faster than in float32."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    capabilities = torch.cpu.get_capabilities()
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


class _Step:
    """One step of Adam on a minibatch; on a GPU a graph that is launched at once.

    Nothing in it waits for the device: the loss is added up there.
    """

    def __init__(
        self,
        network: PolicyNetwork,
        optimizer: torch.optim.Optimizer,
        config: TrainingConfig,
        device: torch.device,
    ) -> None:
        self._network, self._optimizer, self._device = network, optimizer, device
        self._short = config.precision == "bfloat16" and has_bfloat16(device)
        self._rows = torch.zeros(config.batch, WIDTH, device=device)
        self._loss = torch.zeros((), dtype=torch.float64, device=device)
        self._launch = self._capture() if device.type == "cuda" else self._compute

    def __call__(self, rows: Tensor) -> None:
        """Train on ``(batch, 59)`` inputs and labels."""
        self._rows.copy_(rows)
        self._launch()

    def take_loss(self) -> float:
        """Sum of the losses since the last call."""
        total = self._loss.item()
        self._loss.zero_()
        return total

    def _compute(self) -> None:
        inputs, labels = self._rows[:, :INPUT_SIZE], self._rows[:, INPUT_SIZE:]
        self._optimizer.zero_grad()
        with torch.autocast(self._device.type, torch.bfloat16, self._short, cache_enabled=False):
            targets = self._network(inputs)
        loss = torch.nn.functional.l1_loss(targets, labels)
        loss.backward()
        self._optimizer.step()
        self._loss += loss.detach()

    def _capture(self) -> Callable[[], None]:
        """The step as a CUDA graph: one launch instead of a hundred."""
        # Warming up and capturing are real steps; what they change is put back afterwards.
        self._network.train()
        before = copy.deepcopy((self._network.state_dict(), self._optimizer.state_dict()))
        side = torch.cuda.Stream()
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            for _ in range(3):
                self._compute()
        torch.cuda.current_stream().wait_stream(side)
        self._optimizer.zero_grad()
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._compute()
        self._put_back(*before)
        return graph.replay

    def _put_back(self, weights: dict[str, Tensor], optimizer: dict[str, Any]) -> None:
        """Values into the very tensors that the graph uses."""
        for name, tensor in self._network.state_dict().items():
            tensor.copy_(weights[name])
        for index, moments in self._optimizer.state_dict()["state"].items():
            for name, tensor in moments.items():
                value = optimizer["state"].get(index, {}).get(name)
                tensor.zero_() if value is None else tensor.copy_(value)
        self._loss.zero_()


def _minibatches(
    examples: Examples, batch: int, order: torch.Generator, device: torch.device
) -> Iterator[Tensor]:
    """``(batch, 59)`` rows in random order; the last incomplete one of a buffer is dropped."""
    for buffer in examples.buffers(order):
        whole = len(buffer) // batch
        permutation = torch.randperm(len(buffer), generator=order)[: whole * batch]
        there = buffer.to(device)
        for rows in permutation.to(device).view(whole, batch):
            yield there.index_select(0, rows)


@torch.inference_mode()
def _validate(network: PolicyNetwork, held: Examples, device: torch.device) -> float:
    """Mean L1 in eval mode and float32; NaN without any rows."""
    network.eval()
    total = torch.zeros((), dtype=torch.float64, device=device)
    for buffer in held.buffers():
        for rows in buffer.split(_ROWS):
            rows = rows.to(device)
            error = network(rows[:, :INPUT_SIZE]) - rows[:, INPUT_SIZE:]
            total += error.abs().sum(dtype=torch.float64)
    return total.item() / (len(held) * (WIDTH - INPUT_SIZE)) if len(held) else float("nan")


def _generator(seed: int, epoch: int) -> torch.Generator:
    """Randomness of an epoch: its own, so that an epoch can be begun without those before."""
    number = np.random.SeedSequence([seed, epoch]).generate_state(1, np.uint64)[0]
    return torch.Generator().manual_seed(int(number))


def _fingerprint(network: PolicyNetwork, data: Frames | Dataset, *arguments: Any) -> str:
    """What a fit's result depends on, as a hash."""
    sha = hashlib.sha256()
    for tensor in network.state_dict().values():
        sha.update(tensor.cpu().numpy().tobytes())
    plain = [asdict(a) if hasattr(a, "__dataclass_fields__") else a for a in arguments]
    sha.update(json.dumps([data.hash, *plain]).encode())
    return sha.hexdigest()


def _name(device: torch.device) -> str:
    """`cpu`, or the card's name."""
    return torch.cuda.get_device_name(device) if device.type == "cuda" else "cpu"


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Torch's number of threads inside, the former one afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
