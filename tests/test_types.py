"""States, commands and conversions that every room shares."""

import pickle
from copy import copy
from dataclasses import replace

import numpy as np
import pytest

from surefoot import rotations
from surefoot.types import (
    JOINTS,
    LEGS,
    Command,
    GaitCommand,
    State,
    ground_height,
    lowered,
    to_ticks,
)


def random_state(*shape):
    rng = np.random.default_rng(0)
    q = rng.normal(size=(*shape, 19))
    q[..., 3:7] /= np.linalg.norm(q[..., 3:7], axis=-1, keepdims=True)
    return State(
        q,
        rng.normal(size=(*shape, 18)),
        rng.normal(size=(*shape, 3)),
        rng.normal(size=(*shape, 4, 3)),
        rng.random((*shape, 4)) < 0.5,
    )


@pytest.mark.parametrize(
    "index", [0, -1, slice(1, 3), np.array([2, 0]), (slice(None), 4), (1, slice(0, 2))]
)
def test_an_index_takes_the_same_part_of_every_array(index):
    state = random_state(5, 6)
    part = state[index]
    for name in ("q", "v", "com", "feet", "contacts"):
        np.testing.assert_array_equal(getattr(part, name), getattr(state, name)[index])


def test_what_follows_from_a_state_is_computed_once():
    state = random_state(3)
    np.testing.assert_array_equal(state.rotation, rotations.rotation(state.q[:, 3:7]))
    np.testing.assert_array_equal(state.heading, rotations.heading(state.rotation))
    np.testing.assert_array_equal(state.roll_pitch, rotations.roll_pitch(state.rotation))
    assert state.rotation is state.rotation
    assert state.heading is state.heading
    assert state.roll_pitch is state.roll_pitch
    # A part computes its own: what was computed for the whole is not handed over.
    np.testing.assert_array_equal(state[1].rotation, state.rotation[1])


@pytest.mark.parametrize(
    ("seconds", "ticks"), [(0.0, 0), (0.001, 1), (0.0014, 1), (0.0016, 2), (0.3, 300), (4.35, 4350)]
)
def test_seconds_become_whole_ticks(seconds, ticks):
    assert to_ticks(seconds) == ticks


def test_a_command_stands_still_unless_told_otherwise():
    assert Command() == (0.0, 0.0, 0.0)
    assert Command(yaw_rate=0.5) == (0.0, 0.0, 0.5)


def test_there_are_three_joints_a_leg_in_the_order_of_the_legs():
    assert len(JOINTS) == 12
    for leg, name in enumerate(LEGS):
        joints = JOINTS[3 * leg : 3 * leg + 3]
        assert joints == (f"{name}_HAA", f"{name}_HFE", f"{name}_KFE")


def on_feet(heights, contacts):
    """A state whose foot centers are at these heights; everything else is random."""
    state = random_state(*np.shape(heights)[:-1])
    feet = state.feet.copy()
    feet[..., 2] = heights
    return State(state.q, state.v, state.com, feet, np.array(contacts, dtype=bool))


RADIUS = 0.02


def test_the_ground_is_the_mean_of_the_lowest_points_of_the_loaded_feet():
    state = on_feet([0.05, 0.17, 0.09, 0.30], [True, False, True, False])
    assert ground_height(state, RADIUS) == pytest.approx(0.05)
    everyone = on_feet([0.02, 0.06, 0.02, 0.06], [True] * 4)
    assert ground_height(everyone, RADIUS) == pytest.approx(0.02)


def test_the_ground_of_a_robot_in_flight_is_under_its_lowest_foot():
    state = on_feet([0.12, 0.17, 0.09, 0.30], [False] * 4)
    assert ground_height(state, RADIUS) == pytest.approx(0.07)


def test_the_ground_of_a_robot_in_flight_is_where_it_was_before():
    contacts = [[False] * 4, [False, True, False, False]]
    state = on_feet([[0.12, 0.17, 0.09, 0.30]] * 2, contacts)
    felt = ground_height(state, RADIUS, before=np.array([0.01, 0.02]))
    np.testing.assert_allclose(felt, [0.01, 0.15])


