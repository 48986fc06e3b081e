"""The policy's network and PD gains, and its supervised training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from surefoot.config.checked import Checked, Within

Phase = Literal["circle", "fraction"]
"""How the network sees the phase of the gait: as its sine and cosine, or as a share of the period.
"""
LayoutName = Literal["full", "proprioceptive", "full_history"]
"""Names of the layouts of the observation.

- `full`: the whole state, as the paper's policies see it.
- `proprioceptive`: what a robot measures on board, so neither the height of the base nor its linear
  velocity, and what it measured and which joint targets it applied 20, 40, .. 100 ms ago.
- `full_history`: the whole state, and the same history.
"""
HeightRule = Literal["absolute", "above_feet"]
"""How the height of the base is measured: above z = 0, or above the feet that carry load."""
Schedule = Literal["constant", "cosine"]
"""Names of the schedules of the learning rate."""
NumberFormat = Literal["float32", "bfloat16"]
"""Names of the number formats of the hidden layers' products."""
Precision = Literal["auto", NumberFormat]
"""A number format, or `auto` for the one in which a step takes less time."""
MirrorName = Literal["left_right", "front_hind"]
"""Names of the mirrors: which sides of the robot change places."""
MirrorChoice = Literal["none", "auto", MirrorName]
"""A mirror, none, or `auto`: `left_right` where robot, gaits and commands allow it."""
Device = Literal["auto", "cpu", "cuda"]
"""Names of the devices to train on."""


@dataclass(frozen=True)
class Steps:
    """How long a training lasts, as a number of optimizer steps instead of passes over the data.

    Attributes:
        count: Number of steps; the last pass ends with the last of them.
    """

    count: int


@dataclass(frozen=True)
class PolicyConfig(Checked):
    """The network and the low-impedance PD that it drives, at 1 kHz."""

    section: ClassVar[str] = "policy"

    hidden: Annotated[tuple[int, ...], Within(1, 8192)] = (512, 512, 512)
    """Units of the hidden layers (paper, IV-A)."""
    kp: Annotated[float, Within(0.01, 10_000.0)] | None = None
    """[N m/rad] stiffness of the PD; None is the robot's own (Solo12: 2, the paper's research
    code)."""
    kd: Annotated[float, Within(0.0, 1000.0)] | None = None
    """[N m s/rad] damping of the PD; None is the robot's own (Solo12: 0.1, the paper's research
    code)."""
    phase: Phase = "circle"
    """What the network sees of the gait clock: the sine and the cosine of the phase, or the phase
    itself, which jumps from 1 to 0 (paper)."""
    layout: LayoutName = "full"
    """What the network sees of the robot: `full` (paper), `proprioceptive`, or `full_history`."""
    height: HeightRule = "absolute"
    """How the network sees the height of the base: `absolute`, or `above_feet`, which also holds on
    uneven ground."""


@dataclass(frozen=True)
class TrainingConfig(Checked):
    """Supervised training: Adam on the L1 loss (paper, IV-A)."""

    section: ClassVar[str] = "training"

    learning_rate: Annotated[float, Within(1e-12, 1.0)] = 2e-3
    """The learning rate of Adam (paper)."""
    batch: Annotated[int, Within(2, 1_000_000)] = 256
    """Frames in a step; the last incomplete batch is dropped (paper)."""
    schedule: Schedule = "constant"
    """The learning rate stays `constant` (paper), or falls to zero over a fit as a `cosine`."""
    weight_decay: Annotated[float, Within(0.0, 100.0)] = 0.0
    """How fast weights fall toward zero where the data do not hold them: each step takes the share
    `learning_rate` x `weight_decay` off them (AdamW); 0 lets them be (paper). What is left of the
    random first weights decides what a policy does in states that the data hardly show, so the
    decay makes small trainings less a matter of luck."""
    input_noise: Annotated[float, Within(0.0, 10.0)] = 0.0
    """Noise on the observation that the network sees in training, new in each step, with this share
    of each number's standard deviation over the data of the first training; targets, gait clock and
    command stay as they are. 0 is none (paper)."""
    validation: Annotated[float, Within(0.0, 0.9)] = 0.1
    """Share of the episodes that is held out for validation, chosen by episode id."""
    threads: Annotated[int, Within(1, 1024)] = 1
    """Torch threads: a constant, because the bits depend on it. Two are faster on an idle machine,
    and slower than one where a neighbor holds a core."""
    precision: Precision = "auto"
    """Number format of the products of the hidden layers, in training only: `float32`, `bfloat16`,
    or with `auto` the faster one, which is measured once, when a run begins, and kept. Weights,
    sums, the last layer and all else are float32. Name one where the same bits are needed on any
    machine."""
    device: Device = "auto"
    """`auto` takes a GPU if there is one."""
    seed: Annotated[int, Within(0, 2**63 - 1)] | None = None
    """Root of the first weights and of the order of the samples; without it the run's own seed. So
    the same data can be trained on several times."""
    mirror: MirrorChoice = "none"
    """Train on mirror images of the frames too, which are made when training and never stored:
    `left_right`, or `front_hind`, which turns commands forward into commands backward, and is
    refused where those are not trained. A pass over the data has as many steps as without: it shows
    half of the frames and images, and the next pass the other half. It needs a robot and an expert
    without preference for a side, and a gait whose mirrored offsets are the offsets shifted by half
    a period. `auto` is `left_right` where robot, gaits and commands are their own mirror images,
    and `none` elsewhere; it cannot know whether an expert of your own prefers a side."""
    memory: Annotated[int, Within(1, 1_000_000_000)] = 1024
    """[MB] how much memory the training samples take at most; beyond it they go through a temporary
    file. 1024 MB hold 4.3 million frames of the layout `full`, a million with a history, mirror
    images included. While a shard is read, its frames are added, usually 120 MB at most."""
