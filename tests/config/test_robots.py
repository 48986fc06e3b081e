"""Ranges of the robot's configuration."""

import pytest

from surefoot.config import RobotConfig


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (RobotConfig, {"torque_limit": 0.0}, "robot.torque_limit is 0.0; use 0.01 to 1000.0"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)
