"""What the policy sees: 42 numbers about the robot's state and 5 about its goal, as named slices.

Nothing in them tells where the robot is or which way is north: turning or shifting the whole robot
leaves every number unchanged. Positions and headings enter only relative to the robot itself.
The network's input is the observation followed by the goal. Read next: ``policy.py``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, get_args

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config, Phase
from surefoot.errors import unknown
from surefoot.rotations import to_heading
from surefoot.types import Array, IntArray, State, to_ticks

Float32Array = NDArray[np.float32]
"""Arrays of the type that networks take and give."""


LONGEST_PERIOD = 10_000
"""[ms] The longest gait period, which is that of `Gait.period`."""


@dataclass(frozen=True)
class ObservationSpec:
    """How a state, a tick and a command become a network's input: layout, phase and period.

    Attributes:
        phase: How the network sees the gait clock, as `PolicyConfig.phase`.
        period_ticks: Gait period [ms].

    Raises:
        ValueError: The phase is unknown, or the period is not between 1 ms and `LONGEST_PERIOD`.
    """

    observation_sizes: ClassVar[dict[str, int]] = {
        "base_height": 1,
        "gravity": 3,
        "base_velocity": 6,
        "joint_position": 12,
        "joint_velocity": 12,
        "feet": 8,
    }
    """Base height [m]; direction of gravity in the base frame; linear and angular velocity of the
    base in its own frame [m/s, rad/s]; joint angles [rad] and rates [rad/s]; x, y of the four feet
    relative to the center of mass in the heading frame [m]. The paper lists all of them but the
    height of the base, which is an additional input here."""
    goal_sizes: ClassVar[dict[str, int]] = {"phase": 2, "command": 3}
    """Gait phase, as sine and cosine, or as a fraction of the period and a zero; vx, vy [m/s] and
    yaw rate [rad/s] in the heading frame."""

    phase: Phase
    period_ticks: int

    def __post_init__(self) -> None:
        """Check both fields."""
        if self.phase not in get_args(Phase):
            raise ValueError(unknown("phase", str(self.phase), get_args(Phase)))
        # A table has a row for each tick of it: `phases`.
        if not 1 <= self.period_ticks <= LONGEST_PERIOD:
            raise ValueError(f"period_ticks is {self.period_ticks}; use 1 to {LONGEST_PERIOD} ms")

    @cached_property
    def phases(self) -> Float32Array:
        """``(period_ticks, 2)`` what the network sees of the gait clock at each tick of a cycle."""
        within = np.arange(self.period_ticks)
        if self.phase == "circle":
            angle = within * (2.0 * np.pi / self.period_ticks)
            columns = (np.sin(angle), np.cos(angle))
        else:
            columns = (within / self.period_ticks, np.zeros(self.period_ticks))
        return np.stack(columns, axis=-1).astype(np.float32)


def observation_spec(config: Config) -> ObservationSpec:
    """What a configuration says about the network's input."""
    return ObservationSpec(config.policy.phase, to_ticks(config.gait.period))


def _slices(sizes: dict[str, int]) -> dict[str, slice]:
    """Consecutive slices of the given sizes."""
    slices = {}
    start = 0
    for name, size in sizes.items():
        slices[name] = slice(start, start + size)
        start += size
    return slices


OBSERVATION = _slices(ObservationSpec.observation_sizes)
"""Where each part of the observation lies in it."""
OBSERVATION_SIZE = sum(ObservationSpec.observation_sizes.values())
GOAL = _slices(ObservationSpec.goal_sizes)
"""Where each part of the goal lies in it."""
GOAL_SIZE = sum(ObservationSpec.goal_sizes.values())
INPUT_SIZE = OBSERVATION_SIZE + GOAL_SIZE


def observe(state: State, out: Float32Array | None = None) -> Float32Array:
    """The observation of one robot, or of any batch of robots.

    Args:
        state: States with any leading axes.
        out: ``(..., 42)`` array to write into.

    Returns:
        ``(..., 42)`` float32, laid out as ``OBSERVATION``.
    """
    q = state.q
    v = state.v
    if out is None:
        out = np.empty((*q.shape[:-1], OBSERVATION_SIZE), np.float32)
    feet = state.feet[..., :2] - state.com[..., None, :2]
    feet = to_heading(feet, state.heading[..., None, :])
    parts = {
        "base_height": q[..., 2:3],
        "gravity": -state.rotation[..., 2, :],
        "base_velocity": v[..., :6],
        "joint_position": q[..., 7:],
        "joint_velocity": v[..., 6:],
        "feet": feet.reshape(*q.shape[:-1], 8),
    }
    return np.concatenate([parts[name] for name in OBSERVATION], axis=-1, out=out)


def goal(
    tick: IntArray | int,
    command: Array,
    spec: ObservationSpec,
    out: Float32Array | None = None,
) -> Float32Array:
    """The goal: how far the gait cycle is, and where to go.

    Args:
        tick: ``(...)`` gait clock [ms].
        command: ``(..., 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        spec: The gait period, and how the phase is given.
        out: ``(..., 5)`` array to write into.

    Returns:
        ``(..., 5)`` float32, laid out as ``GOAL``; exactly periodic in ``tick``.
    """
    command = np.asarray(command)
    if out is None:
        shape = np.broadcast_shapes(np.shape(tick), command.shape[:-1])
        out = np.empty((*shape, GOAL_SIZE), np.float32)
    out[..., GOAL["phase"]] = spec.phases[np.asarray(tick) % spec.period_ticks]
    out[..., GOAL["command"]] = command
    return out


def network_input(
    state: State,
    tick: IntArray | int,
    command: Array,
    spec: ObservationSpec,
    out: Float32Array | None = None,
) -> Float32Array:
    """Observation and goal side by side, as the network takes them.

    Args:
        state: States with any leading axes.
        tick: ``(...)`` gait clock [ms].
        command: ``(..., 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        spec: The gait period, and how the phase is given.
        out: ``(..., 47)`` array to write into.

    Returns:
        ``(..., 47)`` float32: first ``OBSERVATION``, then ``GOAL``.
    """
    if out is None:
        out = np.empty((*state.q.shape[:-1], INPUT_SIZE), np.float32)
    observe(state, out[..., :OBSERVATION_SIZE])
    goal(tick, command, spec, out[..., OBSERVATION_SIZE:])
    return out
