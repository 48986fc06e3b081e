"""What the package knows of any robot: the order of its joints, standing, the torque limit."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robots.model import RobotModel, clip_torque, standing, stop_speeding
from surefoot.robots.solo12 import solo12

ROBOT = solo12()


def test_standing_touches_the_ground_with_all_four_feet():
    q = standing(ROBOT)
    data = ROBOT.model.createData()
    pin.framesForwardKinematics(ROBOT.model, data, q)
    heights = [data.oMf[foot].translation[2] for foot in ROBOT.feet]
    np.testing.assert_allclose(heights, ROBOT.foot_radius, atol=1e-12)
    np.testing.assert_array_equal(q[7:], ROBOT.nominal[7:])
    assert 0.2 < q[2] < 0.25
    assert ROBOT.nominal[2] == 0.25  # the nominal pose itself is left alone


def test_clip_torque():
    torque = np.array([0.0, 2.69, 2.7, 2.71, -1e9, np.inf, -np.inf, np.nan])
    np.testing.assert_array_equal(
        clip_torque(torque, 2.7), [0.0, 2.69, 2.7, 2.7, -2.7, 2.7, -2.7, 0.0]
    )
    assert np.isnan(torque[-1])  # a new array
    assert clip_torque(np.ones((3, 12)), 0.5).shape == (3, 12)


def test_each_joint_has_a_torque_limit_of_its_own():
    limit = np.arange(1.0, 13.0)
    torque = np.full((2, 12), 6.5) * [[1.0], [-1.0]]
    np.testing.assert_array_equal(
        clip_torque(torque, limit), np.minimum(limit, 6.5) * [[1.0], [-1.0]]
    )


def test_joints_in_another_order_are_refused():
    model = pin.Model(ROBOT.model)
    model.names[2], model.names[3] = model.names[3], model.names[2]
    with pytest.raises(ValueError, match=r"solo12: joints are .*expected"):
        replace(ROBOT, model=model)
    assert isinstance(replace(ROBOT, spec=replace(ROBOT.spec, name="other")), RobotModel)


def test_no_torque_speeds_up_a_joint_beyond_its_limit():
    rate = np.array([2.0, 2.0, -2.0, -2.0, 0.5, 3.0])
    torque = np.array([1.0, -1.0, 1.0, -1.0, 1.0, 1.0])
    limit = np.array([1.0, 1.0, 1.0, 1.0, 1.0, np.inf])
    np.testing.assert_array_equal(
        stop_speeding(torque, rate, limit), [0.0, -1.0, 1.0, 0.0, 1.0, 1.0]
    )
