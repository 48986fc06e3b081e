"""How the simulator contract uses a simulator: it drives, varies, records and compares.

The torques make robots stamp, so that contacts open, close and slide; a recording holds every bit
that a rollout could see. Read `testing.simulator` next, which makes its assertions with these
functions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from surefoot.robots.model import RobotModel, standing
from surefoot.sim.protocol import Simulator
from surefoot.testing.states import assert_same_states, copy_of, states_in_the_air
from surefoot.types import Array, State


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
    wave = np.sin(2 * np.pi * 3.0 * tick / 1000 + phase)
    return holding_torque(robot, state) + 0.45 * robot.torque_limit * wave


def holding_torque(robot: RobotModel, state: State) -> Array:
    """Return torques ``(B, 12)`` [N m] of a PD law that holds the standing pose.

    Args:
        robot: The robot, for its pose and torque limit.
        state: The states of B robots.
    """
    stiffness = robot.torque_limit / 0.9
    restoring = standing(robot)[7:] - state.q[:, 7:]
    return stiffness * restoring - stiffness / 60.0 * state.v[:, 6:]


def put_in_the_air(simulator: Simulator) -> Simulator:
    """Reset all robots to rest, 1 m up, the last of them tilted; return the simulator.

    Args:
        simulator: The simulator of B robots.
    """
    q = np.tile(standing(simulator.robot), (simulator.batch, 1))
    q[:, 2] += 1.0
    q[-1, 3:7] = [0.5, -0.5, 0.1, 0.7]
    q[-1, 3:7] /= np.linalg.norm(q[-1, 3:7])
    simulator.reset(q, np.zeros((simulator.batch, 18)))
    return simulator


def thrown_states(simulator: Simulator) -> tuple[Array, Array]:
    """Return q ``(B, 19)`` and v ``(B, 18)`` of upright robots that are thrown onto the ground.

    They begin 4 cm above the ground, and each moves in its own way.

    Args:
        simulator: The simulator, for its robot and the number of robots B.
    """
    q, v = states_in_the_air(simulator.robot, simulator.batch, seed=8)
    q[:, 2] = 0.04 + standing(simulator.robot)[2]
    q[:, 3:7] = [0.0, 0.0, 0.0, 1.0]
    return q, 0.2 * v


def vary_and_reset(simulator: Simulator, friction: Array | None, mass: Array | None) -> None:
    """Vary all robots, then reset them to the standing pose.

    Args:
        simulator: The simulator of B robots.
        friction: ``(B,)`` friction coefficients; None for the simulator's own.
        mass: ``(B,)`` factors on the mass of the base; None for 1.
    """
    simulator.vary(friction, mass)
    q = np.tile(standing(simulator.robot), (simulator.batch, 1))
    simulator.reset(q, np.zeros((simulator.batch, 18)))


def record_ticks(simulator: Simulator, ticks: int) -> Array:
    """Let the robots stamp, and return ``(ticks, B, 60)``, all that a rollout could see of them.

    Args:
        simulator: The simulator, which continues from its present state.
        ticks: The number of ticks to simulate.
    """
    rows = []
    for tick in range(ticks):
        state = simulator.state
        force = simulator.contact_force
        feet = state.feet.reshape(-1, 12)
        rows.append(np.hstack([state.q, state.v, state.com, feet, state.contacts, force]))
        simulator.step(stamping_torque(simulator.robot, state, tick))
    return np.array(rows)


def assert_same_rows(batch: Simulator, singles: Sequence[Simulator]) -> None:
    """Assert that each robot of a batch has the same state and forces as when simulated alone.

    Args:
        batch: The simulator of B robots.
        singles: B simulators of one robot each.
    """
    state = batch.state
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


def assert_blows_up_alone(
    reference: Simulator, simulator: Simulator, torque: float = 0.0, angle: float = 0.0
) -> None:
    """Assert that one of five robots blows up, and disturbs no other.

    Args:
        reference: A simulator of five robots, none of which blows up.
        simulator: Another simulator of five robots, one of which blows up.
        torque: Added to one torque of that robot in tick 50 [N m].
        angle: Added to one joint angle of that robot at the reset [rad].
    """
    bad = 2
    others = np.arange(5) != bad
    robot = simulator.robot
    q = np.tile(standing(robot), (5, 1))
    reference.reset(q, np.zeros((5, 18)))
    q[bad, 8] += angle
    simulator.reset(q, np.zeros((5, 18)))
    blown_up_at = 0 if np.isnan(angle) else 50
    stopped = simulator.state[bad : bad + 1]
    for tick in range(100):
        expected = reference.state
        torques = stamping_torque(robot, expected, tick)
        reference.step(torques)
        torques = torques.copy()
        torques[bad, 3] += torque if tick == 50 else 0.0
        simulator.step(torques)
        assert_same_states(simulator.state[others], reference.state[others], "a neighbor")
        flags = (np.arange(5) == bad) & (tick >= blown_up_at)
        np.testing.assert_array_equal(simulator.blown_up, flags, f"in tick {tick}")
        if tick > blown_up_at:
            assert_same_states(simulator.state[bad : bad + 1], stopped, "a robot that is lost")
        stopped = copy_of(simulator.state[bad : bad + 1])
    standing_again = np.tile(standing(robot), (5, 1))
    simulator.reset(standing_again, np.zeros((5, 18)), simulator.blown_up)
    assert not simulator.blown_up.any(), "a reset ends a blow-up"
    assert np.isfinite(simulator.state.q).all(), "a reset gives numbers again"
