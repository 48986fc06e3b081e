"""The command learn: what it refuses, and a whole run on a twin over real UDP, in lockstep."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from threading import Thread

import pytest

from surefoot.cli.learn import Learn, LearnReport, cost_text, parse_learn
from surefoot.config import LocoSafeDaggerConfig
from surefoot.config.twin import TwinConfig
from surefoot.deploy.bridge import Bridge, UdpChannel, serve
from surefoot.deploy.udp_robot import address_text
from surefoot.field import session
from surefoot.field.attempts import Attempt, RobotCost, cost_of, read_attempts, write_attempts
from surefoot.robots.load import load_robot
from surefoot.runs.run import open_run
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.twin.serve import make_twin
from surefoot.types import JOINTS
from tests.fakes.bridge_process import PATIENT
from tests.fakes.bridge_world import Clock, ToyDriver

TINY = (
    *("--preset", "quick", "--workers", 1, "--lockstep", "--unattended"),
    *("--config.method.pretraining.velocities", 1, "--config.method.pretraining.perturbations", 0),
    *("--config.method.pretraining.duration", 0.3, "--config.method.pretraining-epochs", 1),
    *("--config.method.iterations", 1, "--config.method.velocities", 2),
    *("--config.method.T", 0.3, "--config.method.T-end", 0.1, "--config.method.epochs", 1),
    *("--config.policy.hidden", 16, "--config.training.precision", "float32"),
    *("--config.evaluation.episodes", 1, "--config.evaluation.duration", 0.1),
    *("--runtime.stand", 0.3),
)
"""Too small to learn anything: the robot falls, or the expert holds it."""
QUICK = ("--preset", "quick", "--unattended", "--config.training.precision", "float32")
"""A precision by its name: a run would measure which one is faster for seconds."""
PATIENCE = 300.0
"""[s] The machine may be busy."""


@pytest.fixture
def address():
    """The address of a twin in lockstep in a thread."""
    channel = UdpChannel()
    twin = make_twin(load_robot("solo12"), TwinConfig(pose="standing"), channel)
    going = [True]
    thread = Thread(target=twin.serve, args=(True, lambda: going[0]))
    thread.start()
    yield address_text(channel.address)
    going[0] = False
    thread.join()


@pytest.mark.slow  # a planner's process, which loads and compiles
def test_a_run_on_a_twin_is_a_run_and_the_same_command_goes_on(surefoot, address, tmp_path, capsys):
    folder = tmp_path / "run"
    file = tmp_path / "learn.json"
    args = ("learn", "--robot", address, "--run", folder, *TINY, "--json", file)
    assert surefoot(*args) == 0
    report = json.loads(file.read_text())
    assert set(report) == set(LearnReport.__dataclass_fields__)
    assert set(report["cost"]) == set(RobotCost.__dataclass_fields__)
    assert report["cost"]["attempts"] == 2
    run = open_run(folder)
    assert run.best_policy_path == run.policy_path(1)
    assert "robot-minutes driven" in capsys.readouterr().out
    metrics = run.metrics_path.read_bytes()
    assert surefoot(*args) == 0
    assert run.metrics_path.read_bytes() == metrics
    # The simulation does not go on with what a robot began.
    assert surefoot("train", "loco_safe_dagger", "--run", folder, "--resume") == 2
    assert "holds a run that learns on a robot" in capsys.readouterr().err


@pytest.mark.slow  # two processes that load and compile, twice
def test_a_killed_run_on_a_twin_loses_no_stored_episode_and_goes_on(address, tmp_path):
    folder = tmp_path / "run"
    options = ("--config.method.velocities", 6, "--config.method.T", 0.5)
    args = ("learn", "--robot", address, "--run", folder, *TINY, *options)
    command = [sys.executable, "-m", "surefoot", *map(str, args)]
    stored = folder / "data" / "iteration_001-001.h5"
    manifest = folder / "data" / "manifest.json"

    def second_episode_is_stored():
        return manifest.exists() and stored.stem in manifest.read_text()

    log = tmp_path / "log"
    with log.open("wb") as output, subprocess.Popen(command, stdout=output, stderr=output) as child:
        until = time.monotonic() + PATIENCE
        while not second_episode_is_stored() and child.poll() is None and time.monotonic() < until:
            time.sleep(0.01)
        child.kill()
    assert second_episode_is_stored() and child.returncode == -signal.SIGKILL, log.read_text()
    before = read_attempts(folder)[:2]  # the frames of a third may not have been stored
    assert len(before) == 2
    shard = stored.read_bytes()
    again = subprocess.run(command, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stderr
    assert stored.read_bytes() == shard
    attempts = read_attempts(folder)
    assert attempts[: len(before)] == before
    assert len({attempt.episode for attempt in attempts}) == 6
    assert open_run(folder).best_policy_path == open_run(folder).policy_path(1)


def test_a_bridge_that_is_not_there_is_one_clear_line(surefoot, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(session, "PATIENCE", 0.0)
    channel = UdpChannel()
    address = address_text(channel.address)
    channel.close()
    args = ("learn", "--robot", address, "--run", tmp_path / "run", *QUICK)
    assert surefoot(*args, "--device", "cpu") == 2
    assert f"surefoot: no bridge answers at {address}" in capsys.readouterr().err
    assert open_run(tmp_path / "run").config.training.device == "cpu"


def test_a_bridge_of_another_robot_is_refused_before_any_work(surefoot, address, tmp_path, capsys):
    run = tmp_path / "run"
    options = ("--run", run, *QUICK, "--config.robot.model", "go2")
    # Without these, what another robot needs would be measured.
    states = tmp_path / "go2.npz"
    save_starts(replace(load_starts(), robot="go2"), states)
    given = ("--config.start-set", states, "--config.expert.command-gain", 1, 1, 1)
    assert surefoot("learn", "--robot", address, "--lockstep", *options, *given) == 2
    assert "the bridge serves the robot solo12, and the configuration" in capsys.readouterr().err
    assert not (run / "data").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rate_hz": 500}, "the policy runs at 1000 Hz, and the bridge at 500 Hz"),
        (
            {"joints": (JOINTS[1], JOINTS[0], *JOINTS[2:])},
            "joint 0 is FL_HAA for the policy and FL_HFE for the bridge",
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:serve runs in a thread")
def test_a_bridge_of_another_rate_or_joint_order_is_refused_before_any_work(
    surefoot, tmp_path, capsys, changes, message
):
    channel = UdpChannel()
    description = PATIENT._replace(robot="solo12", **changes)
    bridge = Bridge(ToyDriver(Clock()), channel, description)
    going = [True]
    thread = Thread(target=serve, args=(bridge, lambda: going[0]))
    thread.start()
    run = tmp_path / "run"
    options = ("--run", run, *QUICK)
    try:
        assert surefoot("learn", "--robot", address_text(channel.address), *options) == 2
    finally:
        going[0] = False
        thread.join()
    assert message in capsys.readouterr().err
    assert not (run / "data").exists()


@pytest.mark.parametrize(
    ("args", "message"),
    [
        ((), "--robot"),
        (("--robot", "udp://127.0.0.1"), "no address of a bridge; use udp://127.0.0.1:PORT"),
        (("--robot", "udp://127.0.0.1:1", "--preset", "slow"), "no preset 'slow'"),
        (("--robot", "udp://127.0.0.1:1", "--heartbeat", -1), "--heartbeat -1: use at least 0.001"),
        (
            ("--robot", "udp://127.0.0.1:1", "--heartbeat", 1, "--unattended"),
            "--heartbeat needs somebody who types; leave out --unattended",
        ),
    ],
)
def test_options_that_make_no_sense_are_refused(surefoot, tmp_path, capsys, args, message):
    precision = ("--config.training.precision", "float32")
    assert surefoot("learn", "--run", tmp_path / "run", *precision, *args) == 2
    printed = capsys.readouterr()
    assert message in printed.err + printed.out


def test_without_a_standard_input_nobody_could_stop_the_robot(
    surefoot, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(sys, "stdin", None)  # as after `<&-`
    folder = tmp_path / "run"
    assert surefoot("learn", "--robot", "udp://127.0.0.1:1", "--run", folder) == 2
    message = "there is no standard input, so nobody could stop the robot; use --unattended"
    assert capsys.readouterr().err == f"surefoot: {message}\n"
    assert not folder.exists()


def test_several_gaits_are_refused_before_there_is_a_run(surefoot, tmp_path, capsys):
    folder = tmp_path / "run"
    args = ("--robot", "udp://127.0.0.1:1", "--run", folder, "--gaits", "trot", "walk")
    assert surefoot("learn", *args) == 2
    message = capsys.readouterr().err
    assert "learning on a robot takes one gait" in message and "--gait" in message
    assert not folder.exists()


def test_the_operator_is_shown_only_what_has_an_effect(monkeypatch, caplog):
    learn = parse_learn(["--robot", "udp://127.0.0.1:5151"])
    assert all(word in learn.hint for word in ("start", "stop", "stand", "walk"))
    assert not any(word in learn.hint for word in ("vx", "vy", "yaw"))
    reader, writer = os.pipe()
    with os.fdopen(reader) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        terminal = learn.terminal()
        os.write(writer, b"vx 0.2\n")
        os.close(writer)
        terminal.wish()
    assert "'vx 0.2' means nothing" in caplog.text


def test_an_iteration_on_a_robot_is_shorter_than_a_simulated_one():
    method = parse_learn(["--robot", "udp://127.0.0.1:5151"]).config.method
    assert isinstance(method, LocoSafeDaggerConfig)
    assert (method.velocities, method.perturbations, method.T) == (10, 1, 5.0)


@pytest.mark.parametrize("report", [LearnReport, RobotCost])
def test_help_names_every_json_key(report):
    keys = re.findall(r"\w+", (Learn.__doc__ or "").partition("JSON keys:")[2])
    assert [key for key in report.__dataclass_fields__ if key not in keys] == []


def test_the_cost_is_said_in_words(tmp_path):
    attempt = Attempt(1, 100000, "fell", "tilt", "", 30.0, 2.0, 3, 4.0, 0)
    write_attempts(tmp_path, [attempt])
    text = cost_text(cost_of([attempt]))
    assert "0.5 robot-minutes driven" in text
    assert "falls:       1, 2.00 in a robot-minute" in text
    assert cost_text(cost_of([])).endswith("takeovers:   0")
