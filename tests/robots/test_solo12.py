"""Solo12: mass, geometry, the order of joints, the nominal pose, and the torque limit."""

from importlib.metadata import PackageNotFoundError

import numpy as np
import pinocchio as pin
import pytest

import surefoot.robots.description
from surefoot.config import RobotConfig
from surefoot.robots.load import load_robot
from surefoot.robots.solo12 import solo12
from surefoot.types import JOINTS, LEGS

ROBOT = solo12()


def placements(q):
    data = ROBOT.model.createData()
    pin.framesForwardKinematics(ROBOT.model, data, q)
    return data


def test_mass():
    assert ROBOT.mass == pytest.approx(2.500, abs=5e-4)
    assert sum(inertia.mass for inertia in ROBOT.model.inertias) == pytest.approx(ROBOT.mass)


def test_joints_come_leg_by_leg_from_hip_to_knee():
    assert tuple(ROBOT.model.names[2:]) == JOINTS
    assert JOINTS[:4] == ("FL_HAA", "FL_HFE", "FL_KFE", "FR_HAA")
    for index, name in enumerate(JOINTS):
        joint = ROBOT.model.joints[ROBOT.model.getJointId(name)]
        assert (joint.idx_q, joint.idx_v) == (7 + index, 6 + index)


def test_axes_of_the_joints():
    # Abduction turns about x, flexion and knee about y, on the left and on the right alike.
    data = placements(pin.neutral(ROBOT.model))
    pin.computeJointJacobians(ROBOT.model, data, pin.neutral(ROBOT.model))
    for index, name in enumerate(JOINTS):
        J = pin.getJointJacobian(ROBOT.model, data, ROBOT.model.getJointId(name), pin.LOCAL)
        axis = [1, 0, 0] if name.endswith("HAA") else [0, 1, 0]
        np.testing.assert_allclose(J[3:, 6 + index], axis, atol=1e-12)


def test_legs_are_16_cm_by_16_cm_and_hips_sit_at_the_corners():
    data = placements(pin.neutral(ROBOT.model))
    for leg, foot, hip in zip(LEGS, ROBOT.feet, ROBOT.hips, strict=True):
        knee = data.oMi[ROBOT.model.getJointId(f"{leg}_KFE")].translation
        upper = knee - data.oMi[hip].translation
        lower = data.oMf[foot].translation - knee
        # In the plane of flexion; across it the links are offset a little.
        assert np.hypot(upper[0], upper[2]) == pytest.approx(0.16, abs=1e-9)
        assert np.hypot(lower[0], lower[2]) == pytest.approx(0.16, abs=1e-9)
        front = 1 if leg[0] == "F" else -1
        left = 1 if leg[1] == "L" else -1
        abduction = data.oMi[ROBOT.model.getJointId(f"{leg}_HAA")].translation
        np.testing.assert_allclose(abduction, [front * 0.1946, left * 0.0875, 0.0], atol=2e-4)
        np.testing.assert_allclose(
            data.oMi[hip].translation, [front * 0.1946, left * 0.1015, 0.0], atol=5e-4
        )


def test_no_hidden_damping_or_armature():
    assert not ROBOT.model.damping.any()
    assert not ROBOT.model.armature.any()


def test_nominal_pose_is_mirror_symmetric_and_bent_outwards():
    legs = ROBOT.nominal[7:].reshape(4, 3)
    np.testing.assert_array_equal(legs[0], legs[1])
    np.testing.assert_array_equal(legs[0], -legs[2])
    np.testing.assert_array_equal(legs[2], legs[3])
    assert legs[0, 1] > 0 > legs[0, 2]
    np.testing.assert_array_equal(ROBOT.nominal[3:7], [0, 0, 0, 1])


def test_limit_comes_from_the_config():
    np.testing.assert_array_equal(
        load_robot(RobotConfig(torque_limit=1.25)).torque_limit, np.full(12, 1.25)
    )
    np.testing.assert_array_equal(ROBOT.torque_limit, np.full(12, 2.7))


def test_missing_description_says_how_to_get_it(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(surefoot.robots.description, "distribution", missing)
    with pytest.raises(ImportError, match="pip install example-robot-data"):
        solo12()
