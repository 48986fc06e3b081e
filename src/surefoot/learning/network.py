"""The network: normalized inputs, hidden layers with BatchNorm and ReLU, linear outputs.

It serves both policies and classifiers. `folded` turns a trained network into plain weights and
biases, which run at 1 kHz; `network_from_tensors` makes a network from the tensors of a file. Read
next: ``train.py``, which trains it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import torch
from torch import Tensor, nn

from surefoot.config import PolicyConfig
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.tensor_file import TensorKind, check_tensors
from surefoot.types import JOINTS

MINIMUM_ROWS = 8
"""Smaller batches are padded to this many rows: in every BLAS tried, products of fewer rows are
computed differently, with other last bits. From here on a row's result did not depend on its batch.
"""
LEAST_SCALE = 1e-7
"""No input has a smaller scale: `set_normalizers` sets it to 1 if the deviation is at most 1e-6."""


class PolicyNetwork(nn.Module):
    """A map from ``(n, inputs)`` observation and goal to ``(n, 12)`` joint targets [rad].

    Args:
        config: Sizes of the hidden layers.
        seed: Seed of the initial weights (Kaiming normal); PyTorch's global generator is untouched.
        inputs: Number of inputs; by default that of the layout `full`.
        outputs: Number of outputs; by default the joints.
    """

    mean: Tensor
    scale: Tensor
    has_normalisers: Tensor  # the name in policy files, hence the spelling

    def __init__(
        self,
        config: PolicyConfig,
        seed: int = 0,
        inputs: int = INPUT_SIZE,
        outputs: int = len(JOINTS),
    ) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(inputs))
        self.register_buffer("scale", torch.ones(inputs))
        self.register_buffer("has_normalisers", torch.tensor(False))
        self.hidden = tuple(config.hidden)
        sizes = (inputs, *config.hidden, outputs)
        generator = torch.Generator().manual_seed(seed)
        self.linear = nn.ModuleList()
        for before, after in pairwise(sizes):
            layer: Any = nn.utils.skip_init(nn.Linear, before, after)
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu", generator=generator)
            nn.init.zeros_(layer.bias)
            self.linear.append(layer)
        self.norm = nn.ModuleList(nn.BatchNorm1d(size) for size in config.hidden)

    def set_normalizers(self, mean: Tensor, deviation: Tensor) -> None:
        """Center and scale every input from now on; an input that is constant gets scale 1.

        Args:
            mean: ``(inputs,)`` means of observation and goal, float64.
            deviation: ``(inputs,)`` standard deviations of observation and goal, float64.
        """
        constant = deviation <= 1e-6 * mean.abs().clamp(min=1.0)
        self.mean.copy_(mean)
        self.scale.copy_(torch.where(constant, 1.0, deviation))
        self.has_normalisers.fill_(True)

    @property
    def deviation(self) -> Tensor:
        """``(inputs,)`` standard deviations that the normalizers divide by; 0 for a constant."""
        # Only a constant has scale 1, unless a deviation happens to be exactly 1.
        return torch.where(self.scale == 1.0, 0.0, self.scale)

    def forward(self, inputs: Tensor) -> Tensor:
        """Joint targets ``(n, 12)`` [rad] for ``(n, inputs)`` observation and goal."""
        x = (inputs - self.mean) / self.scale
        for linear, norm in zip(self.linear, self.norm, strict=False):
            x = torch.relu(norm(linear(x)))
        # Always in float32, even if the layers above train in bfloat16, which would round a target
        # of 1 rad to 4 mrad.
        with torch.autocast(x.device.type, enabled=False):
            return self.linear[-1](x.float())

    @torch.no_grad()
    def folded(self) -> list[tuple[Tensor, Tensor]]:
        """Weights ``(inputs, outputs)`` and biases with normalizers and BatchNorm folded in.

        With ReLU between them, the layers are the same function as the network in ``eval()`` mode,
        up to float32 rounding.
        """
        layers = []
        # Fold the normalizer before the first layer, x -> (x - shift) / scale, and the BatchNorm
        # after each layer into weights and biases, in float64, rounded once.
        shift = self.mean.double()
        scale = self.scale.double()
        for index, module in enumerate(self.linear):
            linear: Any = module
            # Changed in place, because this copy is most of the memory that loading a policy takes.
            weight = linear.weight.to(torch.float64, copy=True)
            bias = linear.bias.double()
            if index == 0:
                weight /= scale
                bias = bias - weight @ shift
            if index < len(self.norm):
                norm: Any = self.norm[index]
                gain = norm.weight.double() / (norm.running_var.double() + norm.eps).sqrt()
                weight *= gain[:, None]
                bias = (bias - norm.running_mean.double()) * gain + norm.bias.double()
            layers.append((weight.t().float().contiguous().cpu(), bias.float().cpu()))
        return layers


def tensor_kinds(hidden: Sequence[int], inputs: int) -> Iterator[TensorKind]:
    """The tensors in the state of a policy's network, without making one.

    Args:
        hidden: Units of the hidden layers.
        inputs: Number of inputs.
    """
    yield TensorKind("mean", (inputs,))
    yield TensorKind("scale", (inputs,), least=LEAST_SCALE)
    yield TensorKind("has_normalisers", (), torch.bool)
    for index, (before, after) in enumerate(pairwise((inputs, *hidden, len(JOINTS)))):
        yield TensorKind(f"linear.{index}.weight", (after, before))
        yield TensorKind(f"linear.{index}.bias", (after,))
    for index, units in enumerate(hidden):
        for name in ("weight", "bias", "running_mean"):
            yield TensorKind(f"norm.{index}.{name}", (units,))
        yield TensorKind(f"norm.{index}.running_var", (units,), least=0.0)
        yield TensorKind(f"norm.{index}.num_batches_tracked", (), torch.int64)


@torch.no_grad()
def network_from_tensors(
    config: PolicyConfig, tensors: Mapping[str, Tensor], inputs: int = INPUT_SIZE
) -> PolicyNetwork:
    """The network of a policy, in ``eval()`` mode, from the tensors of a file.

    Args:
        config: Sizes of the hidden layers.
        tensors: Its state, by name.
        inputs: Number of inputs.

    Raises:
        ValueError: The tensors are not those of such a network, or its answers would not be finite.
    """
    # Checked first, because a network takes as much memory as its configuration asks for.
    check_tensors(tensors, tensor_kinds(config.hidden, inputs))
    network = PolicyNetwork(config, inputs=inputs)
    network.load_state_dict(dict(tensors))
    for layer in network.eval().folded():
        if not all(array.isfinite().all() for array in layer):
            raise ValueError("its weights and normalizers give weights that are not finite")
    typical = network.mean + network.scale * torch.tensor([[-1.0], [0.0], [1.0]])
    if not network(typical).isfinite().all():
        raise ValueError("its answers to typical inputs are not finite")
    return network
