"""Damaged checkpoints: they change nothing, or bring a fit to a state that it can have."""

from pathlib import Path

import pytest
import torch

from surefoot.config import PolicyConfig
from surefoot.learning.checkpoint import load_checkpoint, save_checkpoint
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz
from tests.fuzz.tensors import contents, header_mutations, sealed, tensor_mutations

LOSSES = [(0.1, float("nan")), (1 / 3, 0.2)]


def fit(seed: int):
    """A network after a step of Adam, with its optimizer."""
    network = PolicyNetwork(PolicyConfig(hidden=(8, 6)), seed).train()
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
    network(torch.ones(4, INPUT_SIZE)).abs().mean().backward()
    optimizer.step()
    return network, optimizer


@pytest.fixture
def path(tmp_path) -> Path:
    """A checkpoint that is whole, and has been read once."""
    path = tmp_path / "fit.safetensors"
    save_checkpoint(path, "key", *fit(1), LOSSES)
    load_and_go_on(path)
    return path


def load_and_go_on(path: Path) -> None:
    """Load a checkpoint into another fit, which has to be able to go on."""
    network, optimizer = fit(2)
    losses = load_checkpoint(path, "key", network, optimizer)
    assert all(isinstance(loss, float) for pair in losses for loss in pair)
    assert all(tensor.isfinite().all() for tensor in network.state_dict().values())
    network(torch.ones(4, INPUT_SIZE)).abs().mean().backward()
    optimizer.step()


def check(path: Path, content: bytes) -> None:
    check_loader(load_and_go_on, path, content, ())


def test_damaged_bytes(path):
    content = path.read_bytes()
    fuzz(byte_mutations(content), lambda damaged: check(path, damaged), 25)


def test_a_damaged_header_with_a_valid_hash(path):
    tensors, header = contents(path)
    del tensors["losses"]
    header["losses"] = [[first.hex(), second.hex()] for first, second in LOSSES]  # as before
    fuzz(header_mutations(header), lambda damaged: check(path, sealed(tensors, damaged)), 25)


def test_damaged_tensors_with_a_valid_hash(path):
    tensors, header = contents(path)
    fuzz(tensor_mutations(tensors), lambda damaged: check(path, sealed(damaged, header)), 25)
