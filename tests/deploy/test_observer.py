"""The observation of one robot: that of the reference on Pinocchio's feet, rounded once."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from surefoot.config.robot_table import ROBOTS
from surefoot.deploy.interfaces import NO_VALUES, BaseEstimate, Sensors
from surefoot.deploy.observer import attitude, observed
from surefoot.interop.onnx.file import kinematic_table
from surefoot.learning.observation import observe
from surefoot.types import State
from tests.fakes.exports import robot_of

ONE_ULP = 2.0**-23
"""The relative step between two numbers in float32."""


def random_sensors(rng) -> Sensors:
    """What a robot measures that is turned by any yaw, and tilted by up to 70 degrees."""
    angles = rng.uniform((-3.0, -1.2, -1.2), (3.0, 1.2, 1.2))
    return Sensors(
        time_ns=0,
        sequence=0,
        joint_position=rng.uniform(-2.5, 2.5, 12),
        joint_velocity=rng.normal(size=12),
        joint_torque=NO_VALUES,
        orientation=Rotation.from_euler("ZYX", angles).as_quat(),
        angular_velocity=rng.normal(size=3),
        acceleration=np.zeros(3),
        base=BaseEstimate(float(rng.uniform(0.1, 0.4)), rng.normal(size=3)),
    )


def state_by_pinocchio(robot, sensors: Sensors, base: BaseEstimate) -> State:
    """The state of a robot that measures this, at the origin of the world."""
    q = np.concatenate(([0.0, 0.0, base.height], sensors.orientation, sensors.joint_position))
    v = np.concatenate((base.velocity, sensors.angular_velocity, sensors.joint_velocity))
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    feet = np.array([data.oMf[foot].translation for foot in robot.feet])
    com = pin.centerOfMass(robot.model, data, q)
    return State(q, v, com, feet, np.zeros(4, dtype=bool))


@pytest.mark.parametrize("name", ROBOTS)
def test_one_robot_is_observed_as_any_batch_is(name):
    robot = robot_of(name)
    table = kinematic_table(robot)
    rng = np.random.default_rng(0)
    for _ in range(20):
        sensors = random_sensors(rng)
        assert sensors.base is not None
        found = observed(table, sensors, sensors.base)
        expected = observe(state_by_pinocchio(robot, sensors, sensors.base))
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, rtol=ONE_ULP, atol=1e-12)


@pytest.mark.parametrize("pitch", [0.5, -0.5])
def test_a_base_that_points_up_or_down_has_no_heading_and_finite_axes(pitch):
    up, axes = attitude(Rotation.from_euler("y", pitch * np.pi).as_quat())
    np.testing.assert_allclose(up, (-np.sign(pitch), 0.0, 0.0), atol=1e-12)
    assert np.isfinite(axes).all()
    assert np.abs(axes).max() <= 1.0 + 1e-9
