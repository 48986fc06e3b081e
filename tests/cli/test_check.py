"""The command check: verifies files, replays logs, and says what differs."""

import json
from dataclasses import replace

import pytest

import surefoot.cli.play as play
from surefoot.cli.check import CheckReport, lines_of
from surefoot.deploy.export_file import read_export
from surefoot.deploy.policy import load
from surefoot.interop.logs.check import LogReport
from surefoot.interop.logs.sensor_log import read_sensor_log, write_sensor_log
from tests.fakes.exports import answered_log, exported, policy_of


@pytest.fixture
def files(tmp_path):
    """An exported file, and a log in which all agrees."""
    path, _ = exported(tmp_path)
    log = tmp_path / "log.csv"
    write_sensor_log(answered_log(load(path), 60), log)
    return path, log


def test_a_file_is_verified_and_described(surefoot, capsys, files):
    path, _ = files
    assert surefoot("check", path, "--robot", "solo12", "--layout", "full") == 0
    printed = capsys.readouterr().out
    assert "whole; the network of a policy for solo12, 1000 Hz, layout full, trot" in printed
    assert "torque at most 2.7 N m" in printed
    assert "begins in the postures of: solo12-trot-v1" in printed


def test_the_limits_of_all_joints_are_told_where_they_differ(surefoot, capsys, tmp_path):
    """A Go2's knee has almost twice the torque of its hips, and the smallest is not the limit."""
    path, _ = exported(tmp_path, policy=policy_of(robot="go2"))
    assert surefoot("check", path) == 0
    printed = capsys.readouterr().out
    assert "torque at most 23.7, 23.7, 45.43 N m for the joints of a leg" in printed
    assert "speed at most 30.1, 30.1, 15.7 rad/s for the joints of a leg" in printed
    assert "-1.5708 to 3.4907" in printed and "-0.5236 to 4.5379" in printed
    assert "hardware profile: none" in printed


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--robot", "go2"), "is a policy of the robot 'solo12', not of 'go2'"),
        (("--layout", "proprioceptive"), "has the layout 'full', expected 'proprioceptive'"),
        (("--policy", "policy.safetensors"), "--policy replays a log through PyTorch"),
    ],
)
def test_what_does_not_fit_is_refused(surefoot, capsys, files, options, text):
    assert surefoot("check", files[0], *options) == 2
    assert text in capsys.readouterr().err


def test_a_log_in_which_all_agrees(surefoot, capsys, files, tmp_path):
    path, log = files
    report = tmp_path / "report.json"
    policy = tmp_path / "policy.safetensors"
    assert surefoot("check", path, "--log", log, "--policy", policy, "--json", report) == 0
    assert "all agree" in capsys.readouterr().out
    values = json.loads(report.read_text())
    assert values["log"]["findings"] == []
    assert "ONNX and PyTorch" in values["log"]["compared"]
    assert values["description"]["robot"] == "solo12"


def test_a_log_that_differs_is_explained(surefoot, capsys, files):
    path, file = files
    log = read_sensor_log(file)
    write_sensor_log(replace(log, joint_velocity=-log.joint_velocity), file)
    assert surefoot("check", path, "--log", file) == 1
    assert "joint_velocity: the input that was logged differs" in capsys.readouterr().out


def test_what_a_log_is_too_short_to_show_is_said_and_is_no_difference(files):
    path, _ = files
    log = LogReport(50, (), (), (), "too short to judge a history")
    report = CheckReport(str(path), read_export(path).description, log)
    assert lines_of(report)[-2:] == ["too short to judge a history", "all else agrees"]


def test_columns_that_are_ignored_are_named_in_one_line(files):
    path, _ = files
    log = LogReport(50, (), (), (), ignored=("battery", "fan"))
    report = CheckReport(str(path), read_export(path).description, log)
    assert "ignored, because no log has it: battery, fan" in lines_of(report)


def test_another_policy_than_the_exported_one_is_refused(surefoot, capsys, files, tmp_path):
    path, log = files
    exported(tmp_path / "other", "full", torque_limit=(1.0,) * 12)
    other = tmp_path / "other" / "policy.safetensors"
    other.write_bytes(other.read_bytes()[:-4] + b"\0\0\0\1")
    assert surefoot("check", path, "--log", log, "--policy", other) == 2
    assert "policy" in capsys.readouterr().err


def test_a_log_of_a_simulation_agrees(surefoot, monkeypatch, run_folder, tmp_path):
    monkeypatch.setattr(play, "film_episode", lambda *film: True)
    network = tmp_path / "network.onnx"
    log = tmp_path / "log.npz"
    assert surefoot("export", run_folder, "--onnx", network) == 0
    surefoot("play", run_folder, "--seconds", 0.15, "--log", log)
    assert surefoot("check", network, "--log", log) == 0
    assert surefoot("play", run_folder, "--episode", 0, "--log", log) == 2
