"""Where a fit stands after an epoch: weights, Adam's moments, losses; a kill costs one epoch."""

from __future__ import annotations

import json
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes

from surefoot.files import write_atomic
from surefoot.learning.policy import digest

Losses = list[tuple[float, float]]
"""Training and validation loss [rad] of every epoch done."""


def save_checkpoint(
    path: Path, key: str, network: torch.nn.Module, optimizer: torch.optim.Optimizer, losses: Losses
) -> None:
    """Write it whole or not at all; ``key`` says of which fit it is."""
    tensors = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    for index, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{index}.{name}": tensor for name, tensor in moments.items()}
    tensors = {name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}
    # As text, because JSON has no NaN.
    record = {"key": key, "losses": json.dumps([list(map(float.hex, pair)) for pair in losses])}
    write_atomic(path, to_bytes(tensors, {**record, "sha256": digest(tensors, record)}))


def load_checkpoint(
    path: Path, key: str, network: torch.nn.Module, optimizer: torch.optim.Optimizer
) -> Losses:
    """Put network and optimizer where the checkpoint left them; the losses of the epochs done.

    A file that is not there, damaged, or of another fit changes nothing: no epoch is done.
    """
    if not path.is_file():
        return []
    try:
        with safe_open(path, framework="pt") as file:
            record = dict(file.metadata() or {})
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError):
        return []
    whole = record.pop("sha256", None) == digest(tensors, record)
    if not whole or record.get("key") != key:
        return []
    weights, state = {}, {}
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
    return [(float.fromhex(a), float.fromhex(b)) for a, b in json.loads(record["losses"])]
