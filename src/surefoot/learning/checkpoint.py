"""The state of a fit after an epoch: weights, Adam's moments and losses; a kill costs one epoch."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from surefoot.config import Steps, TrainingConfig
from surefoot.config.json_io import to_json
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames
from surefoot.learning.network import PolicyNetwork, tensor_kinds
from surefoot.learning.policy import PolicySpec
from surefoot.learning.step import device_name, has_bfloat16
from surefoot.learning.symmetry import Mirrored
from surefoot.learning.tensor_file import (
    TensorKind,
    check_tensors,
    is_intact,
    read_tensor_file,
    write_tensor_file,
)

Losses = list[tuple[float, float]]
"""Training and validation loss [rad] of every finished epoch."""


def key_of(
    network: PolicyNetwork,
    data: Frames | Dataset | Mirrored,
    config: TrainingConfig,
    spec: PolicySpec,
    epochs: int | Steps,
    seed: int,
    device: torch.device,
) -> str:
    """A hash of everything that the result of a fit depends on, as the key of its checkpoint.

    Args:
        network: The network that the fit starts from.
        data: The frames.
        config: The training, with the precision that was chosen.
        spec: How inputs and targets follow from frames.
        epochs: The number of epochs or steps.
        seed: The seed of the fit.
        device: The device that the network is trained on.
    """
    platform = [torch.__version__, device_name(device), has_bfloat16(device)]
    past = [data.ticks_hash] if spec.remembers else []
    inputs = [data.hash, *past, config, spec, epochs, seed, *platform]
    sha = hashlib.sha256()
    for tensor in network.state_dict().values():
        sha.update(tensor.cpu().numpy().tobytes())
    sha.update(json.dumps(to_json(inputs)).encode())
    return sha.hexdigest()


def save_checkpoint(
    path: Path, key: str, network: PolicyNetwork, optimizer: torch.optim.Optimizer, losses: Losses
) -> None:
    """Write the state of a fit, whole or not at all.

    Args:
        path: The file.
        key: Hash of everything that the result of the fit depends on.
        network: The network that is being trained.
        optimizer: Its optimizer.
        losses: The losses so far.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    tensors = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    for index, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": tensor for name, tensor in moments.items()}
    # Not in the header, which would be too long to be read after some ten thousand epochs.
    tensors["losses"] = torch.tensor(losses, dtype=torch.float64).reshape(-1, 2)
    write_tensor_file(path, tensors, {"key": key})


def load_checkpoint(
    path: Path, key: str, network: PolicyNetwork, optimizer: torch.optim.Optimizer
) -> Losses:
    """Restore network and optimizer from a checkpoint.

    A file that does not exist, is damaged, or belongs to another fit is ignored.

    Returns:
        The losses of the finished epochs; empty if nothing was restored.
    """
    if not path.exists():
        return []
    try:
        tensors, header = read_tensor_file(path)
        if header.get("key") != key or not is_intact(tensors, header):
            return []
        losses = _pop_losses(tensors)
        check_tensors(tensors, _expected(network))
    except (ValueError, OverflowError):
        return []
    weights: dict[str, Tensor] = {}
    state: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        owner, rest = name.split(".", 1)
        if owner == "network":
            weights[rest] = tensor
        else:
            index, moment = rest.split(".")
            state.setdefault(int(index), {})[moment] = tensor
    network.load_state_dict(weights)
    groups = optimizer.state_dict()["param_groups"]
    optimizer.load_state_dict({"state": state, "param_groups": groups})
    return losses


def key_in(path: Path) -> str | None:
    """The key of a checkpoint; None without a file that can be read."""
    try:
        return read_tensor_file(path)[1].get("key")
    except (OSError, ValueError, OverflowError):
        return None


def _expected(network: PolicyNetwork) -> Iterator[TensorKind]:
    """The tensors in a checkpoint of this network and its optimizer, except the losses."""
    for kind in tensor_kinds(network.hidden, len(network.mean)):
        yield replace(kind, name=f"network.{kind.name}")
    for index, parameter in enumerate(network.parameters()):
        shape = tuple(parameter.shape)
        yield TensorKind(f"optimizer.{index}.step", (), least=0.0)
        yield TensorKind(f"optimizer.{index}.exp_avg", shape)
        yield TensorKind(f"optimizer.{index}.exp_avg_sq", shape, least=0.0)


def _pop_losses(tensors: dict[str, Tensor]) -> Losses:
    """Remove the losses from a checkpoint's tensors and return them.

    Raises:
        ValueError: There are none, or they are not pairs of numbers.
    """
    stored = tensors.pop("losses", None)
    if stored is None or stored.ndim != 2 or stored.shape[1] != 2 or stored.dtype != torch.float64:
        raise ValueError("its losses are missing, or are not pairs of numbers")
    return [(training, validation) for training, validation in stored.tolist()]
