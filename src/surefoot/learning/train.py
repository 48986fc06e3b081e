"""Supervised training: Adam on the L1 loss, reproducible to the bit, on a CPU or a GPU.

It minimizes the mean of |pi(o, g) - a|, where a are the joint targets for which the policy's PD
gives the expert's torque. A hash of an episode's id decides whether the episode is held out for
validation, so the episode and its parts stay on the same side of the split when data is added. This
module needs no robotics. Read ``samples.py`` first, then ``policy.py`` for the network and its
target, and ``step.py`` for the single step.
"""

from __future__ import annotations

import copy
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import get_args

import numpy as np
import torch
from torch import Tensor

from surefoot.config import NumberFormat, Steps, TrainingConfig
from surefoot.learning.checkpoint import Losses, key_in, key_of, load_checkpoint, save_checkpoint
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import PolicySpec
from surefoot.learning.precision import choose_precision
from surefoot.learning.samples import ROWS_AT_A_TIME, TrainingSamples, derive, held_out
from surefoot.learning.step import (
    TrainingStep,
    choose_device,
    device_name,
    make_optimizer,
    torch_threads,
)
from surefoot.learning.symmetry import Mirrored, parts_of
from surefoot.types import JOINTS, Array

Progress = Callable[[int, int, float, float], None]
"""``progress(epoch, epochs, train_loss, validation_loss)`` after each epoch, counted from 1."""


@dataclass(frozen=True)
class FitResult:
    """The result of a fit.

    Attributes:
        network: The trained network, in eval mode.
        train_loss: Mean L1 over each epoch's minibatches [rad], in training mode.
        validation_loss: Mean L1 on the held-out episodes after each epoch [rad]; NaN without any.
        steps: Number of optimizer steps.
        frames: Number of recorded frames, held out or not, without mirror images.
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s] and yaw rate [rad/s] among them.
        device: The device that the network was trained on, as PyTorch names it.
        precision: Number format of the products of the hidden layers.
    """

    network: PolicyNetwork
    train_loss: tuple[float, ...]
    validation_loss: tuple[float, ...]
    steps: int
    frames: int
    command_range: Array
    device: str
    precision: NumberFormat

    @property
    def losses(self) -> str:
        """The last losses as text; that on held-out episodes only if there were any."""
        held_out = self.validation_loss[-1]
        shown = f", held out {held_out:.4f} rad" if math.isfinite(held_out) else ""
        return f"L1 {self.train_loss[-1]:.4f} rad{shown}"


@dataclass(frozen=True)
class SplitSamples:
    """The samples of a fit.

    Attributes:
        training: Rows to train on.
        validation: Rows of the episodes that are held out.
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s] and yaw rate [rad/s] among both.
        frames: Number of recorded frames, without mirror images.
    """

    training: TrainingSamples
    validation: TrainingSamples
    command_range: Array
    frames: int

    def __len__(self) -> int:
        return len(self.training) + len(self.validation)


