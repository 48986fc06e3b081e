"""The sensors of a log are compared with each other, and the one that may be wrong is named."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.interop.logs.rates import explain_sensors
from surefoot.interop.logs.simulated import sensor_log_of
from surefoot.rotations import rotation
from surefoot.scenarios.starts import load_starts
from tests.fakes.exports import described, policy_of, smooth_log, walked

LOG = smooth_log(300)
DESCRIPTION = described("full")


@pytest.mark.parametrize(
    ("text", "orientation"),
    [
        ("it is that of the world in the base frame", LOG.orientation * [-1.0, -1.0, -1.0, 1.0]),
        ("w is taken to come first", LOG.orientation[:, [3, 0, 1, 2]]),
        ("x and y are exchanged", LOG.orientation[:, [1, 0, 2, 3]]),
    ],
)
def test_a_wrong_orientation_is_not_blamed_on_the_gyroscope(text, orientation):
    (found,) = explain_sensors(replace(LOG, orientation=orientation), DESCRIPTION)
    assert found.term == "orientation"
    assert text in found.text


@pytest.mark.parametrize("signs", [[-1, -1, -1], [1, -1, 1], [1, 1, -1]])
def test_a_wrong_gyroscope_is_not_blamed_on_the_orientation(signs):
    (found,) = explain_sensors(
        replace(LOG, angular_velocity=LOG.angular_velocity * signs), DESCRIPTION
    )
    assert (found.term, found.kind) == ("angular_velocity", "sign")
    assert "orientation is wrong" not in found.text


@pytest.mark.parametrize("wrong", ["orientation", "angular_velocity"])
def test_what_either_of_two_explains_is_told_as_alternatives(wrong):
    """A base that only rolls turns the same way in its own frame and in the world frame."""
    roll = 0.3 * np.sin(0.011 * np.arange(300))
    base = Rotation.from_rotvec(roll[:, None] * [1.0, 0.0, 0.0])
    gyro = np.column_stack([3.3 * np.cos(0.011 * np.arange(300)), np.zeros((300, 2))])
    log = replace(LOG, orientation=base.as_quat(), angular_velocity=gyro)
    assert explain_sensors(log, DESCRIPTION) == []
    changed = {"orientation": base.inv().as_quat(), "angular_velocity": -gyro}[wrong]
    (found,) = explain_sensors(replace(log, **{wrong: changed}), DESCRIPTION)
    assert "the sign of x differs" in found.text
    assert "or, just as likely, the orientation is wrong" in found.text


def test_a_mirrored_orientation_turns_as_a_mirrored_gyroscope_says():
    (found,) = explain_sensors(
        replace(LOG, orientation=LOG.orientation * [1, -1, -1, 1]), DESCRIPTION
    )
    assert "the sign of y, z differs; or, just as likely, the orientation is wrong" in found.text


def test_of_two_explanations_the_one_of_a_robot_on_its_feet_is_named():
    """With w first, this robot seems to lie on its back, where x and z would be exchanged."""
    wrong = replace(LOG, orientation=LOG.orientation[:, [3, 0, 1, 2]])
    assert np.median(rotation(wrong.orientation)[:, 2, 2]) < 0.0
    (found,) = explain_sensors(wrong, DESCRIPTION)
    assert (found.term, found.kind) == ("orientation", "order")


@pytest.mark.parametrize(
    ("term", "place", "name"),
    [
        ("joint_position", 2, "FL_KFE is"),
        ("joint_velocity", 4, "FR_HFE is"),
        ("angular_velocity", 1, "y is"),
        ("orientation", 0, "it is"),
    ],
)
@pytest.mark.parametrize("row", [100, 1])
def test_a_row_that_is_far_off_is_named_and_decides_nothing_else(term, place, name, row):
    values = getattr(LOG, term).copy()
    values[row, place] += {"joint_position": 17.6, "orientation": 0.2}.get(term, 1e30)
    if term == "orientation":
        values /= np.linalg.norm(values, axis=1, keepdims=True)
    (found,) = explain_sensors(replace(LOG, **{term: values}), DESCRIPTION)
    assert (found.term, found.kind) == (term, "outlier")
    assert name in found.text
    assert f"in row {row}," in found.text


@pytest.fixture(scope="module")
def walk():
    """A second of a robot that walks ahead, by its sensors."""
    starts = load_starts()["nominal"]
    ahead = starts[np.array([starts.command[:, 0].argmax()])]
    log = sensor_log_of(walked(ahead, 1.0), 0, policy_of().spec)
    return replace(log, joint_target=None, network_input=None)


@pytest.mark.parametrize(
    ("kind", "text", "change"),
    [
        ("unknown", "it differs by up to", lambda velocity: 0.0 * velocity),
        ("sign", "the sign of x differs", lambda velocity: velocity * [-1.0, 1.0, 1.0]),
        ("order", "x holds y, y holds x", lambda velocity: velocity[:, [1, 0, 2]]),
        ("scale", "its scale differs", lambda velocity: 1e3 * velocity),
    ],
)
def test_a_linear_velocity_that_the_feet_on_the_ground_contradict_is_named(
    walk, kind, text, change
):
    assert explain_sensors(walk, DESCRIPTION) == []
    wrong = replace(walk, linear_velocity=change(walk.linear_velocity))
    (found,) = explain_sensors(wrong, DESCRIPTION)
    assert (found.term, found.kind) == ("linear_velocity", kind)
    assert text in found.text


def test_feet_that_do_not_stand_say_nothing_of_the_linear_velocity():
    assert explain_sensors(replace(LOG, linear_velocity=np.zeros((300, 3))), DESCRIPTION) == []
