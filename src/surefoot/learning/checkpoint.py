"""The state of a fit after an epoch: weights, Adam's moments and losses; a kill costs one epoch."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from surefoot.learning.tensor_file import is_intact, read_tensor_file, write_tensor_file

Losses = list[tuple[float, float]]
"""Training and validation loss [rad] of every finished epoch."""


def save_checkpoint(
    path: Path, key: str, network: torch.nn.Module, optimizer: torch.optim.Optimizer, losses: Losses
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
    # As text, because JSON has no NaN.
    exact = [[training.hex(), validation.hex()] for training, validation in losses]
    write_tensor_file(path, tensors, {"key": key, "losses": exact})


def load_checkpoint(
    path: Path, key: str, network: torch.nn.Module, optimizer: torch.optim.Optimizer
) -> Losses:
    """Bring network and optimizer to the state that a checkpoint holds.

    A file that does not exist, is damaged, or belongs to another fit changes nothing.

    Returns:
        The losses of the finished epochs; none if nothing was changed.
    """
    if not path.is_file():
        return []
    try:
        tensors, header = read_tensor_file(path)
    except ValueError:
        return []
    if header.get("key") != key or not is_intact(tensors, header):
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
    return [(float.fromhex(a), float.fromhex(b)) for a, b in header["losses"]]
