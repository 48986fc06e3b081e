"""The description of an exported policy, one record with all that is needed to run it safely.

It is stored as JSON under the key `surefoot` in the file's metadata, at full precision. Read
`policy` next, which runs such a file, and `docs/export.md` for the keys.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from surefoot.config import HeightRule, Phase
from surefoot.deploy.kinematics import KinematicTable
from surefoot.learning.joint_limits import MaybePair, Pair, SafetyBounds
from surefoot.learning.layouts import GOAL_PARTS, PARTS, History, Layout
from surefoot.learning.observation import GaitTiming, ObservationSpec, slices
from surefoot.types import JOINTS, TICKS_PER_SECOND, Array

EXPORT_FORMAT = 1
"""Version of the description."""
Kind = Literal["network", "pipeline"]
"""What the graph of a file contains: the network alone, or all from the sensors to the targets."""
KEY = "surefoot"
"""The key of the description in a file's metadata."""
NO_HASH = "0" * 64
"""Takes the place of the hash while the hash is computed."""

Numbers = tuple[float, ...]
"""One number for each joint."""
Triple = tuple[float, float, float]
"""vx, vy [m/s] and yaw rate [rad/s]."""


class ExportFileError(ValueError):
    """An exported file is damaged, or was made for something other than requested."""


@dataclass(frozen=True)
class TermDescription:
    """A part of the network's input.

    Attributes:
        name: Its name.
        size: How many numbers it has.
        unit: Their unit.
        frame: The frame that they are expressed in, or what they are measured from.
    """

    name: str
    size: int
    unit: str
    frame: str


@dataclass(frozen=True)
class HistoryDescription:
    """What the network remembers: samples of the past, the oldest first.

    Attributes:
        samples: Number of samples; the newest is one stride old.
        stride_ms: Time between two samples [ms].
        parts: What a sample consists of, in order.
        targets: Whether a sample ends with the joint targets that were applied at its tick [rad].
    """

    samples: int
    stride_ms: int
    parts: tuple[TermDescription, ...]
    targets: bool


@dataclass(frozen=True)
class StartRange:
    """The initial states that a policy was trained on; it may only take over in such postures.

    Attributes:
        roll: Smallest and largest roll [rad].
        pitch: Smallest and largest pitch [rad].
        joints: ``(12, 2)`` smallest and largest joint angles [rad].
        starts: The name of the set of initial states.
    """

    roll: Pair
    pitch: Pair
    joints: tuple[Pair, ...]
    starts: str


