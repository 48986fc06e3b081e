"""States and torques on which the contracts try their subjects, from a robot's model alone."""

from __future__ import annotations

from dataclasses import fields
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from surefoot.robots.model import RobotModel, standing
from surefoot.robots.rigid import center_of_mass, feet, integrate, legs_of, masses_of
from surefoot.sim.protocol import Simulator
from surefoot.types import Array, IntArray, State

HIGHEST_CONTACT = 1e-3
"""[m] A foot whose sphere is at most this far above the ground counts as a contact here."""


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


def state_of(robot: RobotModel, q: Array, v: Array) -> State:
    """Return the state of B robots with these configurations and velocities.

    Args:
        robot: The robot.
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities.
    """
    legs = legs_of(robot)
    position, _ = feet(q, legs)
    com = center_of_mass(q, legs, masses_of(robot))
    contacts = position[:, :, 2] < robot.foot_radius + HIGHEST_CONTACT
    return State(q, v, com, position, contacts)


def falling_moments(robot: RobotModel, batch: int, ticks: int, seed: int = 0) -> list[Moment]:
    """Return successive ticks of robots that stand at first; every second one then falls over.

    The joints move a little in all of them, each robot has a command of its own, and the gait
    clocks start at different ticks.

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
    fall[::2] *= 0.05  # [rad] in the end
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


def stamping_torque(robot: RobotModel, state: State, tick: int) -> Array:
    """Return torques ``(B, 12)`` [N m] that make each robot stamp in its own way.

    Contacts open, close and slide under this PD law around the standing pose.

    Args:
        robot: The robot, for its pose and torque limit.
        state: The states of B robots.
        tick: Ticks since the robots began [ms].
    """
    batch = len(state.q)
    rng = np.random.default_rng(7)
    phase = rng.uniform(0.0, 2 * np.pi, (64 + batch, 12))[:batch]
    stiffness = robot.torque_limit / 0.9
    restoring = standing(robot)[7:] - state.q[:, 7:]
    wave = np.sin(2 * np.pi * 3.0 * tick / 1000 + phase)
    return (
        stiffness * restoring - stiffness / 60.0 * state.v[:, 6:] + 0.45 * robot.torque_limit * wave
    )


def copy_of(state: State) -> State:
    """Return a state with arrays of its own."""
    return State(*(getattr(state, field.name).copy() for field in fields(State)))


def assert_same_states(actual: State, expected: State, message: str = "") -> None:
    """Assert that two states are equal bit for bit.

    Args:
        actual: The state that is tested.
        expected: What it must be.
        message: What the test says if they differ.
    """
    for field in fields(State):
        np.testing.assert_array_equal(
            getattr(actual, field.name), getattr(expected, field.name), f"{message}: {field.name}"
        )


def with_bad_numbers(state: State, row: int) -> State:
    """Return a copy of a state whose given row holds no numbers, as after a blow-up.

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


def thrown_states(simulator: Simulator) -> tuple[Array, Array]:
    """Return upright robots a little above the ground, each of which moves in its own way."""
    q, v = states_in_the_air(simulator.robot, simulator.batch, seed=8)
    q[:, 2] = 0.04 + standing(simulator.robot)[2]
    q[:, 3:7] = [0.0, 0.0, 0.0, 1.0]
    return q, 0.2 * v


def vary_and_reset(simulator: Simulator, friction: Array, mass: Array) -> None:
    """Vary the robots and let them stand."""
    simulator.vary(friction, mass)
    q = np.tile(standing(simulator.robot), (simulator.batch, 1))
    simulator.reset(q, np.zeros((simulator.batch, 18)))


def record_ticks(simulator: Simulator, ticks: int) -> Array:
    """Let the robots stamp, and return all the bits that a rollout could see."""
    rows = []
    for tick in range(ticks):
        state = simulator.state
        force = simulator.contact_force
        feet = state.feet.reshape(-1, 12)
        rows.append(np.hstack([state.q, state.v, state.com, feet, state.contacts, force]))
        simulator.step(stamping_torque(simulator.robot, state, tick))
    return np.array(rows)


def assert_same_rows(batch: Simulator, singles: list[Simulator]) -> None:
    """Each robot of a batch has the state and the forces of a simulator of its own."""
    state: State = batch.state
    force = batch.contact_force
    for row, single in enumerate(singles):
        assert_same_states(state[row : row + 1], single.state, f"robot {row} alone")
        np.testing.assert_array_equal(force[row], single.contact_force[0])


def momentum(simulator: Simulator) -> Array:
    """Return the linear momentum ``(B, 3)`` of each robot, world frame [N s]."""
    model = simulator.robot.model
    data = model.createData()
    state = simulator.state
    rows = []
    for q, v in zip(state.q, state.v, strict=True):
        pin.computeCentroidalMomentum(model, data, q, v)
        rows.append(data.hg.linear.copy())
    return np.array(rows)
