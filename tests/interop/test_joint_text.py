"""Values of joints in words: one number only where all joints have it."""

from dataclasses import replace

import pytest

from surefoot.deploy.export_file import read_export
from surefoot.interop.joint_text import each_joint, limits_in_words
from tests.fakes.exports import exported


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ([2.7] * 12, "2.7 N m"),
        ([1.0, 2.0, 3.0] * 4, "1, 2, 3 N m for the joints of a leg"),
        ([1.0, 1.0, None] * 4, "1, 1, any N m for the joints of a leg"),
        (
            [1.0, 2.0, 3.0] * 2 + [4.0, 5.0, 6.0] * 2,
            "1, 2, 3 (FL FR); 4, 5, 6 (HL HR) N m for the joints of a leg",
        ),
    ],
)
def test_values_of_joints_are_short_and_complete(values, text):
    assert each_joint(values, "N m") == text


def test_limits_that_a_robot_does_not_have_are_told_too(tmp_path):
    description = read_export(exported(tmp_path)[0]).description
    without = replace(description, speed_limit=(None,) * 12, position_limit=((None, None),) * 12)
    assert limits_in_words(without) == (
        "torque at most 2.7 N m",
        "speed without a limit",
        "angles without a limit",
    )
    some = replace(description, position_limit=((-1.0, 0.5), (None, None), (None, 2.8)) * 4)
    angles = "angles -1 to 0.5, any, any to 2.8 rad for the joints of a leg"
    assert limits_in_words(some)[2] == angles
