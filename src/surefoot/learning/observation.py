"""What the policy sees: numbers about the robot's state, its past and its goal, as named parts.

They do not depend on where the robot is or which way is north: shifting the robot horizontally or
turning it about the vertical leaves every number unchanged. The network's input is the observation,
with the history at its end, followed by the goal. In the layout `full` with one gait these are 42
numbers about the state and 5 about the goal; gates and traces always see these 47, whatever the
policy sees. Read next: ``memory.py`` for the history, then ``policy.py``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from surefoot.config import MOST_GAITS, Config, Gait, HeightRule, Phase
from surefoot.config.gait_table import GAITS, gait_name, gait_names
from surefoot.config.robot_table import ROBOTS
from surefoot.errors import shown, unknown
from surefoot.learning.layouts import GOAL_PARTS, LAYOUTS, PARTS, Layout
from surefoot.rotations import to_heading
from surefoot.types import TICKS_PER_SECOND, Array, IntArray, State, ground_height, to_ticks

Float32Array = NDArray[np.float32]
"""The type of a network's inputs and outputs."""


LONGEST_PERIOD = 10_000
"""[ms] The longest gait period, the same as the limit of `Gait.period`."""


@dataclass(frozen=True)
class GaitTiming:
    """A gait, as in a policy file.

    Attributes:
        name: Its name, as in `gait_names`.
        period_ticks: The period [ms].
        duty: Share of the period in which a foot stands.
        offsets: ``(4,)`` phase offsets of FL, FR, HL, HR in periods.

    Raises:
        ValueError: The period is not between 1 ms and `LONGEST_PERIOD`, or a share not in 0 to 1.
    """

    name: str
    period_ticks: int
    duty: float = Gait().duty
    offsets: tuple[float, float, float, float] = Gait().offsets

    def __post_init__(self) -> None:
        """Check the numbers."""
        # `ObservationSpec.phases` is a table with a row for each tick of the period.
        if not 1 <= self.period_ticks <= LONGEST_PERIOD:
            raise ValueError(f"period_ticks is {self.period_ticks}; use 1 to {LONGEST_PERIOD} ms")
        if not all(0.0 <= share <= 1.0 for share in (self.duty, *self.offsets)):
            raise ValueError(
                f"a gait with duty {self.duty} and offsets {self.offsets}; use shares from 0 to 1"
            )

    @property
    def gait(self) -> Gait:
        """The gait with this timing: a named gait, which may also set heights, or a plain one."""
        gait = Gait(self.period_ticks / TICKS_PER_SECOND, self.duty, self.offsets)
        return GAITS.get(gait_name(gait), gait)


@dataclass(frozen=True)
class ObservationSpec:
    """How states, ticks and commands become a network's input.

    Attributes:
        phase: How the network sees the gait clock, as `PolicyConfig.phase`.
        gaits: The gaits, each with its own period; if there are several, the goal tells which one
            to walk.
        layout: What the network sees of the robot, now and in the past.
        height: How the height of the base is measured, as `PolicyConfig.height`.
        foot_radius: Radius of the foot spheres [m], for a height above the feet.

    Raises:
        ValueError: The phase or the height rule is unknown, there is no gait or there are too many,
            or the radius is out of range.
    """

    phase: Phase
    gaits: tuple[GaitTiming, ...]
    layout: Layout = LAYOUTS["full"]
    height: HeightRule = "absolute"
    foot_radius: float = 0.0

    def __post_init__(self) -> None:
        """Check all fields."""
        if self.phase not in get_args(Phase):
            raise ValueError(unknown("phase", str(self.phase), get_args(Phase)))
        if self.height not in get_args(HeightRule):
            raise ValueError(unknown("height", str(self.height), get_args(HeightRule)))
        if not 1 <= len(self.gaits) <= MOST_GAITS:
            raise ValueError(f"a policy of {len(self.gaits)} gaits; use 1 to {MOST_GAITS}")
        if not 0.0 <= self.foot_radius <= 1.0:
            raise ValueError(f"foot_radius is {self.foot_radius}; use 0 to 1 m")

    @cached_property
    def observation_sizes(self) -> dict[str, int]:
        """Names and sizes of the parts of the observation, in order."""
        sizes = {name: PARTS[name].size for name in self.layout.parts}
        if self.layout.history is not None:
            sizes["history"] = self.layout.history.size
        return sizes

    @cached_property
    def goal_sizes(self) -> dict[str, int]:
        """Names and sizes of the parts of the goal, in order."""
        sizes = {name: part.size for name, part in GOAL_PARTS.items()}
        if len(self.gaits) > 1:
            sizes["gait"] = len(self.gaits)
        return sizes

    @cached_property
    def observation_size(self) -> int:
        """Number of values in the observation, including the history."""
        return sum(self.observation_sizes.values())

    @cached_property
    def goal_size(self) -> int:
        """Number of values in the goal."""
        return sum(self.goal_sizes.values())

    @property
    def input_size(self) -> int:
        """Number of values in the network's input."""
        return self.observation_size + self.goal_size

    @cached_property
    def phases(self) -> Float32Array:
        """``(gaits, longest period, 2)`` what the network sees of the clock at each tick.

        Rows beyond the period of a shorter gait are zero.
        """
        longest = max(gait.period_ticks for gait in self.gaits)
        table = np.zeros((len(self.gaits), longest, 2), np.float32)
        for number, gait in enumerate(self.gaits):
            within = np.arange(gait.period_ticks)
            if self.phase == "circle":
                angle = within * (2.0 * np.pi / gait.period_ticks)
                columns = (np.sin(angle), np.cos(angle))
            else:
                columns = (within / gait.period_ticks, np.zeros(gait.period_ticks))
            table[number, : gait.period_ticks] = np.stack(columns, axis=-1)
        return table

    @cached_property
    def periods(self) -> IntArray:
        """``(gaits,)`` the periods [ms]."""
        return np.array([gait.period_ticks for gait in self.gaits])


