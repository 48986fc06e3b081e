"""A small network that gives the probability that a row is *positive*, and its file.

It serves the learned gates (``safety/learned.py``), where positive means unsafe. Layers,
normalizers and their folding are those of the policy's network. This module needs no robotics. Read
next: ``safety/learned.py``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from surefoot.config import PolicyConfig
from surefoot.config.json_io import from_json, to_json
from surefoot.learning.network import MINIMUM_ROWS, PolicyNetwork
from surefoot.learning.observation import Float32Array
from surefoot.learning.onnx_graph import onnx_graph, runner
from surefoot.learning.step import torch_threads
from surefoot.learning.tensor_file import (
    Header,
    TensorKind,
    check_tensors,
    read_tensor_file,
    write_tensor_file,
)
from surefoot.types import BoolArray, IntArray

HIDDEN = (128, 128)
"""Units of the hidden layers."""
EPOCHS = 6
"""Passes over the rows."""
BATCH = 1024
"""Rows in a step."""
LEAST_ROWS = 8
"""The fewest rows to train on: four steps of two rows in each pass."""
RATE = 3e-3
"""Learning rate of Adam at the beginning; it falls to zero along a cosine."""
MOST_ROWS = 1_000_000
"""Rows in an epoch; if there are more, this many are drawn."""
NORMALIZING_ROWS = 100_000
"""About this many rows fix the normalizers; for a history gate they take 400 MB in float64."""
FORMAT = 1
"""Version of the file."""


@dataclass(frozen=True)
class ClassifierQuality:
    """A classifier's training data, and how well it does on rows that were held out.

    Without held-out rows, all fields from ``held_out`` on are None.

    Attributes:
        rows: Number of rows that the classifier was trained on.
        share_yes: Share of those rows that is positive.
        seed: Seed of its weights and of the order of its rows.
        held_out: Number of rows held out.
        held_out_yes: Number of those that are positive.
        alarm: Probability beyond which a row is called positive.
        recall: Share of the positive rows that is called positive; 0 without any.
        precision: Share of the rows called positive that is positive; 0 without any.
        share_said: Share of all held-out rows that is called positive.
        average_precision: Mean over the positive rows of the precision with an alarm just below
            each row's probability; ``held_out_yes / held_out`` if the network has learned nothing.
    """

    rows: int
    share_yes: float
    seed: int
    held_out: int | None = None
    held_out_yes: int | None = None
    alarm: float | None = None
    recall: float | None = None
    precision: float | None = None
    share_said: float | None = None
    average_precision: float | None = None


@dataclass(frozen=True)
class Classifier:
    """Layers of a trained network, normalizers folded in.

    Attributes:
        layers: Weight ``(inputs, outputs)`` and bias ``(outputs,)`` of each layer, float32.
        quality: The classifier's training data, and how well it does.
    """

    layers: tuple[tuple[Float32Array, Float32Array], ...]
    quality: ClassifierQuality

    def __getstate__(self) -> dict[str, object]:
        """What is sent to other processes: all but the ONNX session, which they make themselves."""
        return {"layers": self.layers, "quality": self.quality}

    @cached_property
    def _forward(self) -> Callable[[Float32Array], Float32Array]:
        return runner(onnx_graph(self.layers))

    def probability(self, rows: Float32Array) -> Float32Array:
        """``(n,)`` probability that each row is positive, independent of the other rows.

        Args:
            rows: ``(n, inputs)``.
        """
        padded = np.zeros((max(len(rows), MINIMUM_ROWS), rows.shape[1]), np.float32)
        padded[: len(rows)] = rows
        with np.errstate(over="ignore", invalid="ignore"):
            logit = self._forward(padded)[: len(rows), 0]
            return np.float32(1.0) / (np.float32(1.0) + np.exp(-logit))


def fit_classifier(
    rows: Float32Array, positive: BoolArray, held_out: BoolArray, seed: int, alarm: float = 0.5
) -> Classifier:
    """Train by binary cross-entropy; the same rows and seed give the same bits.

    All rows have the same weight, however rare positive ones are, so that the probabilities are
    calibrated. If positive rows are rare, the probability is seldom beyond 0.5: use a lower alarm.
    Weights that make up for the rarity find fewer positive rows
    (``benchmarks/notebook/gates.md``).

    Args:
        rows: ``(n, inputs)``, finite.
        positive: ``(n,)`` True for the rows to find.
        held_out: ``(n,)`` True for rows that judge the classifier and do not train it.
        seed: Seed of the weights and of the order of the rows.
        alarm: Probability beyond which a row is called positive when the classifier is judged.

    Raises:
        ValueError: There are too few rows to train on.
    """
    training = np.flatnonzero(~held_out)
    size = min(BATCH, len(training) // 4)
    if len(training) < LEAST_ROWS:
        raise ValueError(f"{len(training)} rows are too few to train a classifier on")
    network = PolicyNetwork(PolicyConfig(hidden=HIDDEN), seed, inputs=rows.shape[1], outputs=1)
    with torch_threads(1):
        _train(network, rows, positive, training, size, seed)
        layers = tuple((weight.numpy(), bias.numpy()) for weight, bias in network.eval().folded())
    quality = ClassifierQuality(len(training), float(positive[training].mean()), seed)
    if held_out.any():
        probability = Classifier(layers, quality).probability(rows[held_out])
        quality = judge_classifier(quality, probability, positive[held_out], alarm)
    return Classifier(layers, quality)


def _train(
    network: PolicyNetwork,
    rows: Float32Array,
    positive: BoolArray,
    training: IntArray,
    batch: int,
    seed: int,
) -> None:
    """Train the network in place.

    Args:
        network: The new network.
        rows: ``(n, inputs)``.
        positive: ``(n,)`` True for the rows that are positive.
        training: ``(k,)`` indices of the rows to train on.
        batch: Rows in a step.
        seed: Seed of the order of the rows.
    """
    x = torch.from_numpy(rows)
    y = torch.from_numpy(positive.astype(np.float32))
    spread = training[:: max(1, len(training) // NORMALIZING_ROWS)]
    normalizing = x[torch.from_numpy(spread)].double()
    network.set_normalizers(normalizing.mean(0), normalizing.std(0))
    generator = torch.Generator().manual_seed(seed)
    steps = EPOCHS * (min(len(training), MOST_ROWS) // batch)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    index = torch.from_numpy(training)
    loss_of = torch.nn.BCEWithLogitsLoss()
    network.train()
    for _ in range(EPOCHS):
        order = index[torch.randperm(len(index), generator=generator)[:MOST_ROWS]]
        for minibatch in order.split(batch):
            if len(minibatch) < batch:
                break
            optimizer.zero_grad()
            loss_of(network(x[minibatch])[:, 0], y[minibatch]).backward()
            optimizer.step()
            schedule.step()


def judge_classifier(
    quality: ClassifierQuality, probability: Float32Array, positive: BoolArray, alarm: float
) -> ClassifierQuality:
    """The quality of a classifier, completed by the figures on held-out rows.

    Args:
        quality: The quality without those figures.
        probability: ``(n,)`` probabilities that the classifier gives to the held-out rows.
        positive: ``(n,)`` True for the held-out rows that are positive.
        alarm: Probability beyond which a row is called positive.
    """
    called = probability > alarm
    hits = float((called & positive).sum())
    order = np.argsort(-probability, kind="stable")
    ranked = positive[order]
    # An alarm just below a row's probability also calls all rows with the same probability.
    called_then = np.searchsorted(-probability[order], -probability[order], side="right")
    precision = np.cumsum(ranked)[called_then - 1] / called_then
    return replace(
        quality,
        held_out=len(positive),
        held_out_yes=int(positive.sum()),
        alarm=alarm,
        recall=hits / max(float(positive.sum()), 1.0),
        precision=hits / max(float(called.sum()), 1.0),
        share_said=float(called.mean()),
        average_precision=float(precision[ranked].mean()) if positive.any() else 0.0,
    )


@dataclass(frozen=True)
class _Header:
    """The header of a classifier's file, with its keys.

    Attributes:
        format: Version of the file.
        figures: The classifier's training data, and how well it does.
        sha256: Hash of its quality and layers.
    """

    format: int
    figures: ClassifierQuality
    sha256: str


def save_classifier(classifier: Classifier, path: Path) -> None:
    """Write a classifier to a safetensors file, whole or not at all.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    tensors = {}
    for number, (weight, bias) in enumerate(classifier.layers):
        tensors[f"weight{number}"] = torch.from_numpy(weight)
        tensors[f"bias{number}"] = torch.from_numpy(bias)
    header = {"format": FORMAT, "figures": _plain(classifier.quality)}
    write_tensor_file(path, tensors, header, digest(classifier))


