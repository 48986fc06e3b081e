"""What a page shows of one moment of one robot, simulated live or recorded.

`live` and `playback` make a `Snapshot`; `browser_scene` and `browser_panels` show it, and do not
depend on where it came from. Read `live` next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.robots.model import RobotModel, standing
from surefoot.robots.rigid import center_of_mass, feet, legs_of, masses_of
from surefoot.rotations import from_heading, heading_velocity
from surefoot.safety.gates import distances
from surefoot.types import TICKS_PER_SECOND, Array, Command, IntArray, State

SAMPLE_TICKS = 20
"""[ms] Time between two rows of a trace."""
TRACE_SECONDS = 10.0
"""[s] How much of the past a trace holds."""
MEAN_SECONDS = 0.5
"""[s] The velocity that is shown is a mean over this time, a period of the trot."""
PUSH_SHOWN = 600
"""[ms] Time for which a push is shown; it lasts 10 ms."""
LEAST_MARGIN = 1e-3
"""[m, rad] A quantity that is nearer to its bound in the nominal pose counts as this far away."""


@dataclass(frozen=True)
class ShownPlan:
    """What is drawn of one plan of the expert, in the world frame.

    Attributes:
        tick: Gait clock at which the plan was made [ms].
        com: ``(N + 1, 3)`` planned center of mass [m].
        footholds: ``(k, 3)`` where feet are planned to stand [m].
        legs: ``(k,)`` the leg of each foothold, an index into `LEGS`.
    """

    tick: int
    com: Array
    footholds: Array
    legs: IntArray


@dataclass(frozen=True)
class Margin:
    """How far a quantity is from the nearer bound of the safety table.

    Attributes:
        name: Name of the quantity.
        share: Its distance as a fraction of that in the nominal pose: 1 there, 0 at the bound, and
            negative outside. For joints, the smallest fraction among the four legs.
    """

    name: str
    share: float


@dataclass(frozen=True)
class Snapshot:
    """One moment of one robot.

    Attributes:
        seconds: Time since the start [s].
        state: The true state of one robot, with heights above the ground that it feels.
        command: The velocity that is commanded.
        velocity: Mean velocity over the last 0.5 s: vx, vy [m/s] in the heading frame, and yaw rate
            [rad/s].
        expert_drives: True if the expert drives.
        margins: How far the robot is from the bounds of the safety table.
        force: ``(4,)`` normal force on each foot [N]; None where it was not recorded.
        plan: The expert's last plan, if it is still followed.
        push: ``(3,)`` impulse of a push in the last 0.6 s, world frame [N s]; None if there is
            none.
        ended: Why the episode is over, in words; empty until then.
        damped: True once nobody drives and the joints are damped.
        gait: The number of the gait that is walked.
        asked_gait: The number of the gait that was asked for, which begins soon if it differs.
    """

    seconds: float
    state: State
    command: Command
    velocity: tuple[float, float, float]
    expert_drives: bool
    margins: tuple[Margin, ...]
    force: Array | None = None
    plan: ShownPlan | None = None
    push: Array | None = None
    ended: str = ""
    damped: bool = False
    gait: int = 0
    asked_gait: int = 0


class Source(Protocol):
    """Something that a page shows while its time passes: a simulation, or a recording."""

    @property
    def robot(self) -> RobotModel:
        """The robot that is shown."""
        ...

    @property
    def over(self) -> bool:
        """Whether no more time can pass."""
        ...

    @property
    def trace(self) -> Array:
        """``(n, 7)`` the last 10 s, with rows as `trace_rows` gives them."""
        ...

    def step(self, ticks: int) -> None:
        """Let time pass [ms]."""
        ...

    def snapshot(self) -> Snapshot:
        """The present moment."""
        ...


class MarginMeter:
    """Measures how far a robot is from the bounds of the safety table.

    Args:
        robot: The robot.
        safety: The table, with the robot's own values in place of None.
    """

    def __init__(self, robot: RobotModel, safety: SafetyConfig) -> None:
        self._safety = safety
        q = standing(robot)[None]
        legs = legs_of(robot)
        state = State(
            q=q,
            v=np.zeros((1, 18)),
            com=center_of_mass(q, legs, masses_of(robot)),
            feet=feet(q, legs)[0],
            contacts=np.ones((1, 4), dtype=bool),
        )
        self._nominal = np.maximum(distances(state, safety)[0], LEAST_MARGIN)

    def __call__(self, state: State) -> tuple[Margin, ...]:
        """Return the margins of one robot.

        Args:
            state: The state of one robot, without a batch axis.
        """
        share = distances(state[(np.newaxis,)], self._safety)[0] / self._nominal
        joints = share[3:].reshape(4, 3).min(axis=0)
        names = ("height", "roll", "pitch", "hip abduction", "hip flexion", "knee")
        values = [*share[:3].tolist(), *joints.tolist()]
        return tuple(Margin(name, value) for name, value in zip(names, values, strict=True))


def trace_rows(state: State, tick: Array | IntArray) -> Array:
    """Rows of a trace ``(n, 7)``, one for each of n states of one robot.

    Each holds the time [s], roll and pitch [rad], the height of the center of mass [m], and vx, vy
    [m/s] and yaw rate [rad/s] in the heading frame.

    Args:
        state: ``(n, ...)`` states.
        tick: ``(n,)`` time of each since the start [ms].
    """
    return np.column_stack(
        [
            np.asarray(tick) / TICKS_PER_SECOND,
            state.roll_pitch,
            state.com[:, 2],
            heading_velocity(state.rotation, state.v),
        ]
    )


def mean_velocity(trace: Array) -> tuple[float, float, float]:
    """The mean vx, vy and yaw rate over the last 0.5 s of a trace; zeros if the trace is empty."""
    rows = trace[-round(MEAN_SECONDS * TICKS_PER_SECOND / SAMPLE_TICKS) :, 4:]
    vx, vy, yaw_rate = rows.mean(axis=0).tolist() if len(rows) else (0.0, 0.0, 0.0)
    return vx, vy, yaw_rate


def to_world(points: Array, state: State) -> Array:
    """Points ``(..., 3)`` of the planning frame, below the base along its heading, in the world.

    Args:
        points: ``(..., 3)`` points in the planning frame [m].
        state: The state of one robot, from which the plan was made.
    """
    world = np.array(points, dtype=float)
    world[..., :2] = from_heading(world[..., :2], state.heading) + state.q[:2]
    return world
