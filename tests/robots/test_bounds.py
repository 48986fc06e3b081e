"""Bounds on how a robot stands: falls and the joints of the table, for all who ask."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import TABLE_I, SafetyConfig
from surefoot.robots.bounds import fallen, joint_rows, table_bounds
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from tests.fakes.states import turned_robot

Q = standing(solo12())


def test_a_robot_whose_height_is_not_a_number_has_fallen():
    q = np.array([Q, Q])
    q[1, 2] = np.nan
    assert fallen(q, TABLE_I).tolist() == [False, True]


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_falls_by_angle(axis):
    for yaw in (0, 130):
        q = np.array([turned_robot(**{axis: x}, yaw=yaw) for x in (-30.1, -29.9, 29.9, 30.1, 180)])
        np.testing.assert_array_equal(fallen(q, TABLE_I), [True, False, False, True, True])


def test_falls_by_height():
    q = np.array([turned_robot(z=z) for z in (0.099, 0.101, 1.999, 2.001)])
    np.testing.assert_array_equal(fallen(q, TABLE_I), [True, False, False, True])


def test_three_ranges_are_those_of_a_left_front_leg_and_mirrored_for_the_others():
    rows = joint_rows(TABLE_I)
    assert rows[:3] == ((-30, 60), (0, 90), (-160, 0))
    assert rows[3:6] == ((-60, 30), (0, 90), (-160, 0))
    assert rows[9:] == ((-60, 30), (-90, 0), (0, 160))
    own = tuple((float(n), float(n + 1)) for n in range(12))
    assert joint_rows(replace(TABLE_I, joints=own)) == own


def test_bounds_that_are_nobodys_yet_are_an_error_that_says_what_to_do():
    with pytest.raises(ValueError, match=r"safety\.roll_pitch is None, .* `sf.with_own_values`"):
        table_bounds(SafetyConfig())
    with pytest.raises(ValueError, match=r"safety\.fall_height is None"):
        fallen(Q[None], SafetyConfig())
