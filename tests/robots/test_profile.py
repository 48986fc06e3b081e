"""Profiles are found by name or file, clip a robot's torques, and say what lies within them."""

import json
from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config, RobotConfig
from surefoot.config.json_io import from_json, to_json
from surefoot.config.profiles import ODRI
from surefoot.robots.load import load_robot, with_profile
from surefoot.robots.profile import (
    beyond_range,
    beyond_speed,
    load_profile,
    position_limits,
)
from surefoot.robots.scaling import with_own_values
from surefoot.runs.earlier_values import with_values_of

WEAK = replace(ODRI, name="weak", torque_limit=(1.0, 1.0, 1.0))


def profile_file(folder):
    """A file with the profile `WEAK`, and a configuration that names it."""
    file = folder / "prof.json"
    file.write_text(json.dumps(to_json(WEAK)))
    return file, Config(robot=RobotConfig(profile=str(file)))


def test_a_profile_is_found_by_its_name_and_in_files(tmp_path):
    assert load_profile("odri", "solo12") is ODRI
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(to_json(ODRI)))
    assert load_profile(str(file), "solo12") == ODRI
    toml = tmp_path / "mine.toml"
    toml.write_text(
        'name = "mine"\nrobot = "go2"\ntorque_limit = [20.0, 20.0, 30.0]\n'
        "position_limit = [[-1.0, 1.0], [-1.5, 3.4], [-2.7, -0.8]]\nspeed_limit = [30, 30, 20]\n"
    )
    assert load_profile(str(toml), "go2").torque_limit == (20.0, 20.0, 30.0)


@pytest.mark.parametrize(
    ("which", "robot", "text"),
    [
        ("ordi", "solo12", "did you mean .*odri"),
        ("odri", "go2", "belongs to the robot solo12, not to go2"),
        ("nowhere.json", "solo12", "there is no file nowhere.json"),
    ],
)
def test_what_is_no_profile_of_the_robot_is_refused(which, robot, text):
    with pytest.raises(ValueError, match=text):
        load_profile(which, robot)


def test_a_file_with_something_else_names_the_key(tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(to_json(ODRI) | {"torque_limits": 1.0}))
    with pytest.raises(ValueError, match=r"is no hardware profile: .*torque_limits"):
        load_profile(str(file), "solo12")


def test_the_torques_of_a_robot_with_a_profile_are_clipped_to_it_and_its_own():
    robot = load_robot(RobotConfig(profile="odri"))
    assert robot.torque_limit.tolist() == [1.8] * 12
    assert robot.profile == ODRI
    assert load_robot(RobotConfig(profile="odri", torque_limit=1.0)).torque_limit.max() == 1.0
    assert load_robot(RobotConfig()).torque_limit.tolist() == [2.7] * 12


def test_the_profiles_torque_limit_is_not_written_as_the_robots_own():
    config = with_own_values(Config(robot=RobotConfig(profile="odri")))
    assert config.robot.torque_limit is None
    assert with_own_values(Config()).robot.torque_limit == 2.7


def test_what_a_file_holds_is_kept_in_the_configuration(tmp_path):
    """So that a run depends on the file no longer, and a changed file is another robot."""
    file, asked = profile_file(tmp_path)
    run = with_own_values(asked)
    assert (run.robot.profile, run.robot.profile_spec) == ("weak", WEAK)
    assert from_json(Config, to_json(run)) == run
    assert with_own_values(run) == run
    assert with_values_of(asked, run) == run
    file.write_text(json.dumps(to_json(replace(WEAK, torque_limit=(0.2, 0.2, 0.2)))))
    assert with_values_of(asked, run) != run
    file.unlink()
    assert load_robot(run.robot).torque_limit.max() == 1.0
    assert with_values_of(Config(), run) == run
    packaged = with_own_values(Config(robot=RobotConfig(profile="odri"))).robot
    assert (packaged.profile, packaged.profile_spec) == ("odri", None)
    assert load_robot(with_profile(run.robot, "odri")).torque_limit.max() == 1.8


def test_a_profile_that_is_given_as_such_has_its_name():
    for name in (None, "odri"):
        config = with_own_values(Config(robot=RobotConfig(profile=name, profile_spec=WEAK)))
        assert config.robot.profile == "weak"


def test_a_profile_of_another_robot_is_refused_wherever_it_stands():
    with pytest.raises(ValueError, match="belongs to the robot solo12, not to go2"):
        load_robot(RobotConfig("go2", profile_spec=ODRI))


def test_a_profile_of_another_rate_than_the_policies_is_refused(tmp_path):
    slow = replace(ODRI, name="slow", rate=500)
    text = "'slow' takes commands at 500 Hz, but policies and simulations run at 1000 Hz"
    with pytest.raises(ValueError, match=text):
        load_robot(RobotConfig(profile_spec=slow))
    file = tmp_path / "slow.json"
    file.write_text(json.dumps(to_json(slow)))
    with pytest.raises(ValueError, match=text):
        with_profile(RobotConfig(), str(file))


@pytest.mark.parametrize(
    ("ranges", "joint"),
    [
        (((-0.9, 0.9), (-0.5, 0.5), (-2.8, 2.8)), "FL_HFE stands at 0.8 rad"),
        (((-0.9, 0.9), (-1.45, 1.45), (-2.8, 0.0)), "HL_KFE stands at 1.6 rad"),
    ],
)
def test_a_profile_in_which_the_robot_cannot_stand_is_refused(ranges, joint):
    """It would latch while it stands up, before any policy drives."""
    narrow = replace(ODRI, name="narrow", position_limit=ranges)
    with pytest.raises(ValueError, match=joint) as error:
        load_robot(RobotConfig(profile_spec=narrow))
    assert "cannot stand within the hardware profile 'narrow'" in str(error.value)
    assert "give the ranges of all 12 joints" in str(error.value)
    twelve = replace(narrow, position_limit=ODRI.position_limit * 4)
    assert load_robot(RobotConfig(profile_spec=twelve)).profile == twelve


def test_ranges_and_speeds_are_judged_joint_by_joint():
    assert position_limits(ODRI).shape == (12, 2)
    q = np.zeros((25, 19))
    q[1:13, 7:] = np.diag(position_limits(ODRI)[:, 1] + 1e-9)
    q[13:, 7:] = np.diag(position_limits(ODRI)[:, 0] - 1e-9)
    assert beyond_range(position_limits(ODRI), q).tolist() == [False] + [True] * 24
    v = np.zeros((3, 18))
    v[:, 9] = [80.0, 80.1, -80.1]
    v[:, 0] = 100.0  # the base is no joint
    assert beyond_speed(ODRI, v).tolist() == [False, True, True]
