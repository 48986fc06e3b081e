"""Feet and center of mass from an exported table: Pinocchio's, for every robot of the package."""

import json
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config.json_io import from_json, to_json
from surefoot.config.robot_table import ROBOTS
from surefoot.deploy.kinematics import KinematicTable, com_in_base, feet_and_com
from surefoot.interop.onnx.file import kinematic_table
from tests.fakes.exports import robot_of


def by_pinocchio(robot, q):
    """Feet ``(4, 3)`` and center of mass ``(3,)`` in the world frame."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    feet = np.array([data.oMf[foot].translation for foot in robot.feet])
    return feet, pin.centerOfMass(robot.model, data, q)


@pytest.mark.parametrize("name", ROBOTS)
def test_feet_and_center_of_mass_are_pinocchios(name):
    robot = robot_of(name)
    table = kinematic_table(robot)
    rng = np.random.default_rng(0)
    joints = rng.uniform(-2.5, 2.5, (20, 12))
    feet, com = feet_and_com(table, joints)
    np.testing.assert_array_equal(com_in_base(table, joints), com)
    for row in range(20):
        still = np.concatenate([np.zeros(3), [0.0, 0.0, 0.0, 1.0], joints[row]])
        expected_feet, expected_com = by_pinocchio(robot, still)
        np.testing.assert_allclose(feet[row], expected_feet, atol=1e-12)
        np.testing.assert_allclose(com[row], expected_com, atol=1e-12)


def test_one_robot_and_a_batch_are_the_same():
    table = kinematic_table(robot_of())
    joints = np.random.default_rng(1).normal(size=(3, 2, 12))
    for batch, one in zip(
        feet_and_com(table, joints), feet_and_com(table, joints[2, 1]), strict=True
    ):
        np.testing.assert_array_equal(batch[2, 1], one)


def test_a_table_survives_json_to_the_last_bit():
    table = kinematic_table(robot_of("go2"))
    assert from_json(KinematicTable, json.loads(json.dumps(to_json(table)))) == table


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"base_mass": -1.0}, "masses must be positive"),
        ({"foot_positions": ((0.0, 0.0, 0.0),) * 3}, r"foot_positions must be \(4, 3\)"),
        ({"base_com": (0.0, 0.0, np.nan)}, "base_com must be"),
        ({"joint_axes": (((0.0, 0.0, 2.0),) * 3,) * 4}, "must have length 1"),
    ],
)
def test_a_table_of_no_robot_is_refused(change, text):
    with pytest.raises(ValueError, match=text):
        replace(kinematic_table(robot_of()), **change)
