"""A robot's configuration and spec: ranges, names, and what a spec cannot be."""

from dataclasses import replace

import pytest

from surefoot.config import RobotConfig
from surefoot.config.json_io import from_json, to_json
from surefoot.config.robot_table import GO2, ROBOTS
from surefoot.config.robots import RobotSpec


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (RobotConfig, {"torque_limit": 0.0}, "robot.torque_limit is 0.0; use 0.01 to 10000.0"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"name": "../go2"}, r"robot\.spec\.name is '\.\./go2'; use at most 40 letters"),
        ({"name": ""}, "robot.spec.name is ''"),
        ({"legs": ("FL", "FR", "RL", "RL")}, "use four different names"),
        ({"urdf": ""}, "use the path of a URDF"),
        ({"urdf": "a\0b"}, "use the path of a URDF"),
        ({"foot": "FL_foot"}, r"the name 'FL_foot' for all four legs; write \{leg\} in it.*URDF$"),
        ({"position_limit": ((-1.0, 1.0),) * 3}, "has 3 pairs; give one for each of the twelve"),
        ({"position_limit": ((1.0, -1.0),) * 12}, "the first must not exceed the second"),
    ],
)
def test_a_spec_that_describes_no_robot_is_refused(change, text):
    with pytest.raises(ValueError, match=text):
        replace(GO2, **change)


def test_names_in_the_urdf_come_leg_by_leg():
    joints = [*GO2.source_joints]
    assert joints[:4] == ["FL_hip_joint", "FL_thigh_joint", "FL_calf_joint", "FR_hip_joint"]
    assert len(joints) == 12
    assert GO2.source_feet == ("FL_foot", "FR_foot", "RL_foot", "RR_foot")


@pytest.mark.parametrize("spec", ROBOTS.values(), ids=lambda spec: spec.name)
def test_a_spec_survives_json(spec):
    assert from_json(RobotSpec, to_json(spec)) == spec
    config = RobotConfig(spec=spec)
    assert from_json(RobotConfig, to_json(config)) == config
    assert hash(config) == hash(from_json(RobotConfig, to_json(config)))


def test_configurations_of_older_versions_still_open():
    assert from_json(RobotConfig, {"torque_limit": 2.7}) == RobotConfig(torque_limit=2.7)


def test_an_unknown_key_of_a_spec_names_the_nearest():
    values = to_json(GO2)
    values["foot_radios"] = values.pop("foot_radius")
    with pytest.raises(ValueError, match=r"'robot\.spec\.foot_radios'; did you mean .*foot_radius"):
        from_json(RobotConfig, {"spec": values}, "robot")