def fit(
    network: PolicyNetwork,
    data: Frames | Dataset | Mirrored,
    config: TrainingConfig,
    spec: PolicySpec,
    epochs: int | Steps,
    seed: int,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
) -> FitResult:
    """Train a copy of the network on frames; the same arguments give the same bits.

    The exception is the precision `auto`, which two calls may resolve differently. Training starts
    from the network's weights, with a new optimizer. Normalizers are fitted if the network has
    none, and never change after that.

    Args:
        network: The network to start from; it is not changed.
        data: Whole episodes, in memory or on disk: `Mirrored` if `config.mirror` names a mirror,
            plain if it is `none`, and either if it is `auto`.
        config: Optimizer, batch, schedule, threads, precision, device, memory, held-out share.
        spec: How inputs and targets follow from frames.
        epochs: Passes over the frames that are not held out, or the number of steps, which may end
            in the middle of a pass. Mirrored data take as many steps as without mirror images.
        seed: Seed for the order of the frames, at least 0.
        progress: Function that is called after each epoch.
        checkpoint: File that is written after each epoch; a fit with the same data, network and
            arguments, on the same kind of device, resumes from it.

    Raises:
        ValueError: The network does not have as many inputs as the layout, there are too few
            frames, no epochs, a negative seed, a number that is not finite, no such device, the
            device cannot multiply in the precision, a tick is missing that a history needs, or the
            data are mirrored although the training is not, or the other way around.
        FloatingPointError: The loss is not finite.
        DatasetError: A shard is damaged.
        WriteError: The disk is full.
    """
    _check_arguments(network, data, config, spec, epochs, seed)
    device = choose_device(config.device)
    samples = split_samples(data, config, spec)
    batches = _count_batches(samples, config)
    if isinstance(epochs, Steps):
        steps = epochs.count
    else:
        # An epoch has as many steps with images as without, so it covers half of all rows.
        steps = epochs * (max(1, batches // 2) if isinstance(data, Mirrored) else batches)
    passes = math.ceil(steps / batches)
    keys: dict[NumberFormat, str] = {}
    begun_in: NumberFormat | None = None
    if checkpoint is not None:
        for each in get_args(NumberFormat):
            own = replace(config, precision=each)
            keys[each] = key_of(network, data, own, spec, epochs, seed, device)
        kept = key_in(checkpoint)
        begun_in = next((each for each in keys if keys[each] == kept), None)
    precision: NumberFormat
    if config.precision == "auto" and begun_in is not None:
        precision = begun_in  # timed anew, the other format could win, and all would be lost
    else:
        precision = choose_precision(network, config).chosen
    config = replace(config, precision=precision)
    network = copy.deepcopy(network).to(device)
    losses: Losses = []
    with torch_threads(config.threads):
        if not network.has_normalisers:
            mean, deviation = samples.training.moments()
            inputs = spec.observation.input_size
            network.set_normalizers(mean[:inputs], deviation[:inputs])
        optimizer = make_optimizer(network, config, device)
        if checkpoint is not None:
            losses = load_checkpoint(checkpoint, keys[precision], network, optimizer)
        step = TrainingStep(network, optimizer, config.batch, precision, device)
        for epoch in range(len(losses), passes):
            network.train()
            noise = config.input_noise * network.deviation[: spec.observation.observation_size]
            train_loss = _train_epoch(step, samples.training, config, seed, epoch, steps, noise)
            losses.append((train_loss, _validate(network, samples.validation, device)))
            if not np.isfinite(train_loss):
                raise FloatingPointError(
                    f"the loss is {train_loss} in epoch {epoch + 1}: use a learning rate below "
                    f"{config.learning_rate}, and look for frames far outside the rest"
                )
            if checkpoint is not None:
                save_checkpoint(checkpoint, keys[precision], network, optimizer, losses)
            if progress is not None:
                progress(epoch + 1, passes, *losses[-1])
    return FitResult(
        network=network.eval().cpu(),
        train_loss=tuple(training for training, _ in losses),
        validation_loss=tuple(validation for _, validation in losses),
        steps=steps,
        frames=samples.frames,
        command_range=samples.command_range,
        device=device_name(device),
        precision=precision,
    )


def _check_arguments(
    network: PolicyNetwork,
    data: Frames | Dataset | Mirrored,
    config: TrainingConfig,
    spec: PolicySpec,
    epochs: int | Steps,
    seed: int,
) -> None:
    """Check what `fit` is given, before it reads the frames.

    Raises:
        ValueError: An argument is out of range, or two of them do not fit each other.
    """
    amount = epochs.count if isinstance(epochs, Steps) else epochs
    if amount < 1:
        unit = "steps" if isinstance(epochs, Steps) else "epochs"
        raise ValueError(f"{amount} {unit}: at least 1 is needed")
    if seed < 0:
        raise ValueError(f"the seed is {seed}; use 0 or more")
    mirrored = isinstance(data, Mirrored)
    if config.mirror != "auto" and (config.mirror != "none") != mirrored:
        raise ValueError(
            f"training.mirror is {config.mirror}, but the data are {type(data).__name__}: give "
            "`Mirrored` data (surefoot.learning.symmetry) if and only if there is a mirror"
        )
    if len(network.mean) != spec.observation.input_size:
        raise ValueError(
            f"a network of {len(network.mean)} inputs for a layout of "
            f"{spec.observation.input_size}; make it with PolicyNetwork(config, inputs=...)"
        )


def split_samples(
    data: Frames | Dataset | Mirrored, config: TrainingConfig, spec: PolicySpec
) -> SplitSamples:
    """Samples to train on and held-out ones, derived from frames.

    Args:
        data: Whole episodes, in memory or on disk, possibly with their mirror images.
        config: Memory, and the share of episodes that is held out.
        spec: How inputs and targets follow from frames.

    Raises:
        ValueError: A number is not finite.
        DatasetError: A shard is damaged.
        WriteError: The disk is full.
    """
    recorded = data.data if isinstance(data, Mirrored) else data
    folder = recorded.folder if isinstance(recorded, Dataset) else None
    if folder is not None and not os.access(folder, os.W_OK):  # such as a shared dataset
        folder = None
    limit = config.memory * 1_000_000
    validation_limit = round(limit * config.validation)
    width = spec.observation.input_size + len(JOINTS)
    validation = TrainingSamples(validation_limit, folder, width)
    training = TrainingSamples(limit - validation_limit, folder, width)
    lowest = np.full(3, np.inf)
    highest = np.full(3, -np.inf)
    frames = 0
    for images in parts_of(data, all_ticks=spec.remembers):
        frames += int(images[0].kept.sum())
        for image in images:
            if not image.kept.any():
                continue
            rows = derive(image, spec)
            part = image.kept_frames
            is_held_out = held_out(part.episode, config.validation)
            training.append(rows[~is_held_out])
            validation.append(rows[is_held_out])
            low, high = part.command_range
            lowest = np.minimum(lowest, low)
            highest = np.maximum(highest, high)
    return SplitSamples(training, validation, np.stack([lowest, highest]), frames)


def _count_batches(samples: SplitSamples, config: TrainingConfig) -> int:
    """The number of minibatches in a pass over all training rows.

    Raises:
        ValueError: There is not even one; the message says why.
    """
    batches = samples.training.batches(config.batch)
    if batches == 0 and len(samples.training) >= config.batch:
        raise ValueError(
            f"a batch of {config.batch} samples does not fit in training.memory, "
            f"{config.memory} MB; use more memory or a smaller batch"
        )
    if batches == 0:
        raise ValueError(
            f"training.batch is {config.batch}, but there are only {len(samples)} frames, "
            f"{len(samples.training)} of them for training: collect more episodes or use a smaller "
            "batch; if most of the rollouts were lost, find out why first"
        )
    return batches


def _train_epoch(
    step: TrainingStep,
    samples: TrainingSamples,
    config: TrainingConfig,
    seed: int,
    epoch: int,
    steps: int,
    noise: Tensor,
) -> float:
    """Take all steps of an epoch, or as many as remain, and return their mean loss [rad].

    Args:
        step: The step; its network is in training mode.
        samples: Rows to train on.
        config: Batch, learning rate and schedule.
        seed: Seed of the whole fit.
        epoch: Number of the epoch, from 0.
        steps: Number of steps of the whole fit.
        noise: ``(observation_size,)`` standard deviation of the noise, on the device.
    """
    batches = samples.batches(config.batch)
    first = epoch * batches
    count = min(batches, steps - first)
    minibatches = _minibatches(samples, config.batch, _generator(seed, epoch), step.device)
    noise_source = _generator(seed, epoch, stream=1)
    for number, rows in enumerate(islice(minibatches, count), first):
        if config.schedule == "cosine":
            share = 0.5 * (1 + math.cos(math.pi * number / steps))
            step.set_learning_rate(config.learning_rate * share)
        if config.input_noise > 0.0:
            drawn = torch.randn(config.batch, len(noise), generator=noise_source)
            rows[:, : len(noise)] += drawn.to(step.device) * noise
        step(rows)
    return step.take_loss() / count


def _minibatches(
    samples: TrainingSamples, batch: int, order: torch.Generator, device: torch.device
) -> Iterator[Tensor]:
    """``(batch, width)`` rows in random order, copied; an incomplete last one is dropped."""
    for buffer in samples.buffers(order):
        whole = len(buffer) // batch
        permutation = torch.randperm(len(buffer), generator=order)[: whole * batch]
        on_device = buffer.to(device)
        for rows in permutation.to(device).view(whole, batch):
            yield on_device.index_select(0, rows)


@torch.inference_mode()
def _validate(network: PolicyNetwork, samples: TrainingSamples, device: torch.device) -> float:
    """Mean L1 in eval mode and float32 [rad]; NaN without any rows."""
    network.eval()
    inputs = len(network.mean)
    total = torch.zeros((), dtype=torch.float64, device=device)
    for buffer in samples.buffers():
        for part in buffer.split(ROWS_AT_A_TIME):
            rows = part.to(device)
            error = network(rows[:, :inputs]) - rows[:, inputs:]
            total += error.abs().sum(dtype=torch.float64)
    if not len(samples):
        return float("nan")
    return total.item() / (len(samples) * len(JOINTS))


def _generator(seed: int, epoch: int, stream: int = 0) -> torch.Generator:
    """The random generator of an epoch, independent of the epochs before it.

    Args:
        seed: Seed of the whole fit.
        epoch: Number of the epoch, from 0.
        stream: 0 for the order of the rows, 1 for the noise on them.
    """
    entropy = [seed, epoch, stream] if stream else [seed, epoch]
    number = np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0]
    return torch.Generator().manual_seed(int(number))
