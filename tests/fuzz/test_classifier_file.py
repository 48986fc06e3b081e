"""Damaged files of classifiers: refused with a clear error, or classifiers that answer."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save as to_bytes

from surefoot.learning.classifier import (
    Classifier,
    ClassifierQuality,
    load_classifier,
    save_classifier,
)
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz
from tests.fuzz.tensors import Tensors, contents, header_mutations, tensor_bytes, tensor_mutations

QUALITY = ClassifierQuality(90, 0.2, 0, 10, 2, 0.5, 1.0, 0.5, 0.4, 0.7)


@pytest.fixture
def path(tmp_path) -> Path:
    """A file that is whole, and has been read once."""
    path = tmp_path / "history-001.safetensors"
    rng = np.random.default_rng(0)
    layers = tuple(
        (rng.normal(size=size).astype(np.float32), rng.normal(size=size[1]).astype(np.float32))
        for size in [(5, 4), (4, 3), (3, 1)]
    )
    save_classifier(Classifier(layers, QUALITY), path)
    load_and_ask(path)
    return path


def load_and_ask(path: Path) -> None:
    """Load a classifier; one that is accepted has to be of use."""
    classifier = load_classifier(path, 5)
    assert classifier.probability(np.zeros((2, 5), np.float32)).shape == (2,)


def check(path: Path, content: bytes) -> None:
    check_loader(load_and_ask, path, content, ValueError)


def sealed(tensors: Tensors, header: Any) -> bytes:
    """The bytes of a file whose hash is that of its contents, whatever they are."""
    if isinstance(header, dict):
        sha = hashlib.sha256(json.dumps(header.get("figures"), sort_keys=True).encode())
        for number in range(3):
            for kind in ("weight", "bias"):
                sha.update(tensor_bytes(tensors.get(f"{kind}{number}", torch.zeros(0))))
        header = {**header, "sha256": sha.hexdigest()}
    return to_bytes(tensors, {"surefoot": json.dumps(header)})


def test_damaged_bytes(path):
    content = path.read_bytes()
    fuzz(byte_mutations(content), lambda damaged: check(path, damaged), 40)


def test_a_damaged_header_with_a_valid_hash(path):
    tensors, header = contents(path)
    fuzz(header_mutations(header), lambda damaged: check(path, sealed(tensors, damaged)), 40)


def test_damaged_tensors_with_a_valid_hash(path):
    tensors, header = contents(path)
    fuzz(tensor_mutations(tensors), lambda damaged: check(path, sealed(damaged, header)), 40)