@dataclass(frozen=True)
class PolicyDescription:
    """Everything that a file says in addition to its graph.

    Attributes:
        format: Version of the description.
        kind: What the graph contains.
        robot: Name of the robot.
        joints: ``(12,)`` names of the joints, in the order of inputs and outputs.
        source_joints: ``(12,)`` their names in the robot's own description.
        rate_hz: How often the policy must run [Hz].
        kp: ``(12,)`` stiffness of the joints [N m/rad].
        kd: ``(12,)`` damping of the joints [N m s/rad].
        layout: Name of the layout of the observation.
        observation: The parts of the observation, in order; the history follows them.
        history: What is remembered; None for nothing.
        goal: The parts of the goal, which come last.
        phase: How the gait clock is encoded.
        height: How the height of the base is measured, if it is a part.
        gaits: The gaits, each with its period [ms], duty factor and phase offsets of the legs.
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s], yaw rate [rad/s] trained on.
        torque_limit: ``(12,)`` largest joint torques [N m]; torques are clipped to them.
        speed_limit: ``(12,)`` largest joint rates [rad/s]; None where there is none.
        position_limit: ``(12, 2)`` smallest and largest joint angles [rad]; None where none.
        profile: Name of the hardware profile that the limits come from; None without.
        nominal: ``(12,)`` joint angles of the standing robot [rad].
        start_range: The initial states trained on; None if unknown.
        delay_ms: The delay of the torques in training [ms].
        kinematics: The robot's geometry and masses.
        provenance: Anything about the origin of the policy, as JSON values by name.
        policy_sha256: SHA-256 of the policy file that was exported.
        bounds: The safety bounds that it was trained under; None if unknown.
        sha256: SHA-256 of this file, with the digits of the hash replaced by zeros.

    Raises:
        ValueError: A list does not have one value for each joint, or a number is out of range.
    """

    format: int
    kind: Kind
    robot: str
    joints: tuple[str, ...]
    source_joints: tuple[str, ...]
    rate_hz: int
    kp: Numbers
    kd: Numbers
    layout: str
    observation: tuple[TermDescription, ...]
    history: HistoryDescription | None
    goal: tuple[TermDescription, ...]
    phase: Phase
    height: HeightRule
    gaits: tuple[GaitTiming, ...]
    command_range: tuple[Triple, Triple]
    torque_limit: Numbers
    speed_limit: tuple[float | None, ...]
    position_limit: tuple[MaybePair, ...]
    profile: str | None
    nominal: Numbers
    start_range: StartRange | None
    delay_ms: int
    kinematics: KinematicTable
    provenance: Any
    policy_sha256: str
    bounds: SafetyBounds | None
    sha256: str = NO_HASH

    def __post_init__(self) -> None:
        """Check lengths and ranges."""
        lists = ("joints", "source_joints", "kp", "kd", "torque_limit", "speed_limit")
        for name in (*lists, "position_limit", "nominal"):
            if len(getattr(self, name)) != len(JOINTS):
                raise ValueError(f"{name} has {len(getattr(self, name))} values, expected 12")
        for name in ("kp", "kd", "torque_limit", "nominal", "command_range"):
            if not np.isfinite(np.array(getattr(self, name), float)).all():
                raise ValueError(f"{name} must be finite numbers")
        if not 1 <= self.rate_hz <= TICKS_PER_SECOND or TICKS_PER_SECOND % self.rate_hz:
            raise ValueError(f"rate_hz is {self.rate_hz}; use a divisor of {TICKS_PER_SECOND}")
        if not isinstance(self.provenance, Mapping):
            raise ValueError("provenance must be an object with keys")
        if min(self.kp) <= 0.0 or min(self.kd) < 0.0 or min(self.torque_limit) <= 0.0:
            raise ValueError("kp and torque_limit must be positive, and kd not negative")

    @cached_property
    def spec(self) -> ObservationSpec:
        """The same layout, in the form that the rest of the package uses.

        Raises:
            ValueError: A part has another size, unit or frame than in this version.
        """
        history = None
        if self.history is not None:
            history = History(
                self.history.samples,
                self.history.stride_ms,
                tuple(part.name for part in self.history.parts),
                self.history.targets,
            )
        layout = Layout(self.layout, tuple(part.name for part in self.observation), history)
        radius = self.kinematics.foot_radius if self.height == "above_feet" else 0.0
        spec = ObservationSpec(self.phase, self.gaits, layout, self.height, radius)
        own = layout_terms(spec)
        if LayoutTerms(self.observation, self.history, self.goal) != own:
            raise ValueError("has parts of the observation that are not as in this version")
        return spec


@dataclass(frozen=True)
class LayoutTerms:
    """The parts of a network's input, as the description lists them.

    Attributes:
        observation: The parts of the observation, in order.
        history: What is remembered; None for nothing.
        goal: The parts of the goal.
    """

    observation: tuple[TermDescription, ...]
    history: HistoryDescription | None
    goal: tuple[TermDescription, ...]


def layout_terms(spec: ObservationSpec) -> LayoutTerms:
    """The parts of a network's input.

    Args:
        spec: The layout, in the form that the rest of the package uses.
    """
    history = spec.layout.history
    described = None
    if history is not None:
        described = HistoryDescription(
            history.samples, history.stride, _terms(history.parts), history.targets
        )
    goal = []
    for name, size in spec.goal_sizes.items():
        part = GOAL_PARTS.get(name)
        unit = "1" if part is None else part.unit
        frame = "gait" if part is None else part.frame
        goal.append(TermDescription(name, size, unit, frame))
    return LayoutTerms(_terms(spec.layout.parts), described, tuple(goal))


def _terms(names: tuple[str, ...]) -> tuple[TermDescription, ...]:
    """The descriptions of parts of the observation, by name."""
    return tuple(TermDescription(name, *PARTS[name]) for name in names)


def input_slices(spec: ObservationSpec) -> dict[str, slice]:
    """Where each part lies in the network's input, by name."""
    return slices({**spec.observation_sizes, **spec.goal_sizes})


def file_hash(content: bytes, sha256: str) -> str:
    """SHA-256 of a file in which the digits of its own hash are zeros.

    Args:
        content: The file.
        sha256: The hash that the file gives.

    Raises:
        ValueError: The hash is not in the file exactly once.
    """
    digits = sha256.encode()
    if len(digits) != len(NO_HASH) or content.count(digits) != 1:
        raise ValueError("its hash is not there exactly once")
    return hashlib.sha256(content.replace(digits, NO_HASH.encode())).hexdigest()


def start_limits(start_range: StartRange | None) -> Array:
    """``(2, 14)`` smallest and largest roll, pitch and joint angles; infinite if unknown [rad]."""
    if start_range is None:
        return np.array([[-np.inf] * (2 + len(JOINTS)), [np.inf] * (2 + len(JOINTS))])
    return np.array([start_range.roll, start_range.pitch, *start_range.joints]).T
