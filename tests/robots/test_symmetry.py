"""The mirrors of a robot follow from its description, and robots without one are refused."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robots.solo12 import solo12
from surefoot.robots.symmetry import body_mirror

ROBOT = solo12()


def test_left_and_right_exchange_and_abduction_turns_the_other_way():
    mirror = body_mirror(ROBOT, "left_right")
    assert mirror.reflection == (1, -1, 1)
    assert mirror.legs == (1, 0, 3, 2)
    assert mirror.joints == (3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8)
    assert mirror.signs == (-1, 1, 1) * 4


def test_front_and_hind_exchange_and_legs_bend_the_other_way():
    mirror = body_mirror(ROBOT, "front_hind")
    assert mirror.reflection == (-1, 1, 1)
    assert mirror.legs == (2, 3, 0, 1)
    assert mirror.joints == (6, 7, 8, 9, 10, 11, 0, 1, 2, 3, 4, 5)
    assert mirror.signs == (1, -1, -1) * 4


@pytest.mark.parametrize("name", ["left_right", "front_hind"])
def test_pinocchio_finds_feet_and_center_of_mass_where_the_mirror_does(name):
    mirror = body_mirror(ROBOT, name)
    D = np.array(mirror.reflection, float)
    data = ROBOT.model.createData()
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = pin.integrate(ROBOT.model, ROBOT.nominal, rng.normal(0.0, 0.5, 18))
        image = q.copy()
        image[:3] *= D
        image[3:6] *= D * D.prod()
        image[7:] = q[7:][list(mirror.joints)] * mirror.signs
        pin.framesForwardKinematics(ROBOT.model, data, q)
        feet = np.array([data.oMf[foot].translation for foot in ROBOT.feet])
        com = pin.centerOfMass(ROBOT.model, data, q).copy()
        pin.framesForwardKinematics(ROBOT.model, data, image)
        mirrored = np.array([data.oMf[foot].translation for foot in ROBOT.feet])
        np.testing.assert_allclose(mirrored, feet[list(mirror.legs)] * D, atol=1e-12)
        com_of_image = pin.centerOfMass(ROBOT.model, data, image)
        np.testing.assert_allclose(com_of_image, com * D, atol=1e-5)


def test_legs_that_all_bend_the_same_way_have_no_front_hind_mirror():
    nominal = ROBOT.nominal.copy()
    nominal[13:] = nominal[7:13]
    robot = replace(ROBOT, nominal=nominal)
    assert body_mirror(robot, "left_right") == body_mirror(ROBOT, "left_right")
    with pytest.raises(ValueError, match=r"solo12 .*front_hind.*bends the legs differently.*none"):
        body_mirror(robot, "front_hind")


def test_an_arm_on_one_side_is_refused():
    model = ROBOT.model.copy()
    arm = pin.Inertia.FromSphere(0.5, 0.02)
    model.appendBodyToJoint(1, arm, pin.SE3(np.eye(3), np.array([0.1, 0.1, 0.0])))
    with pytest.raises(ValueError, match=r"left_right.*center of mass differ by .* mm"):
        body_mirror(replace(ROBOT, model=model), "left_right")


def test_a_leg_that_is_longer_on_one_side_is_refused():
    model = ROBOT.model.copy()
    foot = model.frames[model.getFrameId("FL_FOOT")]
    foot.placement = foot.placement * pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.01]))
    with pytest.raises(ValueError, match=r"feet or center of mass differ by 10\.0 mm"):
        body_mirror(replace(ROBOT, model=model), "left_right")
