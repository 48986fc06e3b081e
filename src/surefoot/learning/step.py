"""One step of Adam on a minibatch, with its device and its precision.

On a GPU the step is a CUDA graph: one launch instead of a hundred. No step waits for the device,
because the losses are summed up on it. Read next: ``train.py``, which takes the steps.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, get_args

import torch
from torch import Tensor

from surefoot.config import Device, NumberFormat, TrainingConfig
from surefoot.errors import unknown
from surefoot.learning.network import PolicyNetwork
from surefoot.types import JOINTS


def choose_device(name: Device) -> torch.device:
    """The requested device; `auto` is a GPU if there is one.

    Raises:
        ValueError: A GPU is requested but there is none, or the device is unknown.
    """
    if name not in get_args(Device):
        raise ValueError(unknown("device", name, get_args(Device)))
    if name == "cuda" and not torch.cuda.is_available():
        raise ValueError(
            f"PyTorch {torch.__version__} finds no GPU; use --device cpu, or install a CUDA build"
        )
    cuda = name != "cpu" and torch.cuda.is_available()
    return torch.device("cuda" if cuda else "cpu")


def device_name(device: torch.device) -> str:
    """The name of the GPU, or `cpu`."""
    return torch.cuda.get_device_name(device) if device.type == "cuda" else "cpu"


def has_bfloat16(device: torch.device) -> bool:
    """Whether the device has instructions for bfloat16; they are not always the faster ones."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    capabilities = torch.cpu.get_capabilities()
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Set PyTorch's number of threads, and restore the previous number afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def make_optimizer(
    network: PolicyNetwork, config: TrainingConfig, device: torch.device
) -> torch.optim.Optimizer:
    """Adam, with its learning rate on the device, where a CUDA graph can read it.

    Args:
        network: The network, on the device.
        config: Learning rate and weight decay. The decay is decoupled from the gradients (AdamW);
            without it the steps are those of plain Adam, to the bit.
        device: The device that computes.
    """
    return torch.optim.Adam(
        network.parameters(),
        lr=torch.tensor(config.learning_rate, device=device),
        weight_decay=config.weight_decay,
        decoupled_weight_decay=True,
        fused=True,
        capturable=device.type == "cuda",
    )


class TrainingStep:
    """One step of Adam on the L1 loss, called with one minibatch after another.

    Args:
        network: The network that is trained, on the device.
        optimizer: Its optimizer, as `make_optimizer` makes it.
        batch: Number of rows of a minibatch.
        precision: Number format of the products of the hidden layers.
        device: The device that computes.
    """

    def __init__(
        self,
        network: PolicyNetwork,
        optimizer: torch.optim.Optimizer,
        batch: int,
        precision: NumberFormat,
        device: torch.device,
    ) -> None:
        self.device = device
        self._network = network
        self._optimizer = optimizer
        self._bfloat16 = precision == "bfloat16"
        self._inputs = len(network.mean)
        self._rows = torch.zeros(batch, self._inputs + len(JOINTS), device=device)
        self._loss = torch.zeros((), dtype=torch.float64, device=device)
        self._launch = self._capture() if device.type == "cuda" else self._compute

    def __call__(self, rows: Tensor) -> None:
        """Train on ``(batch, inputs + 12)`` inputs and targets."""
        self._rows.copy_(rows)
        self._launch()

    def set_learning_rate(self, rate: float) -> None:
        """Set the learning rate of the following steps."""
        self._optimizer.param_groups[0]["lr"].fill_(rate)

    def take_loss(self) -> float:
        """Return the sum of the losses since the last call, and reset it to zero."""
        total = self._loss.item()
        self._loss.zero_()
        return total

    def _compute(self) -> None:
        """Take the step on the rows that are on the device."""
        inputs = self._rows[:, : self._inputs]
        targets = self._rows[:, self._inputs :]
        self._optimizer.zero_grad()
        with torch.autocast(self.device.type, torch.bfloat16, self._bfloat16, cache_enabled=False):
            outputs = self._network(inputs)
        loss = torch.nn.functional.l1_loss(outputs, targets)
        loss.backward()
        self._optimizer.step()
        self._loss += loss.detach()

    def _capture(self) -> Callable[[], None]:
        """The step as a CUDA graph."""
        # Warming up and capturing take real steps, so the changed values are restored afterwards.
        self._network.train()
        before = copy.deepcopy((self._network.state_dict(), self._optimizer.state_dict()))
        side = torch.cuda.Stream()
        side.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(side):
            for _ in range(3):
                self._compute()
        torch.cuda.current_stream().wait_stream(side)
        self._optimizer.zero_grad()
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._compute()
        self._put_back(*before)
        return graph.replay

    def _put_back(self, weights: dict[str, Tensor], optimizer: dict[str, Any]) -> None:
        """Copy values into the tensors that the graph uses, without replacing the tensors.

        Args:
            weights: State of the network.
            optimizer: State of the optimizer; moments that it lacks become zero.
        """
        for name, tensor in self._network.state_dict().items():
            tensor.copy_(weights[name])
        for index, moments in self._optimizer.state_dict()["state"].items():
            for name, tensor in moments.items():
                value = optimizer["state"].get(index, {}).get(name)
                if value is None:
                    tensor.zero_()
                else:
                    tensor.copy_(value)
        self._loss.zero_()
