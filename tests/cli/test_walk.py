"""The command walk: how the expert walked, in words and as JSON."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from surefoot.cli import walk
from surefoot.cli.walk import Walk, WalkReport, box_around, misses, parse_walk
from surefoot.config import CommandBox, Config
from surefoot.scenarios.preparation import CommandGain
from surefoot.types import Command
from tests.fakes.robots import needs_pybullet


def test_walk_writes_its_report(surefoot, capsys, tmp_path):
    file = tmp_path / "walk.json"
    args = ("--vx", 0.2, "--seconds", 2, "--no-video", "--json", file)
    assert surefoot("walk", *args) == 0
    report = json.loads(file.read_text())
    assert report["fell"] is False
    assert report["outcome"] == "SUCCESS"
    assert report["command"] == [0.2, 0.0, 0.0]
    assert report["mean_velocity"][0] == pytest.approx(0.2, abs=0.03)
    assert abs(report["heading_drift"]) < 5.0
    assert report["base_height"] == pytest.approx(0.22, abs=0.05)
    assert 0 < report["base_height_std"] < 0.02
    assert 0 < report["max_torque"] <= 2.7
    assert (report["plans"], report["invalid_plans"]) == (40, 0)
    assert report["seconds"] == 2.0
    printed = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert {key: json.loads(value) for key, value in printed.items()} == report


def test_the_film_shows_the_whole_walk(monkeypatch, tmp_path):
    films = []
    monkeypatch.setattr(walk, "film_episode", lambda *film: films.append(film))
    out = tmp_path / "walk.mp4"
    assert Walk(vx=0.1, seconds=0.3, out=out)() == 0
    [(recording, path, title)] = films
    assert recording.q.shape == (300, 19)
    assert recording.expert_drove is None and not recording.pushes
    assert recording.simulation == Config().simulation
    assert (path, title) == (out, "expert, vx 0.10 m/s")
    np.testing.assert_allclose(recording.q[0, :2], 0.0, atol=1e-6)


@needs_pybullet
def test_sim_overrides_the_configuration(surefoot, tmp_path):
    file = tmp_path / "walk.json"
    reports = []
    for sim in (("--sim", "bullet"), ("--config.simulation.backend", "bullet"), ()):
        assert surefoot("walk", "--seconds", 0.3, "--no-video", "--json", file, *sim) == 0
        reports.append(json.loads(file.read_text()))
    assert reports[0] == reports[1]
    assert reports[0]["base_height"] != reports[2]["base_height"]


@pytest.mark.parametrize("option", ["--vx", "--vy", "--yaw-rate"])
@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_velocity_that_is_not_finite_is_refused(surefoot, capsys, option, value):
    assert surefoot("walk", option, value, "--no-video") == 2
    assert f"{option} is {value}; use a finite number" in capsys.readouterr().err


@pytest.mark.parametrize(("option", "unit"), [("--vx", "m/s"), ("--yaw-rate", "rad/s")])
def test_a_velocity_beyond_all_commands_is_refused_by_its_option(surefoot, capsys, option, unit):
    assert surefoot("walk", option, 20, "--no-video") == 2
    assert f"{option} is 20 {unit}; use -10 to 10 {unit}" in capsys.readouterr().err


def test_the_report_and_the_sheet_of_the_film_are_two_files(surefoot, capsys, tmp_path):
    args = ("--out", tmp_path / "a.mp4", "--json", tmp_path / "a.png")
    assert surefoot("walk", *args) == 2
    assert "a.png is the file of --json too" in capsys.readouterr().err


def test_an_expert_that_gives_up_at_once_has_diverged_after_no_time(surefoot, capsys, tmp_path):
    """No residual is small enough, so no plan is valid."""
    file = tmp_path / "walk.json"
    options = ("--no-video", "--seconds", 0.3, "--config.expert.max-residual", 1e-300)
    assert surefoot("walk", *options, "--json", file) == 1
    report = json.loads(file.read_text())
    assert (report["outcome"], report["seconds"]) == ("DIVERGED", 0.0)
    assert report["fell"] is False
    assert (
        "the expert gave up after 0.00 s: its plan is not valid or not finite. Perhaps the command "
        "is too fast for the robot and the gait: `surefoot prepare` with the same options and --vx "
        "0 0.2 --vy 0 0 --yaw-rate 0 0 says up to which it walks"
    ) in capsys.readouterr().err
    assert report["plans"] == report["invalid_plans"] == 1


REPORT = WalkReport(
    fell=False,
    outcome="SUCCESS",
    command=(0.5, 0.0, -0.5),
    mean_velocity=(0.5, 0.0, -0.5),
    heading_drift=0.0,
    base_height=0.3,
    base_height_std=0.0,
    max_torque=1.0,
    torque_used=0.1,
    speed_used=0.1,
    beyond_limits=0.0,
    plans=100,
    invalid_plans=0,
    seconds=5.0,
)


def test_a_command_that_is_missed_is_said_with_the_gains():
    gain = (1.1, 1.0, 1.2)
    assert misses(REPORT, gain) == []
    [said] = misses(replace(REPORT, mean_velocity=(0.36, 0.0, -0.42)), gain)
    assert said.startswith("vx misses its command, 0.50 m/s, by 28%: the robot reached 0.36 m/s")
    assert said.endswith("the gains were 1.1 1 1.2")
    slow = replace(REPORT, command=(0.1, 0.0, 0.0), mean_velocity=(0.07, 0.02, 0.0))
    assert misses(slow, gain) == []
    astray = replace(REPORT, mean_velocity=(-0.5, 0.0, 0.5))
    assert len(misses(astray, gain)) == 2
    assert misses(replace(astray, outcome="FELL"), gain) == []
    assert misses(replace(astray, seconds=1.0), gain) == []


def test_walk_says_that_a_command_is_missed(surefoot, capsys):
    args = ("--vx", 0.3, "--seconds", 2, "--no-video", "--config.expert.command-gain")
    assert surefoot("walk", *args, 0.5, 1, 1) == 0
    assert "solo12: vx misses its command, 0.30 m/s, by" in capsys.readouterr().err


def test_a_named_gait_walks_at_its_command(surefoot, tmp_path):
    file = tmp_path / "walk.json"
    args = ("--gait", "walk", "--vx", 0.2, "--seconds", 2, "--no-video", "--json", file)
    assert surefoot("walk", *args) == 0
    report = json.loads(file.read_text())
    assert report["outcome"] == "SUCCESS"
    assert report["mean_velocity"][0] == pytest.approx(0.2, abs=0.03)


def test_standing_is_no_stall(surefoot, tmp_path):
    file = tmp_path / "walk.json"
    args = ("--gait", "stand", "--seconds", 2, "--no-video", "--json", file)
    assert surefoot("walk", *args) == 0
    report = json.loads(file.read_text())
    assert (report["outcome"], report["command"]) == ("SUCCESS", [0.0, 0.0, 0.0])


@pytest.mark.parametrize("option", ["--vx", "--vy", "--yaw-rate"])
def test_a_gait_that_stands_goes_nowhere(surefoot, capsys, option):
    assert surefoot("walk", "--gait", "stand", option, 0.1, "--no-video") == 2
    assert "the gait stand goes nowhere, but the commands are" in capsys.readouterr().err


def test_a_gait_that_does_not_carry_the_robot_is_refused_with_numbers(surefoot, capsys):
    assert surefoot("walk", "--gait", "pace", "--vx", 0, "--vy", 0.1, "--no-video") == 2
    error = capsys.readouterr().err
    assert "surefoot: the gait pace does not move the robot: of vy 0.1 m/s it reached 0.0" in error


def test_an_unknown_gait_is_answered_with_the_nearest(surefoot, capsys):
    assert surefoot("walk", "--gait", "pronck", "--no-video") == 2
    assert "there is no gait 'pronck'; did you mean 'pronk'?" in capsys.readouterr().err


def test_a_gait_has_to_move_along_the_axes_of_its_command():
    assert box_around(Command(0.2, 0.0, -0.5)) == CommandBox((0, 0.2), (0, 0), (-0.5, 0))


@pytest.fixture
def walked(monkeypatch) -> Callable[..., Config]:
    """Gives the configuration under which the expert would walk."""
    configs: list[Config] = []

    class Stop(Exception):
        pass

    def play_out(job, progress):
        configs.append(job.config)
        raise Stop

    monkeypatch.setattr("surefoot.rollouts.jobs.play_out", play_out)
    zero = (0.0, 0.0, 0.0)
    gain = CommandGain((1.1, 1.2, 1.3), zero, zero, zero)
    monkeypatch.setattr("surefoot.scenarios.gains.measured_gain", lambda robot, config: gain)

    def attempt(*args):
        with pytest.raises(Stop):
            parse_walk(args)()
        return configs[-1]

    return attempt


def test_straight_ahead_solo12_trots_by_the_first_rules(walked):
    expert = walked("--vx", "0.3", "--no-video").expert
    assert (expert.turn_compensation, expert.capture_share) == (0.0, 0.0)


@pytest.mark.parametrize(
    "args", [("--yaw-rate", "0.5"), ("--vy", "-0.1"), ("--vx", "0.5"), ("--robot", "go2")]
)
def test_in_turns_sideways_fast_and_on_other_robots_the_rules_neither_drift_nor_latch(walked, args):
    expert = walked(*args, "--no-video").expert
    assert (expert.turn_compensation, expert.capture_share) == (0.3, 0.25)
