"""States to test with, made from a robot's model alone, and a comparison of states bit for bit.

Every contract uses them: robots that stand, fall or fly, and robots that have blown up. Read
`testing.driving` next for how the simulator contract uses a simulator.
"""

from __future__ import annotations

from dataclasses import fields
from typing import NamedTuple

import numpy as np

from surefoot.robots.canonical import BASE
from surefoot.robots.geometry import state_of
from surefoot.robots.model import RobotModel, standing
from surefoot.robots.rigid import integrate
from surefoot.types import Array, IntArray, State


class Moment(NamedTuple):
    """What B robots see in one tick.

    Attributes:
        state: The states of B robots.
        tick: ``(B,)`` gait clock of each robot [ms].
        command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
    """

    state: State
    tick: IntArray
    command: Array


def falling_moments(robot: RobotModel, batch: int, ticks: int, seed: int = 0) -> list[Moment]:
    """Return successive ticks of robots that stand at first; every second one then falls over.

    The joints of every robot move a little, each robot has its own command, and the gait clocks
    start at different ticks.

    Args:
        robot: The robot.
        batch: The number of robots B.
        ticks: The number of moments.
        seed: Seed of the randomness.
    """
    rng = np.random.default_rng(seed)
    upright = standing(robot)
    direction = rng.normal(size=(batch, 2))
    fall = np.zeros((batch, 18))
    fall[:, 3:5] = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    fall[::2] *= 0.05  # [rad] at the end
    start = rng.integers(0, 500, batch)
    command = rng.uniform(-0.2, 0.2, (batch, 3))
    moments = []
    for elapsed in range(ticks):
        displacement = fall * (elapsed + 1) / ticks
        displacement[:, 6:] = rng.normal(0.0, 0.02, (batch, 12))
        q = np.array([integrate(upright, row) for row in displacement])
        v = rng.normal(0.0, 0.1, (batch, 18))
        moments.append(Moment(state_of(robot, q, v), start + elapsed, command.copy()))
    return moments


def states_in_the_air(robot: RobotModel, batch: int, seed: int = 0) -> tuple[Array, Array]:
    """Return configurations ``(B, 19)`` and velocities ``(B, 18)`` in any attitude, 2 m up.

    Args:
        robot: The robot.
        batch: The number of robots B.
        seed: Seed of the randomness.
    """
    rng = np.random.default_rng(seed)
    q = np.tile(standing(robot), (batch, 1))
    q[:, :3] += rng.normal(0.0, 0.3, (batch, 3))
    q[:, 2] += 2.0
    quaternion = rng.normal(size=(batch, 4))
    q[:, 3:7] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    q[:, 7:] += rng.uniform(-1.0, 1.0, (batch, 12))
    return q, rng.normal(0.0, 1.0, (batch, 18))


def lying_on_its_back(robot: RobotModel) -> Array:
    """Return the configuration ``(19,)`` of a robot upside down, its base 0.1 mm in the ground.

    Args:
        robot: The robot, for its pose and the shapes of its base.
    """
    tops = []
    for shape in robot.shapes:
        if shape.link == BASE:
            half_height = shape.size[2] if len(shape.size) == 3 else shape.size[0]
            tops.append(max(shape.start[2], shape.end[2]) + half_height)
    q = standing(robot)
    q[2] = max(tops) - 1e-4
    q[3:7] = [1.0, 0.0, 0.0, 0.0]
    return q


def copy_of(state: State) -> State:
    """Return a state with arrays of its own."""
    return State(*(getattr(state, field.name).copy() for field in fields(State)))


def assert_same_states(actual: State, expected: State, message: str = "") -> None:
    """Assert that two states are equal bit for bit.

    Args:
        actual: The state that is tested.
        expected: What it must be.
        message: How the failure begins if they differ.
    """
    for field in fields(State):
        np.testing.assert_array_equal(
            getattr(actual, field.name), getattr(expected, field.name), f"{message}: {field.name}"
        )


def with_bad_numbers(state: State, row: int) -> State:
    """Return a copy of a state in which all numbers of one robot are NaN, as after a blow-up.

    Args:
        state: The states of B robots.
        row: The robot that has blown up.
    """
    copy = copy_of(state)
    copy.q[row] = np.nan
    copy.v[row] = np.nan
    copy.com[row] = np.nan
    copy.feet[row] = np.nan
    return copy
