"""Hardware profiles as data: what they may say, and how they are read."""

from dataclasses import replace

import pytest

from surefoot.config.json_io import from_json, to_json
from surefoot.config.profiles import ODRI, PROFILES, HardwareProfile
from surefoot.config.robot_table import ROBOTS


@pytest.mark.parametrize("profile", PROFILES.values(), ids=lambda profile: profile.name)
def test_a_profile_survives_json_and_belongs_to_a_robot_of_the_package(profile):
    assert from_json(HardwareProfile, to_json(profile)) == profile
    assert profile.robot in ROBOTS


def test_solo12_has_the_numbers_of_its_driver():
    assert ODRI.torque_limit == pytest.approx([8 * 0.025 * 9] * 3)
    assert ODRI.position_limit == ((-0.9, 0.9), (-1.45, 1.45), (-2.8, 2.8))
    assert (ODRI.command_timeout, ODRI.rate) == (0.005, 1000)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"position_limit": ((-1.0, 1.0),) * 4}, "has 4 pairs; give one for each"),
        ({"position_limit": ((1.0, -1.0),) * 3}, "the first must not exceed the second"),
        ({"torque_limit": (0.0, 1.0, 1.0)}, "use 0.01 to 10000"),
        (
            {"position_limit": ((-50.0, 50.0), (-83.0, 83.0), (-160.0, 160.0))},
            r"position_limit\[0\]\[0\] is -50.0; use -12.57 to 12.57 rad",
        ),
        ({"command_timeout": 5.0}, "command_timeout is 5.0; use 0.001 to 1.0 s"),
        ({"rate": 0}, "robot.profile_spec.rate is 0; use 1 to"),
        ({"name": ""}, "lacks a name"),
    ],
)
def test_a_profile_that_describes_no_robot_is_refused(change, text):
    with pytest.raises(ValueError, match=text):
        replace(ODRI, **change)