def load_classifier(path: Path, inputs: int | None = None) -> Classifier:
    """Read a classifier back, to the bit.

    Args:
        path: The file.
        inputs: Number of inputs that it must have; by default any.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, of another version, or has other inputs.
    """
    if not path.exists():
        raise FileNotFoundError(
            f"there is no classifier {path}; if its run has lost it, `surefoot train ... --resume` "
            "trains it again, bit for bit"
        )
    try:
        tensors, values = read_tensor_file(path)
        header = from_json(_Header, values, "its header")
        classifier = Classifier(_layers(tensors), header.figures)
        if header.format != FORMAT or header.sha256 != digest(classifier):
            raise ValueError("its contents do not match their hash, or it is of another version")
        if inputs not in (None, len(classifier.layers[0][0])):
            raise ValueError(f"it has {len(classifier.layers[0][0])} inputs, expected {inputs}")
    except ValueError as error:
        raise ValueError(
            f"{path} is not a whole classifier ({error}); delete it: `surefoot train ... --resume` "
            "trains it again, bit for bit"
        ) from error
    return classifier


def _layers(tensors: Mapping[str, Tensor]) -> tuple[tuple[Float32Array, Float32Array], ...]:
    """The layers of a classifier's file, with a single output.

    Raises:
        ValueError: The tensors are not layers that follow one another, or are not finite.
    """
    count = len(tensors) // 2
    weights = [tensors.get(f"weight{number}") for number in range(count)]
    kinds = []
    # As many inputs as the first layer has rows, and one output.
    sizes = [len(weight) if weight is not None and weight.ndim else 0 for weight in weights] + [1]
    if not weights or 0 in sizes:
        raise ValueError(f"its layers have {sizes} inputs and outputs")
    for number, size in enumerate(pairwise(sizes)):
        kinds.append(TensorKind(f"weight{number}", size))
        kinds.append(TensorKind(f"bias{number}", size[1:]))
    check_tensors(tensors, kinds)
    return tuple(
        (tensors[f"weight{number}"].numpy(), tensors[f"bias{number}"].numpy())
        for number in range(count)
    )


def digest(classifier: Classifier) -> str:
    """SHA-256 of a classifier's quality and layers."""
    sha = hashlib.sha256(json.dumps(_plain(classifier.quality), sort_keys=True).encode())
    for layer in classifier.layers:
        for array in layer:
            sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()


def _plain(quality: ClassifierQuality) -> Header:
    """The quality as JSON, without figures that were not measured."""
    return {key: value for key, value in to_json(quality).items() if value is not None}
