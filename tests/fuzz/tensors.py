"""Files of tensors with a valid hash, and random changes of what they hold."""

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from tests.fuzz.mutations import json_mutations

Tensors = dict[str, Tensor]

MOST_HEADER = 10_000_000
"""[B] Beyond 100 MB safetensors writes no file."""

DTYPES = (
    torch.float64,
    torch.float16,
    torch.bfloat16,
    torch.int64,
    torch.int8,
    torch.uint64,
    torch.bool,
    torch.complex64,
    torch.float8_e5m2,
)
VALUES = (math.nan, math.inf, -math.inf, -1.0, 0.0, 1e38, -1e38, 1e-45, 1e30)


def contents(path: Path) -> tuple[Tensors, Any]:
    """The tensors and the header of a file, without the hash."""
    with safe_open(path, framework="pt") as file:
        header = json.loads(file.metadata()["surefoot"])
        tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
    del header["sha256"]
    return tensors, header


def tensor_bytes(tensor: Tensor) -> bytes:
    """The bytes of a tensor of any type."""
    return tensor.contiguous().reshape(-1).view(torch.uint8).numpy().tobytes()


def sealed(tensors: Mapping[str, Tensor], header: Any) -> bytes:
    """The bytes of a file whose hash is that of its contents, whatever they are."""
    sha = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name in sorted(tensors):
        sha.update(name.encode() + tensor_bytes(tensors[name]))
    if isinstance(header, dict):
        header = {**header, "sha256": sha.hexdigest()}
    return to_bytes(dict(tensors), {"surefoot": json.dumps(header)})


def header_mutations(header: Any) -> st.SearchStrategy[Any]:
    """The header after changes as those of `json_mutations`, if safetensors writes it."""
    return json_mutations(header).filter(lambda value: len(json.dumps(value)) < MOST_HEADER)


@st.composite
def tensor_mutations(draw: st.DrawFn, tensors: Mapping[str, Tensor]) -> Tensors:
    """The tensors after one or two changes: other names, types, shapes or values."""
    changed = {name: tensor.clone() for name, tensor in tensors.items()}
    for _ in range(draw(st.integers(1, 2))):
        name = draw(st.sampled_from(sorted(changed)))
        other = draw(st.sampled_from(sorted(changed)))
        kind = draw(st.sampled_from(["type", "value", "shape", "drop", "rename", "swap", "longer"]))
        tensor = changed[name]
        if kind == "type":
            changed[name] = tensor.to(draw(st.sampled_from(DTYPES)))
        elif kind == "value" and tensor.numel() and tensor.is_floating_point():
            index = draw(st.integers(0, tensor.numel() - 1))
            tensor = tensor.contiguous()
            tensor.view(-1)[index] = draw(st.sampled_from(VALUES))
            changed[name] = tensor
        elif kind == "shape":
            shapes = [(-1,), (1, *tensor.shape), (*tensor.shape, 1), tuple(tensor.shape[::-1])]
            changed[name] = tensor.reshape(draw(st.sampled_from(shapes)))
        elif kind == "drop":
            del changed[name]
        elif kind == "rename":
            new = draw(st.one_of(st.text(max_size=4), st.just(name[:-1]), st.just(name + ".x")))
            changed[new] = changed.pop(name)
        elif kind == "swap":
            changed[name], changed[other] = changed[other].clone(), changed[name].clone()
        elif kind == "longer":
            size = draw(st.sampled_from([0, 1, 1000]))
            changed[name] = torch.zeros(size, *tensor.shape[1:], dtype=tensor.dtype)
        if not changed:
            break
    return changed