def test_the_ground_does_not_jump_as_the_last_foot_leaves_it_and_as_the_first_one_lands():
    heights = [0.12, 0.17, 0.09, 0.30]
    landed = on_feet(heights, [False, False, True, False])
    flying = on_feet(heights, [False] * 4)
    assert ground_height(landed, RADIUS) == ground_height(flying, RADIUS)


def test_the_ground_has_the_leading_axes_of_the_states():
    state = random_state(5, 6)
    ground = ground_height(state, RADIUS)
    assert ground.shape == (5, 6)
    for row in range(5):
        np.testing.assert_array_equal(ground_height(state[row], RADIUS), ground[row])
    assert ground_height(state[1, 2], RADIUS) == ground[1, 2]


def test_a_foot_in_the_air_whose_numbers_have_run_away_does_not_move_the_ground():
    state = on_feet([0.05, np.inf, 0.09, np.nan], [True, False, True, False])
    assert ground_height(state, RADIUS) == pytest.approx(0.05)


def test_heights_above_the_ground_are_those_of_a_robot_on_level_ground():
    state = random_state(5, 6)
    raised = replace(state, q=state.q.copy(), com=state.com.copy(), feet=state.feet.copy())
    for heights in (raised.q[..., 2], raised.com[..., 2], raised.feet[..., 2]):
        heights += 0.7
    level = lowered(state, ground_height(state, RADIUS))
    above = lowered(raised, ground_height(raised, RADIUS))
    np.testing.assert_allclose(ground_height(level, RADIUS), 0.0, atol=1e-12)
    for name in ("q", "v", "com", "feet", "contacts"):
        np.testing.assert_allclose(getattr(above, name), getattr(level, name), atol=1e-12)
    # What the function was given is as it was.
    np.testing.assert_array_equal(state.q, random_state(5, 6).q)
    np.testing.assert_array_equal(state.feet, random_state(5, 6).feet)


def test_a_command_of_several_gaits_is_its_three_numbers_and_a_gait():
    command = GaitCommand(0.1, 0.2, 0.3, gait=2)
    vx, vy, yaw_rate = command
    assert (vx, vy, yaw_rate) == (0.1, 0.2, 0.3)
    assert command.gait == 2
    assert Command(0.1).gait == GaitCommand(0.1).gait == 0
    assert np.array(command).shape == (3,)
    again = pickle.loads(pickle.dumps(command))
    assert (again, again.gait) == (command, 2)


def test_a_command_keeps_its_gait_whatever_it_is_made_from():
    command = GaitCommand(0.1, 0.2, 0.3, gait=2)
    slower = command._replace(vx=0.0)
    assert (type(slower), tuple(slower), slower.gait) == (GaitCommand, (0.0, 0.2, 0.3), 2)
    assert command._replace(gait=1) == GaitCommand(0.1, 0.2, 0.3, 1)
    assert GaitCommand._make([0.1, 0.2, 0.3]).gait == 0
    assert copy(command).gait == 2
    with pytest.raises((TypeError, ValueError), match="speed"):
        command._replace(speed=1.0)


def test_a_command_of_another_gait_is_another_one():
    command = GaitCommand(0.1, gait=2)
    others = [GaitCommand(0.1, gait=1), GaitCommand(0.2, gait=2), Command(0.1), (0.1, 0.0, 0.0), 3]
    for other in others:
        assert command != other
        assert other != command
        assert not command == other  # noqa: SIM201 (a tuple has its own rule for each)
    same = GaitCommand(0.1, gait=2)
    assert same == command
    assert not same != command  # noqa: SIM202
    # Three bare numbers are a command of the first gait.
    assert len({command, same, *others}) == 5
    first = GaitCommand(0.1, gait=0)
    assert first == Command(0.1) == first
    assert hash(first) == hash(Command(0.1))


def test_a_command_says_its_gait():
    command = GaitCommand(0.1, -0.2, 0.3, 2)
    assert repr(command) == "GaitCommand(vx=0.1, vy=-0.2, yaw_rate=0.3, gait=2)"
    assert eval(repr(command)) == command
