"""What the simulators' contract drives robots with: torques, throws, variations, recordings."""

import numpy as np
import pytest

from surefoot.testing.driving import (
    assert_same_rows,
    momentum,
    record_ticks,
    stamping_torque,
    thrown_states,
    vary_and_reset,
)
from surefoot.testing.states import state_of, states_in_the_air
from tests.fakes.robots import ROBOT, STANDING
from tests.fakes.simulator import FakeSimulator


def test_stamping_torque_of_a_robot_does_not_depend_on_the_others():
    q, v = states_in_the_air(ROBOT, 4)
    state = state_of(ROBOT, q, v)
    together = stamping_torque(ROBOT, state, 123)
    np.testing.assert_array_equal(stamping_torque(ROBOT, state[:2], 123), together[:2])
    assert len(np.unique(together)) == 48


def test_thrown_robots_are_upright_just_above_the_ground_and_move_apart():
    q, v = thrown_states(FakeSimulator(3))
    np.testing.assert_allclose(q[:, 2], STANDING[2] + 0.04)
    np.testing.assert_array_equal(q[:, 3:7], [[0.0, 0.0, 0.0, 1.0]] * 3)
    assert len(np.unique(v)) == v.size


def test_varied_robots_stand_and_have_their_own_mass():
    simulator = FakeSimulator(2)
    simulator.step(np.ones((2, 12)))
    vary_and_reset(simulator, np.full(2, 0.5), np.array([1.0, 2.0]))
    np.testing.assert_array_equal(simulator.state.q, np.tile(STANDING, (2, 1)))
    simulator.step(np.ones((2, 12)))
    moved = simulator.state.q[:, 7:] - STANDING[7:]
    np.testing.assert_allclose(moved[0], 2.0 * moved[1])


def test_a_recording_holds_the_state_before_each_tick_and_the_forces():
    simulator = FakeSimulator(2)
    rows = record_ticks(simulator, 5)
    assert rows.shape == (5, 2, 60)
    np.testing.assert_array_equal(rows[0, :, :19], np.tile(STANDING, (2, 1)))
    np.testing.assert_allclose(rows[:, 0, 0], STANDING[0] + 1e-3 * np.arange(5))
    np.testing.assert_array_equal(rows[-1, :, 56:], simulator.contact_force)
    assert simulator.ticks.tolist() == [5, 5]


def test_rows_are_the_same_only_where_single_robots_are():
    batch = FakeSimulator(2)
    singles = [FakeSimulator(1), FakeSimulator(1)]
    assert_same_rows(batch, singles)
    singles[1].q[0, 7] += 1e-15
    with pytest.raises(AssertionError, match="robot 1 alone"):
        assert_same_rows(batch, singles)


def test_momentum_is_mass_times_velocity_in_the_world_frame():
    simulator = FakeSimulator(2)
    q = np.tile(STANDING, (2, 1))
    q[1, 3:7] = [0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)]  # heads along y
    v = np.zeros((2, 18))
    v[:, 0] = 0.3
    simulator.reset(q, v)
    expected = ROBOT.mass * np.array([[0.3, 0.0, 0.0], [0.0, 0.3, 0.0]])
    np.testing.assert_allclose(momentum(simulator), expected, atol=1e-12)
