"""The records and protocols that every part of the package agrees on.

Arrays follow Pinocchio's conventions: ``q = [x y z, qx qy qz qw, 12 joints]``, ``v = [base linear
and angular velocity in the base frame, 12 joint rates]``; legs FL, FR, HL, HR; joints HAA, HFE, KFE
of each leg. SI units, radians; time is an integer tick of 1 ms. ``...`` is a batch axis that may be
absent: one ``State`` serves one robot and a batch alike. The module needs numpy only, so that
learning runs where there is no robotics stack. Read `rollouts.engine` next, where they meet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from surefoot import rotations
from surefoot.errors import shown
from surefoot.rotations import Array

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

TICKS_PER_SECOND = 1000
"""Ticks of the clock per second."""
TICK_NS = 10**9 // TICKS_PER_SECOND
"""The length of a tick [ns]."""
GRID = 50
"""[ms] The node spacing of plans, and the period of replanning (BiConMP: 20 Hz)."""
GRAVITY = 9.81
"""[m/s^2] Gravity, in the planner and in the simulators."""
LEGS = ("FL", "FR", "HL", "HR")
"""The legs: front left, front right, hind left, hind right."""
JOINTS = tuple(f"{leg}_{joint}" for leg in LEGS for joint in ("HAA", "HFE", "KFE"))
"""The joints: hip abduction, hip flexion and knee of each leg, in the order of `LEGS`."""


def to_ticks(seconds: float) -> int:
    """The nearest whole number of ticks of 1 ms to a time in seconds."""
    return round(seconds * TICKS_PER_SECOND)


def one_flag_each(answer: object, batch: int, giver: object) -> BoolArray:
    """Return an answer about B robots if it has one flag for each, and refuse any other.

    Whole numbers would pick rows instead of masking them, and a single flag would apply to all
    robots.

    Args:
        answer: What was answered.
        batch: The number of robots B.
        giver: Who answered; an error names its class.

    Returns:
        The answer itself, ``(B,)``.

    Raises:
        ValueError: The answer is not a boolean array ``(B,)``.
    """
    if isinstance(answer, np.ndarray) and answer.dtype == bool and answer.shape == (batch,):
        return answer
    is_array = isinstance(answer, np.ndarray)
    what = f"an array {answer.shape} of {answer.dtype}" if is_array else shown(answer)
    raise ValueError(
        f"{type(giver).__name__} answered with {what}: give a NumPy array ({batch},) of True and "
        "False, one for each robot"
    )


class Command(NamedTuple):
    """A velocity command in the heading frame: vx, vy [m/s] and yaw rate [rad/s]."""

    vx: float = 0.0
    vy: float = 0.0
    yaw_rate: float = 0.0

    @property
    def gait(self) -> int:
        """The number of the gait to walk: 0, the first one, unless this is a `GaitCommand`."""
        return 0


class GaitCommand(Command):
    """A velocity command that also says which of several gaits to walk.

    Its three numbers are those of a `Command`, so code that handles a single gait can use it as
    one. It equals any command with the same velocity and gait.

    Args:
        vx: Speed forward [m/s].
        vy: Speed to the left [m/s].
        yaw_rate: Yaw rate to the left [rad/s].
        gait: The number of the gait.
    """

    _gait: int = 0

    def __new__(
        cls, vx: float = 0.0, vy: float = 0.0, yaw_rate: float = 0.0, gait: int = 0
    ) -> Self:
        """Store the gait in addition to the three numbers."""
        command = super().__new__(cls, vx, vy, yaw_rate)
        command._gait = gait
        return command

    @property
    def gait(self) -> int:
        """The number of the gait to walk."""
        return self._gait

    def _replace(self, **values: float) -> Self:
        """The same command with other numbers, or with another ``gait``."""
        gait = int(values.pop("gait", self._gait))
        command = super()._replace(**values)
        command._gait = gait
        return command

    def __eq__(self, other: object) -> bool:
        """Whether the numbers and the gait are the same; a plain tuple has gait 0."""
        gait = other.gait if isinstance(other, Command) else 0
        return tuple.__eq__(self, other) is True and self._gait == gait

    def __ne__(self, other: object) -> bool:
        """Whether the two differ; the rule of `tuple` would ignore the gait."""
        return not self == other

    def __hash__(self) -> int:
        """Equal for equal commands; with gait 0, the hash of the plain tuple."""
        return hash((*self, self._gait)) if self._gait else tuple.__hash__(self)

    def __repr__(self) -> str:
        """The expression that creates an equal command."""
        return (
            f"GaitCommand(vx={self.vx!r}, vy={self.vy!r}, yaw_rate={self.yaw_rate!r}, "
            f"gait={self._gait!r})"
        )


@dataclass(frozen=True)
class State:
    """The measured state of one robot, or of B robots in lockstep.

    Rotation, heading, roll and pitch are computed once, when they are first needed.

    Attributes:
        q: ``(..., 19)`` configuration [m, unit quaternion, rad].
        v: ``(..., 18)`` velocity [m/s, rad/s], base part in the base frame.
        com: ``(..., 3)`` center of mass, world frame [m].
        feet: ``(..., 4, 3)`` centers of the foot spheres, world frame [m].
        contacts: ``(..., 4)`` True where a foot carries more than 0.5 N.
    """

    q: Array
    v: Array
    com: Array
    feet: Array
    contacts: BoolArray

    def __getitem__(self, index: int | slice | NDArray | tuple[Any, ...]) -> State:
        """The state of one robot of a batch, or of some of its robots or ticks."""
        return State(*(getattr(self, field.name)[index] for field in fields(self)))

    @cached_property
    def rotation(self) -> Array:
        """``(..., 3, 3)`` base frame to world frame."""
        return rotations.rotation(self.q[..., 3:7])

    @cached_property
    def heading(self) -> Array:
        """``(..., 2)`` cos and sin of the yaw."""
        return rotations.heading(self.rotation)

    @cached_property
    def roll_pitch(self) -> Array:
        """``(..., 2)`` roll and pitch [rad]."""
        return rotations.roll_pitch(self.rotation)


def ground_height(state: State, foot_radius: float, before: Array | None = None) -> Array:
    """The height of the ground under robots as their feet feel it ``(...)`` [m].

    It is the mean height of the lowest points of the loaded feet. A height above it depends only
    on the joint angles, the orientation of the base and the contacts, so a robot measures it
    without a map. In flight no foot feels the ground, which is taken to be where it was before.
    If that is not remembered, it is taken to be at the lowest foot, the one that was loaded last
    or will be next. Such a height does not jump when a flight begins or ends, but in between it is
    too high by the clearance of that foot. In a pronk, all feet rise by half a leg length, and a
    plan from there makes the robot fall.

    Args:
        state: States with any leading axes.
        foot_radius: The radius of the foot spheres [m].
        before: ``(...)`` the previous height, for robots in flight [m]; None if not remembered.
    """
    z = state.feet[..., 2]
    loaded = np.where(state.contacts, z, 0.0)
    # Column by column, so that the order of the sum does not depend on the shape.
    total = loaded[..., 0] + loaded[..., 1] + loaded[..., 2] + loaded[..., 3]
    count = np.count_nonzero(state.contacts, axis=-1)
    mean = total / np.maximum(count, 1) - foot_radius
    in_flight = z.min(axis=-1) - foot_radius if before is None else before
    return np.where(count > 0, mean, in_flight)


def lowered(state: State, by: Array) -> State:
    """The same states, with everything moved down.

    Args:
        state: States with any leading axes.
        by: ``(...)`` by how much [m].
    """
    q = state.q.copy()
    com = state.com.copy()
    feet = state.feet.copy()
    q[..., 2] -= by
    com[..., 2] -= by
    feet[..., 2] -= by[..., None]
    return replace(state, q=q, com=com, feet=feet)


@dataclass(frozen=True)
class MotionPlan:
    """A plan as arrays, one row for each tick, row 0 at the tick at which the plan was made.

    A simulated expert holds the last row of a shorter plan. On a robot, where plans arrive late,
    the end of a plan is a fault: give 100 rows or more.

    Attributes:
        joint_position: ``(100, 12)`` reference joint angles [rad].
        joint_velocity: ``(100, 12)`` reference joint rates [rad/s].
        torque: ``(100, 12)`` feed-forward joint torques [N m].
        valid: False if the plan must not be executed (it is not finite, has not converged, or no
            robot could follow it).
    """

    joint_position: Array
    joint_velocity: Array
    torque: Array
    valid: bool = True


def plan_rows(motion: object) -> tuple[Array, bool]:
    """Check what a plan function returned.

    Args:
        motion: What it returned, which should be a `MotionPlan`.

    Returns:
        Joint positions, joint velocities and torques side by side ``(ticks, 36)``, and whether the
        plan is valid.

    Raises:
        ValueError: An array of the plan is not ``(ticks, 12)`` numbers.
        TypeError: It is not a `MotionPlan`, or its ``valid`` is not True or False.
    """
    if not isinstance(motion, MotionPlan):
        raise TypeError(
            f"the plan function returned {type(motion).__name__}, expected a surefoot.MotionPlan: "
            "joint_position, joint_velocity and torque, (ticks, 12) each, and valid"
        )
    if not isinstance(motion.valid, bool | np.bool_):
        raise TypeError(f"the plan's valid is {motion.valid!r}, expected True or False")
    parts = [
        _numbers("joint_position", motion.joint_position),
        _numbers("joint_velocity", motion.joint_velocity),
        _numbers("torque", motion.torque),
    ]
    ticks = len(parts[0]) if parts[0].ndim else 0
    if not ticks or any(part.shape != (ticks, 12) for part in parts):
        shapes = [part.shape for part in parts]
        raise ValueError(
            f"a plan's arrays are {shapes}, expected (ticks, 12) each, with at least one tick"
        )
    return np.concatenate(parts, axis=1, dtype=np.float64), bool(motion.valid)


def _numbers(name: str, values: object) -> NDArray:
    """Return values of a plan as an array, after checking that they are real numbers.

    Raises:
        ValueError: The values are not real numbers, or form no array.
    """
    try:
        array = np.asarray(values)
    except ValueError as error:  # rows of different lengths
        raise ValueError(
            f"the plan's {name} is no array ({error}), expected (ticks, 12)"
        ) from error
    if array.dtype.kind not in "fiu":
        raise ValueError(
            f"the plan's {name} is {array.dtype} {array.shape}, expected (ticks, 12) real numbers"
        )
    return array


PlanFunction = Callable[[State, int, Command], MotionPlan]
"""``plan(state, tick, command) -> MotionPlan`` for one robot: any MPC is such a function."""


class Controller(Protocol):
    """Anything that computes joint torques for B robots: an expert, a policy, or a user's own."""

    def reset(self, batch: int) -> None:
        """Forget everything, and be ready for ``batch`` robots."""
        ...

    def torque(self, state: State, tick: IntArray, command: Array, mask: BoolArray) -> Array:
        """``(B, 12)`` torques for the robots in ``mask`` [N m]; rows outside it are ignored.

        Args:
            state: The states of B robots.
            tick: ``(B,)`` gait clock of each robot [ms].
            command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
            mask: ``(B,)`` True for the robots that this controller drives now.
        """
        ...

    @property
    def diverged(self) -> BoolArray:
        """``(B,)`` True where the controller has given up on a robot."""
        ...
