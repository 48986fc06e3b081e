"""The fake simulator of all tests: a `Simulator` of a few lines whose plant is a parameter.

It keeps the clock, the masks and the pushes, and notes what it was asked for; a plant moves the
robots. `Drift` is the default plant, and `tests.fakes.toy` has a linear one. A script may put the
base of a robot to any height from tick to tick, or let the numbers of a robot run away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from surefoot.robots.model import RobotModel, standing
from surefoot.rotations import rotation
from surefoot.sim.protocol import CONTACT_FORCE, checked_variation
from surefoot.types import GRAVITY, Array, BoolArray, IntArray, State
from tests.fakes.robots import ROBOT

NEVER = 10**9
"""[ms] A tick after the end of every episode."""
NOMINAL_FRICTION = 0.5
STEP_HEIGHT = 0.05
"""[m] Height of a foot frame in the air."""

LYING = 0.05
"""[m] The base of a robot that lies on its back is lower."""


class Plant(Protocol):
    """How robots move, in place, in the rows that are to move."""

    def reset(self, q: Array, v: Array, rows: BoolArray) -> None:
        """Begin an episode in these rows."""
        ...

    def step(self, q: Array, v: Array, torque: Array, impulse: Array, rows: BoolArray) -> None:
        """Move these rows by a tick, under joint torques and impulses on the base."""
        ...

    def vary(self, friction: Array, mass: Array, rows: BoolArray) -> None:
        """Give these rows a floor and a base of their own."""
        ...

    def feet_x(self, q: Array, ticks: IntArray) -> Array:
        """The x of the feet, ``(B, 4)`` or what broadcasts to it."""
        ...


class Drift:
    """Joints move with the torque, and the base by a millimeter a tick, each tick 1 m/s faster."""

    def __init__(self, batch: int, robot: RobotModel = ROBOT) -> None:
        self._weight = robot.mass
        self._mass = np.ones(batch)
        self._speed = np.ones(batch)

    def reset(self, q, v, rows):
        """There is nothing to forget."""

    def step(self, q, v, torque, impulse, rows):
        q[rows, 7:] += 1e-3 * torque[rows] / self._mass[rows, None]
        q[rows, 0] += 1e-3 * self._speed[rows]
        v[rows, 0] += 1.0
        to_base = np.swapaxes(rotation(q[rows, 3:7]), 1, 2)
        v[rows, :3] += (to_base * impulse[rows, None]).sum(axis=2) / self._weight

    def vary(self, friction, mass, rows):
        self._speed[rows] = friction[rows] / NOMINAL_FRICTION
        self._mass[rows] = mass[rows]

    def feet_x(self, q, ticks):
        return ticks[:, None]


class FakeSimulator:
    """B robots on a plant, whose feet trot with a period of 200 ms whatever the torques are.

    Args:
        batch: The number of robots B.
        heights: For each robot, (first tick, height of the base [m]) pairs in the order of the
            ticks; a robot without them has the height that the plant gives it.
        lost: For each robot, the tick at which its numbers run away.
        robot: The robot that is simulated.
        plant: How the robots move; `Drift` if None.
        touches: For each robot, (first, end) pairs of ticks in which its body is on the ground; a
            robot that lies on its back is there anyway.

    Attributes:
        ticks: ``(B,)`` ticks since the reset.
        applied: The torques of each step.
        masks: The mask of each step.
        pushes: The (tick, impulse, mask) of each push.
        varied: The (friction, mass) of each variation.
        order: The names of the calls, in their order: reset, vary, contact_force.
    """

    def __init__(
        self,
        batch: int,
        heights: Mapping[int, Sequence[tuple[int, float]]] | None = None,
        lost: Mapping[int, int] | None = None,
        robot: RobotModel = ROBOT,
        plant: Plant | None = None,
        touches: Mapping[int, Sequence[tuple[int, int]]] | None = None,
    ) -> None:
        self.batch = batch
        self.robot = robot
        self.heights = heights or {}
        self.lost = lost or {}
        self.touches = touches or {}
        self.plant = plant or Drift(batch, robot)
        self.q = np.zeros((batch, 19))
        self.v = np.zeros((batch, 18))
        self.ticks = np.zeros(batch, int)
        self._impulse = np.zeros((batch, 3))
        self._bad_numbers = np.zeros(batch, bool)
        self._variation: tuple[Array, Array] | None = None
        self.applied = []
        self.masks = []
        self.pushes = []
        self.varied = []
        self.order = []
        self.reset(np.tile(standing(robot), (batch, 1)), np.zeros((batch, 18)))
        self.order.clear()

    def reset(self, q: Array, v: Array, mask: BoolArray | None = None) -> None:
        self.order.append("reset")
        rows = np.ones(self.batch, bool) if mask is None else mask
        if self._variation is not None:
            self.plant.vary(*self._variation, rows)
        self.q[rows] = q[rows]
        self.v[rows] = v[rows]
        self.ticks[rows] = 0
        self._impulse[rows] = 0.0
        self._bad_numbers[rows] = ~self._finite()[rows]
        self.plant.reset(self.q, self.v, rows)

    def vary(self, friction: Array | None, mass: Array | None) -> None:
        if friction is None and mass is None and self._variation is None:
            return
        self._variation = checked_variation(friction, mass, self.batch, NOMINAL_FRICTION)
        self.order.append("vary")
        self.varied.append(tuple(values.tolist() for values in self._variation))

    def step(self, torque: Array, mask: BoolArray | None = None) -> None:
        self.applied.append(torque.copy())
        self.masks.append(None if mask is None else mask.copy())
        rows = ~self.blown_up if mask is None else mask & ~self.blown_up
        self.plant.step(self.q, self.v, torque, self._impulse, rows)
        self._impulse[rows] = 0.0
        self.ticks[rows] += 1
        self._bad_numbers |= rows & ~self._finite()

    def _finite(self) -> BoolArray:
        return np.all(np.isfinite(self.q), axis=1) & np.all(np.isfinite(self.v), axis=1)

    def push(self, impulse: Array, mask: BoolArray | None = None) -> None:
        mask_copy = None if mask is None else mask.copy()
        self.pushes.append((self.ticks.max(), np.array(impulse), mask_copy))
        rows = np.ones(self.batch, bool) if mask is None else mask
        self._impulse[rows] += np.broadcast_to(impulse, (self.batch, 3))[rows]

    @property
    def state(self) -> State:
        q = self.q.copy()
        for robot, steps in self.heights.items():
            if robot < self.batch:
                past = [height for tick, height in steps if tick <= self.ticks[robot]]
                if past:
                    q[robot, 2] = past[-1]
        contacts = self._contacts()
        feet = np.zeros((self.batch, 4, 3))
        feet[..., 0] = self.plant.feet_x(q, self.ticks)
        feet[..., 2] = np.where(contacts, self.robot.foot_radius, STEP_HEIGHT)
        com = q[:, :3] + [0.0, 0.0, -0.01]
        return State(q, self.v.copy(), com, feet, contacts)

    def _contacts(self) -> BoolArray:
        phase = (self.ticks[:, None] + np.array([0, 100, 100, 0])) % 200
        contacts: BoolArray = phase < 100
        return contacts

    @property
    def blown_up(self) -> BoolArray:
        flags = self._bad_numbers.copy()
        for robot, tick in self.lost.items():
            if robot < self.batch:
                flags[robot] |= self.ticks[robot] >= tick
        return flags

    @property
    def body_contact(self) -> BoolArray:
        on_its_back: BoolArray = rotation(self.q[:, 3:7])[:, 2, 2] < 0.0
        touching = on_its_back & (self.q[:, 2] < LYING)
        for robot, intervals in self.touches.items():
            tick = self.ticks[robot]
            touching[robot] |= any(first <= tick < end for first, end in intervals)
        return touching

    @property
    def contact_force(self) -> Array:
        self.order.append("contact_force")
        carried = self.robot.mass * GRAVITY / 2
        assert carried > CONTACT_FORCE
        return np.where(self._contacts(), carried, 0.0)


class OnTheGround(FakeSimulator):
    """No foot ever leaves the ground."""

    @property
    def state(self) -> State:
        return replace(super().state, contacts=np.ones((self.batch, 4), bool))