def gait_timings(gaits: Sequence[Gait]) -> tuple[GaitTiming, ...]:
    """The timings of the configured gaits, with their names."""
    return tuple(
        GaitTiming(name, to_ticks(gait.period), gait.duty, gait.offsets)
        for name, gait in zip(gait_names(gaits), gaits, strict=True)
    )


def observation_spec(config: Config) -> ObservationSpec:
    """The observation spec of a configuration.

    Raises:
        ValueError: The height is measured above the feet, but the configuration lacks the robot's
            spec, which has the radius of the feet.
    """
    policy = config.policy
    radius = 0.0
    if policy.height == "above_feet":
        robot = config.robot.spec or ROBOTS.get(config.robot.model)
        if robot is None:
            raise ValueError(
                f"policy.height is above_feet, but of {config.robot.model} nothing is known yet: "
                "load the robot first, and put its spec into robot.spec"
            )
        radius = robot.foot_radius
    gaits = gait_timings(config.gaits)
    return ObservationSpec(policy.phase, gaits, LAYOUTS[policy.layout], policy.height, radius)


def state_spec(config: Config) -> ObservationSpec:
    """What gates and traces see in every run: the full state and the goal, without a history.

    They watch a robot in training, whose true state is known; a policy may see less.

    Raises:
        ValueError: The configuration has several gaits; gates and traces support only one.
    """
    if config.other_gaits:
        raise ValueError(
            f"learned gates, environments and exported data see one gait, but the configuration "
            f"has {len(config.gaits)}: {', '.join(gait_names(config.gaits))}; use a run of one"
        )
    return ObservationSpec(config.policy.phase, gait_timings([config.gait]))


def slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Consecutive slices of the given sizes, by name."""
    result = {}
    start = 0
    for name, size in sizes.items():
        result[name] = slice(start, start + size)
        start += size
    return result


_FULL = {name: part.size for name, part in PARTS.items()}
_GOAL = {name: part.size for name, part in GOAL_PARTS.items()}
OBSERVATION = slices(_FULL)
"""Where each part lies in the observation of the layout `full`."""
OBSERVATION_SIZE = sum(_FULL.values())
GOAL = slices(_GOAL)
"""Where each part lies in the goal of one gait."""
GOAL_SIZE = sum(_GOAL.values())
INPUT_SIZE = OBSERVATION_SIZE + GOAL_SIZE
"""Number of inputs of gates and traces, and of a policy with the layout `full` and one gait."""


def columns_of(parts: Iterable[str]) -> IntArray:
    """``(n,)`` columns of some parts in the observation of the layout `full`.

    Args:
        parts: Names of the parts, from `PARTS`, in the order of the columns.
    """
    every = np.arange(OBSERVATION_SIZE)
    return np.concatenate([every[:0], *(every[OBSERVATION[name]] for name in parts)])


def observe(
    state: State,
    parts: Iterable[str] = tuple(PARTS),
    ground: Array | float = 0.0,
    out: Float32Array | None = None,
) -> Float32Array:
    """Parts of the observation of one robot, or of any batch of robots, side by side.

    Args:
        state: States with any leading axes.
        parts: Names of the parts, from `PARTS`; by default all of them.
        ground: ``(...)`` ground height, from which the height of the base is measured [m].
        out: ``(..., n)`` array to write into.

    Returns:
        ``(..., n)`` float32; ``n`` is 42 for all parts.
    """
    parts = tuple(parts)
    columns = [_part(state, name, ground) for name in parts]
    if out is None:
        size = sum(PARTS[name].size for name in parts)
        out = np.empty((*state.q.shape[:-1], size), np.float32)
    return np.concatenate(columns, axis=-1, out=out)


def _part(state: State, name: str, ground: Array | float) -> Array:
    """``(..., size)`` one part of the observation."""
    q = state.q
    v = state.v
    if name == "base_height":
        return (q[..., 2] - ground)[..., None]
    if name == "gravity":
        return -state.rotation[..., 2, :]
    if name == "feet":
        feet = state.feet[..., :2] - state.com[..., None, :2]
        feet = to_heading(feet, state.heading[..., None, :])
        return feet.reshape(*q.shape[:-1], 8)
    return {
        "linear_velocity": v[..., :3],
        "angular_velocity": v[..., 3:6],
        "joint_position": q[..., 7:],
        "joint_velocity": v[..., 6:],
    }[name]


def goal(
    tick: IntArray | int,
    command: Array,
    spec: ObservationSpec,
    out: Float32Array | None = None,
    gait: IntArray | int = 0,
) -> Float32Array:
    """The goal: the phase of the gait cycle, the command, and with several gaits, which to walk.

    Args:
        tick: ``(...)`` gait clock [ms].
        command: ``(..., 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        spec: The gaits, and how the phase is given.
        out: ``(..., goal_size)`` array to write into.
        gait: ``(...)`` index in `spec.gaits` of the gait that each robot is to walk.

    Returns:
        ``(..., goal_size)`` float32, laid out as ``GOAL``; exactly periodic in ``tick``.
    """
    command = np.asarray(command)
    if out is None:
        shape = np.broadcast_shapes(np.shape(tick), command.shape[:-1], np.shape(gait))
        out = np.empty((*shape, spec.goal_size), np.float32)
    out[..., GOAL["phase"]] = spec.phases[gait, np.asarray(tick) % spec.periods[gait]]
    out[..., GOAL["command"]] = command
    if len(spec.gaits) > 1:
        out[..., GOAL_SIZE:] = np.arange(len(spec.gaits)) == np.asarray(gait)[..., None]
    return out


def network_input(
    state: State,
    tick: IntArray | int,
    command: Array,
    spec: ObservationSpec,
    out: Float32Array | None = None,
    history: Float32Array | None = None,
    gait: IntArray | int = 0,
) -> Float32Array:
    """Observation and goal side by side: the input of the network.

    Args:
        state: States with any leading axes.
        tick: ``(...)`` gait clock [ms].
        command: ``(..., 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        spec: Layout, gaits, and how phase and height are given.
        out: ``(..., input_size)`` array to write into.
        history: ``(..., history.size)`` samples of the past, from ``memory.py``.
        gait: ``(...)`` index in `spec.gaits` of the gait that each robot is to walk.

    Returns:
        ``(..., input_size)`` float32: the layout's parts, its history, then the goal.

    Raises:
        ValueError: The layout has a history and none is given, or the other way around.
    """
    if (history is None) != (spec.layout.history is None):
        raise ValueError(
            f"the layout {shown(spec.layout.name)} has "
            f"{'no' if history is not None else 'a'} history; "
            f"give {'none' if history is not None else 'it'}"
        )
    if out is None:
        out = np.empty((*state.q.shape[:-1], spec.input_size), np.float32)
    ground = 0.0 if spec.height == "absolute" else ground_height(state, spec.foot_radius)
    now = spec.observation_size
    if history is not None:
        now -= history.shape[-1]
        out[..., now : spec.observation_size] = history
    observe(state, spec.layout.parts, ground, out[..., :now])
    goal(tick, command, spec, out[..., spec.observation_size :], gait)
    return out
