"""The policy's network and PD gains, and its supervised training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Phase = Literal["circle", "fraction"]
"""How the network sees the phase of the gait: as its sine and cosine, or as a share of the period.
"""
Device = Literal["auto", "cpu", "cuda"]
"""Names of the devices to train on."""


@dataclass(frozen=True)
class PolicyConfig:
    """The network and the low-impedance PD it drives, at 1 kHz."""

    hidden: tuple[int, ...] = (512, 512, 512)
    """Units of the hidden layers (paper, IV-A)."""
    kp: float = 2.0
    """[Nm/rad] (the paper's research code)."""
    kd: float = 0.1
    """[Nms/rad] (the paper's research code)."""
    phase: Phase = "circle"
    """What the network sees of the gait clock: sine and cosine of the phase, or the phase itself,
    which jumps from 1 to 0 (paper)."""


@dataclass(frozen=True)
class TrainingConfig:
    """Supervised training: Adam on the L1 loss (paper, IV-A)."""

    learning_rate: float = 2e-3
    """(paper)."""
    batch: int = 256
    """Frames a step; the last incomplete batch is dropped (paper)."""
    schedule: Literal["constant", "cosine"] = "constant"
    """`constant` (paper) or `cosine` to zero over a fit."""
    validation: float = 0.1
    """Share of episodes held out, chosen by episode id."""
    threads: int = 1
    """Torch threads: a constant, because the bits depend on it. Two are faster on an idle machine,
    and slower than one where a neighbour holds a core."""
    precision: Literal["float32", "bfloat16"] = "bfloat16"
    """of the products of the hidden layers, in training only. `bfloat16` is used where the
    processor has instructions for it; weights, sums, the last layer and all else are float32."""
    device: Device = "auto"
    """`auto` takes a GPU if there is one."""
    memory: int = 1024
    """[MB] that examples take at most; more go through a temporary file. 1024 hold 4.5 million
    frames. The frames of one shard come on top while they are read, 120 MB at most as a rule."""
