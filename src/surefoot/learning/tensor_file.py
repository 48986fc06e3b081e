"""Files of tensors with a JSON header: policies, classifiers and checkpoints, as safetensors.

Such a file is written whole or not at all, and nothing in it is ever run. Safetensors notices a
file that was cut short, but not a changed bit; therefore the header holds a SHA-256 of the
contents. Read next: ``policy.py`` and ``classifier.py`` for what their headers hold.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from surefoot.files import write_atomic

HEADER_KEY = "surefoot"
"""Key of the header, as text, in the metadata of a safetensors file."""

Header = dict[str, Any]
"""What a file says about its tensors: anything that JSON can hold, by name."""


def write_tensor_file(
    path: Path | str, tensors: Mapping[str, Tensor], header: Header, sha256: str | None = None
) -> None:
    """Write tensors and their header to one file, whole or not at all.

    Args:
        path: The file; its folder is made if it does not exist.
        tensors: The tensors by name, on any device.
        header: The header, without the hash.
        sha256: The hash to store; by default that of all contents, which `is_intact` checks.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    plain = {name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}
    header = {**header, "sha256": sha256 or _digest(plain, header)}
    write_atomic(path, to_bytes(plain, {HEADER_KEY: json.dumps(header)}))


def read_tensor_file(path: Path) -> tuple[dict[str, Tensor], Header]:
    """Read the tensors and the header of a file; the header's ``sha256`` is the hash.

    Raises:
        ValueError: The file is cut short, or not of this kind.
    """
    try:
        with safe_open(path, framework="pt") as file:
            header = json.loads(file.metadata()[HEADER_KEY])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(str(error)) from error
    if not isinstance(header, dict):
        raise ValueError("its header is not a JSON object")
    return tensors, header


def is_intact(tensors: Mapping[str, Tensor], header: Header) -> bool:
    """Whether the contents of a file match its hash."""
    content = {key: value for key, value in header.items() if key != "sha256"}
    return header.get("sha256") == _digest(tensors, content)


def _digest(tensors: Mapping[str, Tensor], header: Header) -> str:
    """SHA-256 of the header and of the tensors in the order of their names."""
    sha = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name in sorted(tensors):
        sha.update(name.encode())
        sha.update(tensors[name].numpy().tobytes())
    return sha.hexdigest()
