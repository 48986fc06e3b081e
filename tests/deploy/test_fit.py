"""The posture in which a robot stands before its policy drives."""

from dataclasses import replace

import numpy as np

from surefoot.deploy.faults import Limits
from surefoot.deploy.fit import posture_of
from tests.fakes.bridge_world import ToyPolicy

WIDE = Limits(low=np.full(12, -3.0), high=np.full(12, 3.0), speed=np.ones(12), torque=np.ones(12))
FL_HFE = 1


def test_a_robot_stands_in_the_nominal_posture_as_far_as_the_initial_states_have_it():
    policy = ToyPolicy()
    np.testing.assert_array_equal(posture_of(policy, WIDE), policy.nominal)
    policy.start_range[:, 2 + FL_HFE] = (1.0, 1.4)
    posture = posture_of(policy, WIDE)
    assert 1.0 < posture[FL_HFE] < 1.2
    np.testing.assert_array_equal(np.delete(posture - policy.nominal, FL_HFE), 0.0)


def test_a_robot_stands_within_its_limits_whatever_the_initial_states_are():
    policy = ToyPolicy()
    narrow = replace(WIDE, low=np.full(12, -1.0), high=np.full(12, 0.5))
    np.testing.assert_array_equal(posture_of(policy, narrow), [0.0, 0.5, -1.0] * 4)
