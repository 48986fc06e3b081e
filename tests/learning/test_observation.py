"""Layout, known values, and blindness to position and yaw."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from surefoot.config import Config, Gait, PolicyConfig
from surefoot.learning.observation import (
    GOAL,
    GOAL_SIZE,
    INPUT_SIZE,
    OBSERVATION,
    OBSERVATION_SIZE,
    ObservationSpec,
    goal,
    network_input,
    observation_spec,
    observe,
)
from surefoot.types import State
from tests.fakes.learning import OBSERVATION_SPEC, random_state


def upright_state(quat=(0, 0, 0, 1)):
    q = np.zeros(19)
    q[:3] = 1.0, 2.0, 0.24
    q[3:7] = quat
    q[7:] = np.arange(12)
    feet = np.array([[1.2, 2.1, 0], [1.2, 1.9, 0], [0.8, 2.1, 0], [0.8, 1.9, 0.03]])
    return State(q, np.arange(18.0), np.array([1.0, 2.0, 0.2]), feet, np.ones(4, bool))


@pytest.mark.parametrize(
    ("layout", "size"), [(OBSERVATION, OBSERVATION_SIZE), (GOAL, GOAL_SIZE)], ids=["obs", "goal"]
)
def test_slices_tile_the_vector(layout, size):
    covered = [index for part in layout.values() for index in range(part.start, part.stop)]
    assert covered == list(range(size))


def test_sizes_of_observation_goal_and_input():
    assert (OBSERVATION_SIZE, GOAL_SIZE, INPUT_SIZE) == (42, 5, 47)


def test_known_values_of_a_level_robot():
    o = observe(upright_state())
    assert o.dtype == np.float32
    assert o.shape == (42,)
    np.testing.assert_allclose(o[OBSERVATION["base_height"]], 0.24, rtol=1e-6)
    np.testing.assert_allclose(o[OBSERVATION["gravity"]], [0, 0, -1])
    np.testing.assert_allclose(o[OBSERVATION["base_velocity"]], np.arange(6))
    np.testing.assert_allclose(o[OBSERVATION["joint_position"]], np.arange(12))
    np.testing.assert_allclose(o[OBSERVATION["joint_velocity"]], np.arange(6, 18))
    feet = [0.2, 0.1, 0.2, -0.1, -0.2, 0.1, -0.2, -0.1]
    np.testing.assert_allclose(o[OBSERVATION["feet"]], feet, atol=1e-7)


@pytest.mark.parametrize(
    ("axis_angle", "gravity"),
    [
        ((np.pi, 0, 0), (0, 0, 1)),
        ((np.pi / 2, 0, 0), (0, -1, 0)),
        ((0, np.pi / 2, 0), (1, 0, 0)),
        ((0, -np.pi / 2, 0), (-1, 0, 0)),
    ],
    ids=["upside down", "on its right side", "nose down", "nose up"],
)
def test_gravity_of_a_fallen_robot(axis_angle, gravity):
    o = observe(upright_state(Rotation.from_rotvec(axis_angle).as_quat()))
    np.testing.assert_allclose(o[OBSERVATION["gravity"]], gravity, atol=1e-7)
    assert np.isfinite(o).all()


@settings(deadline=None)
@given(st.floats(-np.pi, np.pi), st.floats(-50, 50), st.floats(-50, 50), st.integers(0, 1000))
def test_the_observation_is_blind_to_position_and_yaw(yaw, x, y, seed):
    state = random_state(3, seed)
    turn = Rotation.from_euler("z", yaw)
    shift = np.array([x, y, 0.0])
    q = state.q.copy()
    q[:, :3] = turn.apply(q[:, :3]) + shift
    q[:, 3:7] = (turn * Rotation.from_quat(q[:, 3:7])).as_quat()
    feet = turn.apply(state.feet.reshape(-1, 3)).reshape(-1, 4, 3) + shift
    moved = State(q, state.v, turn.apply(state.com) + shift, feet, state.contacts)
    np.testing.assert_allclose(observe(moved), observe(state), rtol=0, atol=3e-6)


@pytest.mark.parametrize("moved", ["height", "roll"])
def test_the_observation_sees_height_and_roll(moved):
    state = upright_state()
    q = state.q.copy()
    if moved == "height":
        q[2] += 0.1
    else:
        q[3:7] = Rotation.from_euler("x", 0.3).as_quat()
    other = State(q, state.v, state.com, state.feet, state.contacts)
    assert np.abs(observe(other) - observe(state)).max() > 0.05


def test_batches_of_any_shape_agree_with_one_robot():
    state = random_state(6)
    tick = np.arange(6)
    command = np.random.default_rng(1).normal(size=(6, 3))
    batch = network_input(state, tick, command, OBSERVATION_SPEC)
    for i in range(6):
        alone = network_input(state[i], tick[i], command[i], OBSERVATION_SPEC)
        np.testing.assert_array_equal(alone, batch[i])
    names = ("q", "v", "com", "feet", "contacts")
    arrays = [getattr(state, name) for name in names]
    grid = State(*(a.reshape(2, 3, *a.shape[1:]) for a in arrays))
    gridded = network_input(grid, tick.reshape(2, 3), command.reshape(2, 3, 3), OBSERVATION_SPEC)
    np.testing.assert_array_equal(gridded.reshape(6, -1), batch)
    np.testing.assert_array_equal(batch[:, :42], observe(state))
    np.testing.assert_array_equal(batch[:, 42:], goal(tick, command, OBSERVATION_SPEC))


def test_the_goal_is_periodic_and_holds_phase_and_command():
    g = goal(np.array([0, 125, 250, 500_000_125]), np.array([0.3, -0.1, 0.2]), OBSERVATION_SPEC)
    assert g.shape == (4, 5)
    np.testing.assert_allclose(g[:, GOAL["phase"]], [[0, 1], [1, 0], [0, -1], [1, 0]], atol=1e-6)
    np.testing.assert_array_equal(g[3], g[1])
    np.testing.assert_allclose(g[:, GOAL["command"]], np.tile([0.3, -0.1, 0.2], (4, 1)), rtol=1e-6)


def test_the_phase_as_a_fraction_of_the_period():
    tick = np.array([0, 125, 499, 500_000_125])
    command = np.array([0.3, -0.1, 0.2])
    g = goal(tick, command, ObservationSpec("fraction", 500))
    np.testing.assert_allclose(g[:, GOAL["phase"]], [[0, 0], [0.25, 0], [0.998, 0], [0.25, 0]])
    expected = goal(tick, command, OBSERVATION_SPEC)[:, 2:]
    np.testing.assert_array_equal(g[:, GOAL["command"]], expected)


def test_the_spec_of_a_configuration():
    config = Config(gait=Gait(period=0.4), policy=PolicyConfig(phase="fraction"))
    assert observation_spec(config) == ObservationSpec("fraction", 400)


def test_a_spec_checks_itself():
    with pytest.raises(ValueError, match=r"no phase 'circel'; did you mean 'circle'"):
        ObservationSpec("circel", 500)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="period_ticks is 0"):
        ObservationSpec("circle", 0)


@pytest.mark.parametrize("n", [1, 3])
def test_a_state_in_single_precision_is_observed_too(n):
    state = random_state(n)
    single = State(*(getattr(state, field.name).astype(np.float32) for field in fields(State)))
    np.testing.assert_allclose(observe(single), observe(state), rtol=0, atol=1e-5)
    np.testing.assert_allclose(observe(single[0]), observe(state[0]), rtol=0, atol=1e-5)
