"""States, commands and conversions that every room shares."""

import numpy as np
import pytest

from surefoot import rotations
from surefoot.types import JOINTS, LEGS, Command, State, to_ticks


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
