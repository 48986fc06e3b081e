"""A small network that says yes or no: in training a logit, at run time a plain function of rows.

It serves the learned gates (``gates.py``). Layers, normalisers and their folding are those of the
policy's network. Needs no robotics.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes

from surefoot.config import PolicyConfig
from surefoot.files import write_atomic
from surefoot.learning.network import MINIMUM_ROWS, PolicyNetwork
from surefoot.learning.onnx_graph import onnx_graph, runner
from surefoot.types import BoolArray

HIDDEN = (128, 128)
"""Units of the hidden layers."""
EPOCHS, BATCH, RATE = 6, 1024, 3e-3
"""Passes over the rows, rows of a step, learning rate of Adam (falls to zero as a cosine)."""
MOST_ROWS = 1_000_000
"""Rows of an epoch; of more, so many are drawn."""
NORMALISING_ROWS = 100_000
"""About so many rows give the normalisers; in float64, they are 400 MB of a history gate's."""
FORMAT = 1
"""Version of the file."""


@dataclass(frozen=True)
class Classifier:
    """Layers of a trained network, normalisers folded in.

    Attributes:
        layers: weight ``(inputs, outputs)`` and bias ``(outputs,)`` of each, float32.
        figures: what its training gave, anything that JSON can hold.
    """

    layers: tuple[tuple[NDArray[np.float32], NDArray[np.float32]], ...]
    figures: dict[str, Any]

    def __getstate__(self) -> dict[str, Any]:
        """For other processes, which make their own session."""
        return {"layers": self.layers, "figures": self.figures}

    @cached_property
    def _forward(self) -> Callable[[NDArray[np.float32]], NDArray[np.float32]]:
        return runner(onnx_graph(self.layers))

    def probability(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """``(n,)`` probability of yes, of ``(n, inputs)``; each row's depends on it alone."""
        padded = np.zeros((max(len(rows), MINIMUM_ROWS), rows.shape[1]), np.float32)
        padded[: len(rows)] = rows
        with np.errstate(over="ignore", invalid="ignore"):
            logit = self._forward(padded)[: len(rows), 0]
            return np.float32(1.0) / (np.float32(1.0) + np.exp(-logit))


def fit_classifier(
    rows: NDArray[np.float32], yes: BoolArray, held: BoolArray, seed: int, alarm: float = 0.5
) -> Classifier:
    """Train by binary cross-entropy; the same rows and seed give the same bits.

    Rows weigh the same, however rare yes is: what comes out is a probability as frequent as it says
    it is. Where yes is rare it is seldom beyond 0.5; the alarm is what to lower. Weights that make
    up for the rarity find less (``benchmarks/README.md``).

    Args:
        rows: ``(n, inputs)``, finite.
        yes: ``(n,)``.
        held: ``(n,)`` True for rows to judge it by, which it is not trained on.
        seed: of weights and order.
        alarm: probability beyond which it is judged to say yes.

    Raises:
        ValueError: too few rows to train on.
    """
    training = np.flatnonzero(~held)
    size = min(BATCH, len(training) // 4)
    if size < 2:
        raise ValueError(f"{len(training)} rows are too few to train a classifier on")
    network = PolicyNetwork(PolicyConfig(hidden=HIDDEN), seed, inputs=rows.shape[1], outputs=1)
    x, y = torch.from_numpy(rows), torch.from_numpy(yes.astype(np.float32))
    some = x[torch.from_numpy(training[:: max(1, len(training) // NORMALISING_ROWS)])].double()
    network.set_normalisers(some.mean(0), some.std(0))
    generator = torch.Generator().manual_seed(seed)
    steps = EPOCHS * (min(len(training), MOST_ROWS) // size)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    index, loss_of = torch.from_numpy(training), torch.nn.BCEWithLogitsLoss()
    network.train()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        for _ in range(EPOCHS):
            order = index[torch.randperm(len(index), generator=generator)[:MOST_ROWS]]
            for batch in order.split(size):
                if len(batch) < size:
                    break
                optimizer.zero_grad()
                loss_of(network(x[batch])[:, 0], y[batch]).backward()
                optimizer.step()
                schedule.step()
        layers = tuple((w.numpy(), b.numpy()) for w, b in network.eval().folded())
    finally:
        torch.set_num_threads(threads)
    classifier = Classifier(layers, {})
    figures = {"rows": len(training), "share_yes": float(yes[training].mean()), "seed": seed}
    if held.any():
        figures |= judged(classifier.probability(rows[held]), yes[held], alarm)
    return Classifier(layers, figures)


def judged(probability: NDArray[np.float32], yes: BoolArray, alarm: float) -> dict[str, Any]:
    """How often it says yes rightly.

    At the ``alarm``: ``recall``, ``precision``, and the share of rows it says yes to. At any:
    ``average_precision``, the mean over the yes rows of the precision of an alarm just below each;
    of a network that has learned nothing it is ``held_out_yes / held_out``.
    """
    said = probability > alarm
    right, true = float((said & yes).sum()), yes[np.argsort(-probability, kind="stable")]
    precision = np.cumsum(true) / np.arange(1, len(true) + 1)
    return {
        "held_out": len(yes),
        "held_out_yes": int(yes.sum()),
        "alarm": alarm,
        "recall": right / max(float(yes.sum()), 1.0),
        "precision": right / max(float(said.sum()), 1.0),
        "share_said": float(said.mean()),
        "average_precision": float(precision[true].mean()) if yes.any() else 0.0,
    }


def save_classifier(classifier: Classifier, path: Path) -> None:
    """Write it to a safetensors file, whole or not at all."""
    tensors = {}
    for number, (weight, bias) in enumerate(classifier.layers):
        tensors[f"weight{number}"] = torch.from_numpy(weight)
        tensors[f"bias{number}"] = torch.from_numpy(bias)
    record = {"format": FORMAT, "figures": classifier.figures}
    record["sha256"] = digest(classifier)
    write_atomic(path, to_bytes(tensors, {"surefoot": json.dumps(record)}))


def load_classifier(path: Path) -> Classifier:
    """Read it back, to the bit.

    Raises:
        FileNotFoundError: there is none.
        ValueError: the file is damaged, or of another version.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"there is no classifier {path}; if its run has lost it, `surefoot train ... --resume` "
            "trains it again, bit for bit"
        )
    try:
        with safe_open(path, framework="np") as file:
            record = json.loads(file.metadata()["surefoot"])
            names = sorted(file.keys())
            count = len(names) // 2
            layers = tuple(
                (file.get_tensor(f"weight{n}"), file.get_tensor(f"bias{n}")) for n in range(count)
            )
        classifier = Classifier(layers, record["figures"])
        if record["format"] != FORMAT or record["sha256"] != digest(classifier):
            raise ValueError("its contents do not match their hash, or it is of another version")
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path} is not a whole classifier ({error}); delete it: `surefoot train ... --resume` "
            "trains it again, bit for bit"
        ) from error
    return classifier


def digest(classifier: Classifier) -> str:
    """SHA-256 of its layers and figures."""
    sha = hashlib.sha256(json.dumps(classifier.figures, sort_keys=True).encode())
    for layer in classifier.layers:
        for array in layer:
            sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()
