"""Supervised training: raw frames to inputs and labels, Adam on the L1 loss, fixed to the bit.

Minimises mean |pi(o, g) - a|, a the joint targets with which the policy's PD gives the expert's
torque. Episodes are held out for validation by a hash of their id, so an episode stays on its side
however much data is added later. Read next: ``policy.py`` for the network and the label.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.optim.lr_scheduler import CosineAnnealingLR, LRScheduler

from surefoot.config import PolicyConfig, TrainingConfig
from surefoot.dataset import Frames
from surefoot.observation import INPUT_SIZE, OBSERVATION_SIZE, network_input
from surefoot.policy import PolicyNetwork, label
from surefoot.types import JOINTS, BoolArray, IntArray

SCHEDULES = ("constant", "cosine")

Progress = Callable[[int, int, float, float], None]
"""``progress(epoch, epochs, train_loss, validation_loss)`` after each epoch, counted from 1."""

_ROWS = 16384
"""Frames derived or validated at a time, to bound the memory."""


@dataclass(frozen=True)
class FitResult:
    """What a fit gives.

    Attributes:
        network: trained, in eval mode.
        train_loss: mean L1 over each epoch's minibatches [rad], in training mode.
        validation_loss: mean L1 on the held-out episodes after each epoch [rad]; NaN without any.
        steps: number of optimiser steps.
    """

    network: PolicyNetwork
    train_loss: tuple[float, ...]
    validation_loss: tuple[float, ...]
    steps: int


def fit(
    network: PolicyNetwork,
    frames: Frames,
    config: TrainingConfig,
    policy_config: PolicyConfig,
    epochs: int,
    seed: int,
    period_ticks: int,
    progress: Progress | None = None,
) -> FitResult:
    """Train a copy of the network on frames; same arguments, same bits.

    The weights are carried over, the optimiser is new. Normalisers are fitted if the network has
    none, and stay as they are from then on.

    Args:
        network: to start from; is left as it is. Training runs on its device.
        frames: whole episodes.
        config: optimiser, batch, schedule, threads, held-out share.
        policy_config: kp and kd, for the labels.
        epochs: passes over the frames that are not held out.
        seed: of the order of the frames.
        period_ticks: gait period [ms].
        progress: is called after each epoch.

    Raises:
        ValueError: too few frames, numbers that are not finite, or an unknown schedule.
        FloatingPointError: the loss is not finite.
    """
    if config.schedule not in SCHEDULES:
        raise ValueError(f"schedule {config.schedule!r} is unknown; use one of {SCHEDULES}")
    if epochs < 1:
        raise ValueError(f"{epochs} epochs: at least 1 is needed")
    out = held_out(frames.episode, config.validation)
    batches = int((~out).sum()) // config.batch
    if batches == 0:
        raise ValueError(
            f"{len(frames)} frames, {int((~out).sum())} of them for training, are less than one "
            f"batch of {config.batch}: collect more episodes or use a smaller batch"
        )
    device = network.mean.device
    derived = examples(frames, policy_config, period_ticks)
    inputs, labels = (part[torch.from_numpy(~out)].to(device) for part in derived)
    held = [part[torch.from_numpy(out)].to(device) for part in derived]
    del derived
    network = copy.deepcopy(network)
    order = torch.Generator().manual_seed(seed)
    losses: list[tuple[float, float]] = []
    with _threads(config.threads):
        if not network.has_normalisers:
            network.fit_normalisers(inputs[:, :OBSERVATION_SIZE], inputs[:, OBSERVATION_SIZE:])
        optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate, fused=True)
        schedule: LRScheduler | None = None
        if config.schedule == "cosine":
            schedule = CosineAnnealingLR(optimizer, T_max=epochs * batches)
        for epoch in range(1, epochs + 1):
            network.train()
            total = torch.zeros((), dtype=torch.float64, device=device)
            permutation = torch.randperm(len(inputs), generator=order).to(device)
            for rows in permutation[: batches * config.batch].view(batches, config.batch):
                x, y = inputs.index_select(0, rows), labels.index_select(0, rows)
                loss = torch.nn.functional.l1_loss(network(x), y)
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                if schedule is not None:
                    schedule.step()
                total += loss.detach()
            losses.append((total.item() / batches, _validate(network, *held)))
            if not np.isfinite(losses[-1][0]):
                raise FloatingPointError(
                    f"the loss is {losses[-1][0]} in epoch {epoch}: use a learning rate below "
                    f"{config.learning_rate}, and look for frames far outside the rest"
                )
            if progress is not None:
                progress(epoch, epochs, *losses[-1])
    train_loss, validation_loss = zip(*losses, strict=True)
    return FitResult(network.eval(), train_loss, validation_loss, epochs * batches)


def examples(frames: Frames, config: PolicyConfig, period_ticks: int) -> tuple[Tensor, Tensor]:
    """Inputs ``(n, 47)`` and labels ``(n, 12)`` [rad] of raw frames, float32.

    Args:
        frames: n recorded ticks.
        config: kp and kd, for the labels.
        period_ticks: gait period [ms].

    Raises:
        ValueError: a number is not finite.
    """
    inputs = np.empty((len(frames), INPUT_SIZE), np.float32)
    labels = np.empty((len(frames), len(JOINTS)), np.float32)
    for start in range(0, len(frames), _ROWS):
        rows = slice(start, start + _ROWS)
        part = frames[rows]
        with np.errstate(over="ignore", invalid="ignore"):  # found below, and named
            network_input(part.state, part.tick, part.command, period_ticks, inputs[rows])
            labels[rows] = label(part.torque, part.q, part.v, config)
        raw = (part.q, part.v, part.com, part.feet, part.command, part.torque)
        finite = np.ones(len(part), bool)
        for array in (*raw, inputs[rows], labels[rows]):
            finite &= np.isfinite(array).reshape(len(part), -1).all(1)
        if not finite.all():
            bad = int(np.argmin(finite))
            raise ValueError(
                f"frame {start + bad} (episode {part.episode[bad]}, tick {part.tick[bad]}) holds "
                "numbers that are not finite; leave that episode out"
            )
    return torch.from_numpy(inputs), torch.from_numpy(labels)


def held_out(episode: IntArray, share: float) -> BoolArray:
    """``(n,)`` True for frames of episodes held out for validation, decided by the id alone.

    Args:
        episode: ``(n,)`` episode ids.
        share: of the ids, in the long run.
    """
    # The finaliser of SplitMix64 (Steele et al., 2014): neighbouring ids land far apart.
    h = episode.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    h = h ^ (h >> np.uint64(31))
    return h / 2.0**64 < share


@torch.inference_mode()
def _validate(network: PolicyNetwork, inputs: Tensor, labels: Tensor) -> float:
    """Mean L1 in eval mode; NaN without any frames."""
    network.eval()
    total = 0.0
    for x, y in zip(inputs.split(_ROWS), labels.split(_ROWS), strict=True):
        total += (network(x) - y).abs().sum(dtype=torch.float64).item()
    return total / labels.numel() if len(labels) else float("nan")


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Torch's number of threads inside, the former one afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
