"""The states that the contracts use: feet and center of mass of q, some robots fall, some stand."""

import numpy as np
import pinocchio as pin

from surefoot.testing.states import (
    falling_moments,
    state_of,
    states_in_the_air,
    with_bad_numbers,
)
from tests.fakes.plans import MODEL
from tests.fakes.robots import ROBOT, STANDING


def test_state_belongs_to_its_configuration():
    q, v = states_in_the_air(ROBOT, 5)
    state = state_of(ROBOT, q, v)
    data = MODEL.createData()
    for row in range(5):
        pin.framesForwardKinematics(MODEL, data, q[row])
        feet = [data.oMf[foot].translation for foot in ROBOT.feet]
        np.testing.assert_allclose(state.feet[row], feet, atol=1e-12)
        com = pin.centerOfMass(MODEL, data, q[row])
        np.testing.assert_allclose(state.com[row], com, atol=1e-12)
    assert not state.contacts.any()
    standing = state_of(ROBOT, STANDING[None], np.zeros((1, 18)))
    assert standing.contacts.all()


def test_every_second_robot_falls_over():
    moments = falling_moments(ROBOT, 6, 50)
    tilt = np.array([np.abs(moment.state.roll_pitch).max(axis=1) for moment in moments])
    assert tilt[0].max() < 0.1
    assert (tilt[-1, ::2] < 0.1).all()
    assert (tilt[-1, 1::2] > 0.5).all()
    ticks = np.array([moment.tick for moment in moments])
    np.testing.assert_array_equal(np.diff(ticks, axis=0), 1)
    assert len(np.unique(moments[0].command[:, 0])) == 6


def test_bad_numbers_are_in_one_row_of_a_copy():
    state = state_of(ROBOT, *states_in_the_air(ROBOT, 3))
    broken = with_bad_numbers(state, 1)
    assert np.isfinite(state.q).all()
    assert np.isnan(broken.q[1]).all()
    np.testing.assert_array_equal(broken.q[[0, 2]], state.q[[0, 2]])
