"""The command robot, and the option --robot."""

import json

import pytest
from PIL import Image

from surefoot.cli import robot as module
from surefoot.cli.options import OnRobot
from surefoot.config import Config
from surefoot.config.json_io import to_json
from surefoot.config.robot_table import GO2, SOLO12
from surefoot.robots.scaling import with_own_values


def test_it_prints_the_table_and_writes_json(surefoot, capsys, tmp_path):
    file = tmp_path / "go2.json"
    assert surefoot("robot", "go2", "--json", file) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("go2: 16.085 kg")
    assert "FL_KFE  FL_calf_joint           -1.440   -2.72   -0.84    45.43    15.70" in printed
    assert "kp 27.61 N m/rad" in printed
    assert "- The description's feet are a mesh" in printed
    report = json.loads(file.read_text())
    assert report["size"]["mass_ratio"] == pytest.approx(6.434, abs=1e-3)
    assert len(report["joints"]) == 12


def test_it_draws_the_robot(surefoot, capsys, tmp_path, monkeypatch):
    file = tmp_path / "solo12.png"
    assert surefoot("robot", "solo12", "--image", file) == 0
    with Image.open(file) as picture:
        assert picture.size == (960, 640)
        assert len(picture.getcolors(maxcolors=2**24) or []) > 200
    assert f"picture: {file}" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"urdf": "solo_description/robots/solo.urdf"}, "8 joints; 12 are needed"),
        ({"urdf": "nothing.urdf"}, "there is no description"),
        ({"foot": "{leg}_foot"}, "no frame 'FL_foot'; did you mean 'FL_FOOT'"),
        ({"torque_limit": None}, "not every joint has a torque limit"),
        ({"foot_radius": -1}, "foot_radius is -1.0; use 0.001 to 1.0"),
    ],
)
def test_a_bad_description_is_said_without_a_traceback(surefoot, capsys, tmp_path, content, text):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(to_json(SOLO12) | {"name": "mine"} | content))
    assert surefoot("robot", file) == 2
    captured = capsys.readouterr()
    assert text in captured.err
    assert "Traceback" not in captured.err
    assert captured.err.startswith("surefoot: ")


def test_an_unknown_robot_names_the_nearest(surefoot, capsys):
    assert surefoot("robot", "anymalc") == 2
    assert "did you mean 'anymal_c'" in capsys.readouterr().err


def test_outputs_do_not_replace_the_spec(surefoot, capsys, tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(to_json(GO2)))
    assert surefoot("robot", file, "--json", file) == 2
    assert json.loads(file.read_text())["name"] == "go2"


def test_lines_say_that_nothing_is_odd():
    from dataclasses import replace

    from surefoot.config import RobotConfig
    from surefoot.robots.examine import examine_robot

    report = replace(examine_robot(RobotConfig("go2")), remarks=())
    assert module.lines_of(report)[-1] == "nothing is missing or odd"


# --- --robot


def test_the_option_puts_the_robot_and_its_own_values_in(tmp_path):
    config = OnRobot(robot="go2").with_robot(Config())
    assert config.robot.model == "go2"
    assert with_own_values(config).expert.kp == pytest.approx(27.6, rel=0.01)
    assert OnRobot().with_robot(Config()) == Config()
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(to_json(GO2) | {"name": "mine"}))
    own = with_own_values(OnRobot(robot=str(file)).with_robot(config))
    assert own.robot.spec is not None and own.robot.spec.name == "mine"


def test_another_robot_walks(surefoot, capsys, tmp_path):
    file = tmp_path / "walk.json"
    args = ("--vx", 0.3, "--seconds", 2, "--no-video", "--json", file)
    assert surefoot("walk", "--robot", "go2", *args) == 0
    report = json.loads(file.read_text())
    assert report["outcome"] == "SUCCESS"
    assert report["mean_velocity"][0] == pytest.approx(0.3, abs=0.06)
    assert 0.0 < report["torque_used"] < 0.6
    assert report["speed_used"] > 0.0


def test_joints_beyond_their_limits_are_reported_and_named(surefoot, capsys, tmp_path):
    """Success alone would hide a wrong sign in the spec."""
    file = tmp_path / "mine.json"
    wrong = {"name": "mine", "position_limit": [(-1.0, 1.0), (-3.5, 4.5), (0.8, 2.7)] * 4}
    file.write_text(json.dumps(to_json(GO2) | wrong))
    args = ("--robot", file, "--seconds", 0.3, "--no-video", "--json", tmp_path / "walk.json")
    gains = ("--config.expert.command-gain", 1, 1, 1)
    assert surefoot("walk", *args, *gains) == 0
    assert json.loads((tmp_path / "walk.json").read_text())["beyond_limits"] == 1.0
    error = capsys.readouterr().err
    assert "mine: in 100 % of the time a joint is beyond its position limits" in error
    assert "_KFE ('" in error and "check the signs in `front` and `hind`" in error
    assert surefoot("walk", "--robot", "go2", *args[2:], *gains) == 0
    assert json.loads((tmp_path / "walk.json").read_text())["beyond_limits"] == 0.0
    assert "limits" not in capsys.readouterr().err


def test_a_run_of_a_robot_on_the_initial_states_of_another_is_refused(surefoot, capsys, tmp_path):
    args = ("train", "behavior_cloning", "--robot", "go2", "--run", tmp_path / "run")
    assert surefoot(*args, "--config.start-set", "solo12-trot-v1") == 2
    error = capsys.readouterr().err
    assert (
        "'solo12-trot-v1' belong to the robot solo12, but the configuration asks for go2" in error
    )
    assert "leave --config.start-set out" in error
    assert not (tmp_path / "run").exists()
