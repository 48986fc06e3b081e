"""Layout, known values, and blindness to position and yaw."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from surefoot.config import Config, Gait, OtherGait, PolicyConfig, RobotConfig
from surefoot.config.gait_table import GAITS
from surefoot.learning.layouts import LAYOUTS, Layout
from surefoot.learning.observation import (
    GOAL,
    GOAL_SIZE,
    INPUT_SIZE,
    OBSERVATION,
    OBSERVATION_SIZE,
    GaitTiming,
    ObservationSpec,
    goal,
    network_input,
    observation_spec,
    observe,
    state_spec,
)
from surefoot.types import State
from tests.fakes.learning import OBSERVATION_SPEC, TROT, random_state


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
    np.testing.assert_allclose(o[OBSERVATION["linear_velocity"]], np.arange(3))
    np.testing.assert_allclose(o[OBSERVATION["angular_velocity"]], np.arange(3, 6))
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
    g = goal(tick, command, ObservationSpec("fraction", (TROT,)))
    np.testing.assert_allclose(g[:, GOAL["phase"]], [[0, 0], [0.25, 0], [0.998, 0], [0.25, 0]])
    expected = goal(tick, command, OBSERVATION_SPEC)[:, 2:]
    np.testing.assert_array_equal(g[:, GOAL["command"]], expected)


def test_the_spec_of_a_configuration():
    config = Config(gait=Gait(period=0.4), policy=PolicyConfig(phase="fraction"))
    gait = GaitTiming("custom", 400)
    assert observation_spec(config) == ObservationSpec("fraction", (gait,))
    config = Config(policy=PolicyConfig(layout="full_history", height="above_feet"))
    expected = ObservationSpec("circle", (TROT,), LAYOUTS["full_history"], "above_feet", 0.018)
    assert observation_spec(config) == expected
    assert state_spec(config) == OBSERVATION_SPEC
    own = replace(config, robot=RobotConfig("my_robot.toml"))
    with pytest.raises(ValueError, match=r"of my_robot\.toml nothing is known"):
        observation_spec(own)


def test_a_spec_checks_itself():
    with pytest.raises(ValueError, match=r"no phase 'circel'; did you mean 'circle'"):
        ObservationSpec("circel", (TROT,))  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="period_ticks is 0"):
        GaitTiming("trot", 0)
    with pytest.raises(ValueError, match="0 gaits; use 1 to 16"):
        ObservationSpec("circle", ())
    with pytest.raises(ValueError, match="shares from 0 to 1"):
        GaitTiming("trot", 500, 1.5)
    with pytest.raises(ValueError, match="foot_radius is 3"):
        ObservationSpec("circle", (TROT,), foot_radius=3.0)


def test_sizes_of_the_named_layouts():
    sizes = {}
    for name, layout in LAYOUTS.items():
        sizes[name] = ObservationSpec("circle", (TROT,), layout).input_size
    assert sizes == {"full": 47, "proprioceptive": 253, "full_history": 257}


def test_a_layout_without_height_and_velocity_does_not_see_them():
    state = random_state(4)
    spec = ObservationSpec("circle", (TROT,), Layout("k0", LAYOUTS["proprioceptive"].parts))
    assert spec.input_size == 43
    inputs = network_input(state, np.arange(4), np.zeros((4, 3)), spec)
    whole = network_input(state, np.arange(4), np.zeros((4, 3)), OBSERVATION_SPEC)
    np.testing.assert_array_equal(inputs, np.delete(whole, [0, 4, 5, 6], axis=1))


def test_a_history_is_asked_for_and_given_together():
    state = random_state(2)
    blind = ObservationSpec("circle", (TROT,), LAYOUTS["proprioceptive"])
    history = np.arange(420, dtype=np.float32).reshape(2, 210)
    inputs = network_input(state, np.zeros(2, int), np.ones((2, 3)), blind, history=history)
    np.testing.assert_array_equal(inputs[:, 38:248], history)
    np.testing.assert_array_equal(inputs[:, 248:], [[0, 1, 1, 1, 1]] * 2)
    with pytest.raises(ValueError, match="'proprioceptive' has a history; give it"):
        network_input(state, np.zeros(2, int), np.ones((2, 3)), blind)
    with pytest.raises(ValueError, match="'full' has no history; give none"):
        network_input(state, np.zeros(2, int), np.ones((2, 3)), OBSERVATION_SPEC, history=history)


def test_of_several_gaits_the_goal_names_one_and_has_its_period():
    spec = ObservationSpec("circle", (TROT, GaitTiming("walk", 1000)))
    assert spec.goal_sizes == {"phase": 2, "command": 3, "gait": 2}
    g = goal(np.array([1125, 1125]), np.zeros((2, 3)), spec, gait=np.array([0, 1]))
    half = np.sqrt(0.5)
    np.testing.assert_allclose(g, [[1, 0, 0, 0, 0, 1, 0], [half, half, 0, 0, 0, 0, 1]], atol=1e-6)


def test_the_height_above_the_feet_is_blind_to_the_height_of_the_ground():
    state = upright_state()
    spec = ObservationSpec("circle", (TROT,), height="above_feet", foot_radius=0.02)
    raised = State(
        state.q + np.array([0, 0, 0.3] + [0] * 16),
        state.v,
        state.com + np.array([0, 0, 0.3]),
        state.feet + np.array([0, 0, 0.3]),
        np.array([True, True, True, False]),
    )
    inputs = network_input(raised, 0, np.zeros(3), spec)
    # Three feet are loaded, their undersides 0.02 m below their centers, which are at 0.3 m.
    np.testing.assert_allclose(inputs[0], 0.24 + 0.02, rtol=1e-6)
    np.testing.assert_array_equal(inputs[1:], network_input(state, 0, np.zeros(3), spec)[1:])


@pytest.mark.parametrize("n", [1, 3])
def test_a_state_in_single_precision_is_observed_too(n):
    state = random_state(n)
    single = State(*(getattr(state, field.name).astype(np.float32) for field in fields(State)))
    np.testing.assert_allclose(observe(single), observe(state), rtol=0, atol=1e-5)
    np.testing.assert_allclose(observe(single[0]), observe(state[0]), rtol=0, atol=1e-5)


def test_what_sees_one_gait_alone_refuses_several():
    several = replace(Config(), other_gaits=(OtherGait(GAITS["bound"]),))
    with pytest.raises(ValueError, match=r"see one gait, but the configuration has 2: trot, bound"):
        state_spec(several)
    assert [gait.name for gait in observation_spec(several).gaits] == ["trot", "bound"]
