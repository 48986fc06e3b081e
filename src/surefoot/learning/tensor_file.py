"""Files of tensors with a JSON header: policies, classifiers and checkpoints, as safetensors.

Such a file is written whole or not at all, and nothing in it is ever executed. Safetensors detects
a truncated file, but not a changed bit; therefore the header has a SHA-256 of the contents. Reading
takes no more memory than the size of the file justifies: `read_tensor_file` limits the header, and
code that builds something from the tensors calls `check_tensors` first. Read next: ``policy.py``
and ``classifier.py`` for their headers.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from surefoot.config.json_text import parse_json
from surefoot.errors import shown
from surefoot.files import write_atomic

HEADER_KEY = "surefoot"
"""Key of the header, as text, in the metadata of a safetensors file."""
MOST_HEADER = 3_000_000
"""[B] The largest size of a file's table of tensors and its header together, because an empty
tensor takes 20 times the memory of its entry in the table. The paper's policy needs 3000."""

Header = dict[str, Any]
"""The header of a file: any JSON values, by name."""


@dataclass(frozen=True)
class TensorKind:
    """What a tensor of a file must be.

    Attributes:
        name: Its name in the file.
        shape: Its shape.
        dtype: The type of its values.
        least: The smallest value allowed.
    """

    name: str
    shape: tuple[int, ...]
    dtype: torch.dtype = torch.float32
    least: float = -math.inf


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
        ValueError: The header is too long to be read back, or a number in it is not finite.
        WriteError: The disk is full, or read-only.
    """
    plain = {name: tensor.detach().contiguous().cpu() for name, tensor in tensors.items()}
    header = {**header, "sha256": sha256 or _digest(plain, header)}
    try:
        content = to_bytes(plain, {HEADER_KEY: json.dumps(header, allow_nan=False)})
    except (ValueError, SafetensorError) as error:  # a number not finite, or more than 100 MB
        raise ValueError(f"{path} cannot have such a header ({error})") from error
    _check_header_size(path, content)
    write_atomic(path, content)


def read_tensor_file(path: Path) -> tuple[dict[str, Tensor], Header]:
    """Read the tensors and the header of a file; the header's ``sha256`` is the hash.

    Raises:
        ValueError: The file is truncated, or of another kind.
    """
    try:
        if not path.is_file():  # reading a pipe would wait, reading a device would not end
            raise ValueError("it is not a regular file")
        with path.open("rb") as stream:
            _check_header_size(path, stream.read(8))
        with safe_open(path, framework="pt") as file:
            header = _parse_header(file.metadata())
            tensors = {name: _read(file, name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, RuntimeError, OverflowError, TypeError) as error:
        raise ValueError(str(error)) from error
    return tensors, header


def _check_header_size(path: Path | str, content: bytes) -> None:
    """Check the length of table and header, which the first eight bytes of a file state."""
    size = int.from_bytes(content[:8], "little")
    if size > MOST_HEADER:
        raise ValueError(f"the header of {path} has {size} bytes, at most {MOST_HEADER} are read")


def _parse_header(metadata: Mapping[str, str] | None) -> Header:
    """The header from a file's metadata.

    Raises:
        ValueError: There is no header, or it is not a JSON object.
    """
    if not metadata or HEADER_KEY not in metadata:
        raise ValueError("it has no header of this package")
    header = parse_json(metadata[HEADER_KEY].encode())
    if not isinstance(header, dict):
        raise ValueError(f"its header is {shown(header)}, expected a JSON object")
    return header


def _read(file: Any, name: str) -> Tensor:
    """One tensor of an open file, if its type is one that files of this package have."""
    dtype = file.get_slice(name).get_dtype()
    if dtype not in ("F32", "F64", "I64", "BOOL"):  # some others have no bytes for the hash
        raise ValueError(f"tensor {shown(name)} has the type {dtype}")
    # Safetensors returns a memory map of the file: the weights would change with the file, and if
    # it were truncated, reading them would crash the process.
    return file.get_tensor(name).clone()


def check_tensors(tensors: Mapping[str, Tensor], expected: Iterable[TensorKind]) -> None:
    """Check that a file's tensors are exactly the expected ones, with finite and allowed values.

    Args:
        tensors: The tensors by name.
        expected: What each must be; a generator is read only up to the first error.

    Raises:
        ValueError: A tensor is missing, unknown, of another shape or type, or has a value that is
            not finite or too small.
    """
    known = set()
    for kind in expected:
        tensor = tensors.get(kind.name)
        if tensor is None:
            raise ValueError(f"it lacks {kind.name}, which its header asks for")
        if tuple(tensor.shape) != kind.shape or tensor.dtype != kind.dtype:
            raise ValueError(
                f"{kind.name} has shape {tuple(tensor.shape)} and type {tensor.dtype}, "
                f"expected {kind.shape} and {kind.dtype}"
            )
        if not tensor.isfinite().all():
            raise ValueError(f"{kind.name} has numbers that are not finite")
        if kind.least > -math.inf and (tensor < kind.least).any():
            raise ValueError(f"{kind.name} has numbers below {kind.least:.3g}")
        known.add(kind.name)
    if unknown := tensors.keys() - known:
        raise ValueError(f"it has tensors that its header does not ask for: {shown(unknown)}")


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
