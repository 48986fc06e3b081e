"""Layouts of the observation, as data: the named parts that a network sees now and remembers.

`PARTS` has all parts that a layout can choose from, `LAYOUTS` the named layouts. A history has
samples that are one stride apart, and the joint targets that were applied at the same ticks: they
show how far the expert has come in its plan, which no state does. A stride of less than 20 ms is
refused for targets. The target of 1 ms ago predicts the next one so well that the network copies
it: its error on held-out frames is then the lowest of all, but the robot falls. Read `observation`
next, which computes the parts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.config import LayoutName
from surefoot.errors import shown, unknown
from surefoot.types import IntArray

SHORTEST_STRIDE = 20
"""[ms] The shortest stride of joint targets in a history: at 20 ms they helped, at 1 ms the network
copied them."""
LONGEST_HISTORY = 200
"""[ms] The largest age of a sample in a history: recordings have the ticks of this time before each
kept frame. All ticks would be several times the data."""
TARGET_SIZE = 12
"""The joint targets of a sample: one for each joint."""


class Part(NamedTuple):
    """A named part of the observation.

    Attributes:
        size: The number of its values.
        unit: Their unit.
        frame: The frame that they are expressed in, or what they are measured from.
    """

    size: int
    unit: str
    frame: str


PARTS: Mapping[str, Part] = {
    "base_height": Part(1, "m", "world"),
    "gravity": Part(3, "1", "base"),
    "linear_velocity": Part(3, "m/s", "base"),
    "angular_velocity": Part(3, "rad/s", "base"),
    "joint_position": Part(12, "rad", "joint"),
    "joint_velocity": Part(12, "rad/s", "joint"),
    "feet": Part(8, "m", "heading, from the center of mass"),
}
"""Height of the base above z = 0 or above the loaded feet; direction of gravity; linear and angular
velocity of the base; joint angles and rates; x, y of the four feet."""
GOAL_PARTS: Mapping[str, Part] = {
    "phase": Part(2, "1", "gait"),
    "command": Part(3, "m/s, m/s, rad/s", "heading"),
}
"""Gait phase, as sine and cosine, or as a fraction of the period and a zero; vx, vy, yaw rate. A
policy of several gaits also sees which gait to walk, as a one-hot part named `gait`."""
STORED_FORMER = {"linear_velocity": "base_velocity"}
"""Files of format 2 have both velocities of the base as one part of six numbers."""


@dataclass(frozen=True)
class History:
    """What a network remembers: samples of the past, the oldest first.

    Attributes:
        samples: Number of samples; the newest is one stride old.
        stride: Time between two samples [ms].
        parts: Names of the parts of a sample, from `PARTS`.
        targets: Whether a sample ends with the joint targets that were applied at its tick [rad].

    Raises:
        ValueError: A number is out of range, a part is unknown or given twice, or the targets are
            less than `SHORTEST_STRIDE` apart.
    """

    samples: int = 5
    stride: int = 20
    parts: tuple[str, ...] = ("gravity", "angular_velocity", "joint_position", "joint_velocity")
    targets: bool = True

    def __post_init__(self) -> None:
        """Check all fields."""
        if self.samples < 1 or self.stride < 1 or self.reach > LONGEST_HISTORY:
            raise ValueError(
                f"a history of {self.samples} samples, {self.stride} ms apart; use at least one "
                f"sample and 1 ms, and at most {LONGEST_HISTORY} ms in all"
            )
        _check_parts(self.parts, "a history")
        if self.targets and self.stride < SHORTEST_STRIDE:
            raise ValueError(
                f"a history of joint targets {self.stride} ms apart: the network would copy the "
                "last one instead of looking at the robot, and the robot falls although the error "
                f"on held-out frames is the lowest of all; use a stride of {SHORTEST_STRIDE} ms or "
                "more, or targets=False"
            )

    @property
    def reach(self) -> int:
        """Age of the oldest sample [ms]."""
        return self.samples * self.stride

    @property
    def ages(self) -> IntArray:
        """``(samples,)`` age of each sample [ms], the oldest first."""
        return self.stride * np.arange(self.samples, 0, -1)

    @property
    def sample_size(self) -> int:
        """Number of values in a sample."""
        return sum(PARTS[name].size for name in self.parts) + TARGET_SIZE * self.targets

    @property
    def size(self) -> int:
        """Number of values in all samples together."""
        return self.samples * self.sample_size


@dataclass(frozen=True)
class Layout:
    """What a network sees of the robot, in addition to the goal.

    Attributes:
        name: A name for messages and files.
        parts: Names of the parts of the present observation, from `PARTS`, in order.
        history: What the network remembers; None for nothing.

    Raises:
        ValueError: A part is unknown or given twice, or there is none.
    """

    name: str
    parts: tuple[str, ...]
    history: History | None = None

    def __post_init__(self) -> None:
        """Check the parts."""
        _check_parts(self.parts, f"the layout {self.name!r}")
        if not self.parts:
            raise ValueError(f"the layout {shown(self.name)} has no parts; use some of {[*PARTS]}")


def _check_parts(parts: tuple[str, ...], owner: str) -> None:
    """Check that all parts are known, and that none is given twice.

    Raises:
        ValueError: A part is unknown (the message suggests the nearest), or given twice.
    """
    for name in parts:
        if name not in PARTS:
            raise ValueError(f"{owner}: {unknown('part', name, PARTS)}")
    if len(set(parts)) < len(parts):
        raise ValueError(f"{owner} has the parts {shown(parts)}; use each of them once")


_MEASURED = ("gravity", "angular_velocity", "joint_position", "joint_velocity", "feet")

LAYOUTS: Mapping[LayoutName, Layout] = {
    "full": Layout("full", tuple(PARTS)),
    "proprioceptive": Layout("proprioceptive", _MEASURED, History()),
    "full_history": Layout("full_history", tuple(PARTS), History()),
}
"""The layouts that a configuration can name."""
