"""The command play: a policy from standing, and recorded episodes."""

import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.cli import play
from surefoot.config.json_io import to_json
from surefoot.config.robot_table import SOLO12
from surefoot.deploy.recorder import save_flight
from surefoot.files import WriteError, write_json
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy
from surefoot.rollouts.jobs import play_out
from surefoot.runs.run import open_run
from surefoot.types import Command
from surefoot.viz.replay import recorded_episode
from tests.fakes.learning import SMALL, spec_of
from tests.fakes.robots import needs_pybullet
from tests.viz.test_flight import flight_of


@pytest.fixture
def films(monkeypatch) -> list:
    """What would have been filmed: recording, file and title."""
    filmed = []
    monkeypatch.setattr(play, "film_episode", lambda *film: not filmed.append(film))
    return filmed


def test_a_policy_is_filmed_from_standing(surefoot, films, run_folder, tmp_path):
    file = tmp_path / "play.json"
    surefoot("play", run_folder, "--vx", 0.1, "--seconds", 0.1, "--json", file)
    report = json.loads(file.read_text())
    assert report["command"] == [0.1, 0.0, 0.0]
    assert report["seconds"] == 0.1
    assert report["episode"] is None
    assert (report["drove_last"], report["expert_share"]) == ("policy", 0.0)
    [(recording, out, title)] = films
    assert recording.q.shape == (100, 19)
    assert recording.expert_drove is None
    assert (out, title) == (run_folder / "play.mp4", "policy, vx 0.10 m/s")


def test_the_film_of_an_iterations_policy_is_beside_the_runs_other_films(
    surefoot, films, run_folder
):
    policy = run_folder / "policies" / "001.safetensors"
    surefoot("play", policy, "--seconds", 0.01)
    [(_, out, _)] = films
    assert out == run_folder / "play-001.mp4"


def test_the_film_of_a_policy_outside_of_any_run_is_beside_it(
    surefoot, films, run_folder, tmp_path
):
    policy = tmp_path / "mine.safetensors"
    shutil.copyfile(run_folder / "policies" / "001.safetensors", policy)
    surefoot("play", policy, "--seconds", 0.01)
    [(_, out, _)] = films
    assert out == tmp_path / "play.mp4"


def test_the_packaged_policy_walks_where_nothing_is_named(surefoot, films, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert surefoot("play", "--vx", 0.2, "--seconds", 2.0, "--json", "play.json") == 0
    report = json.loads(Path("play.json").read_text())
    assert report["outcome"] == "SUCCESS"
    assert report["mean_velocity"][0] == pytest.approx(0.2, abs=0.03)
    assert films[0][1] == Path("play.mp4")


def test_a_film_that_was_asked_for_by_name_and_cannot_be_made_is_a_failure(
    surefoot, monkeypatch, tmp_path
):
    monkeypatch.setattr(play, "film_episode", lambda *_: False)
    file = tmp_path / "flight.npz"
    flight = replace(flight_of(None, 3), fault=np.array(""))
    save_flight(file, flight)
    assert surefoot("play", file) == 0
    assert surefoot("play", file, "--out", tmp_path / "flight.mp4") == 1
    monkeypatch.chdir(tmp_path)
    assert surefoot("play", "--seconds", 0.3) == 0
    assert surefoot("play", "--seconds", 0.3, "--out", "play.mp4") == 1


def test_an_episode_needs_the_run_that_recorded_it(surefoot, capsys):
    assert surefoot("play", "--episode", 3) == 2
    assert "--episode 3 needs the folder of the run" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "options"),
    [
        (("--vx", 0.5, "--yaw-rate", 1), "--vx, --yaw-rate: not for an episode"),
        (("--gaits", "bound", "--seconds", 9), "--gaits, --seconds: not for an episode"),
    ],
)
def test_what_an_episode_has_as_it_was_is_refused(
    surefoot, films, capsys, run_folder, args, options
):
    assert surefoot("play", run_folder, "--episode", 1, *args) == 2
    assert options in capsys.readouterr().err
    assert not films


def test_a_recorded_episode_is_filmed_with_its_drivers(surefoot, films, run_folder, tmp_path):
    file = tmp_path / "play.json"
    surefoot("play", run_folder, "--episode", 1, "--iteration", 1, "--json", file)
    report = json.loads(file.read_text())
    assert report["episode"] == 100_001
    [(recording, out, title)] = films
    assert out == run_folder / "episode_100001.mp4"
    assert title.startswith("episode 100001, vx ")
    assert recording.expert_drove.shape == (len(recording.q),)
    assert report["drove_last"] == ("expert" if recording.expert_drove[-1] else "policy")


def test_a_recorded_episode_repeats_bit_for_bit(run_folder):
    frames = open_run(run_folder).dataset.load()
    episode = int(frames.episode[-1])
    recorded = frames[frames.episode == episode]
    rollouts, _ = play_out(recorded_episode(run_folder, episode))
    rows = recorded.tick - rollouts.starts.tick[0]
    np.testing.assert_array_equal(rollouts.q[0, rows], recorded.q)
    np.testing.assert_array_equal(rollouts.torque[0, rows], recorded.torque)


def test_a_command_outside_the_training_warns(surefoot, films, run_folder, tmp_path):
    policy = tmp_path / "policy.safetensors"
    shutil.copy(run_folder / "policies/001.safetensors", policy)
    with pytest.warns(UserWarning, match="outside what the policy was trained on"):
        surefoot("play", policy, "--vx", 1.5, "--seconds", 0.1)
    [(_, out, _)] = films
    assert out == tmp_path / "play.mp4"


def test_a_command_within_the_training_does_not_warn():
    low = [0.0, -0.1, 0.0]
    high = [0.3, 0.1, 0.0]
    policy = Policy(PolicyNetwork(SMALL, 1), spec_of(SMALL), [low, high], "solo12")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        play.check_command(policy, Command(*low))
        play.check_command(policy, Command(*high))
    with pytest.warns(UserWarning, match=r"outside what the policy was trained on.*0\.3"):
        play.check_command(policy, Command(0.5))
    with pytest.warns(UserWarning, match="outside what the policy was trained on"):
        play.check_command(policy, Command(0.2, -0.11))


def test_an_iteration_needs_an_episode(surefoot, capsys, run_folder):
    assert surefoot("play", run_folder, "--iteration", 1) == 2
    assert "--iteration 1 needs an --episode" in capsys.readouterr().err


@needs_pybullet
def test_a_policy_may_walk_in_another_simulator(surefoot, films, run_folder, tmp_path):
    file = tmp_path / "play.json"

    def velocity(simulator: str) -> list[float]:
        args = ("play", Path(run_folder), "--seconds", 0.05, "--sim", simulator, "--json", file)
        assert surefoot(*args) == 0
        return json.loads(file.read_text())["mean_velocity"]

    assert velocity("mujoco") != velocity("bullet")
    assert [film[0].simulation.backend for film in films] == ["mujoco", "bullet"]


def test_a_film_that_could_not_be_written_is_refused_before_any_work(
    surefoot, monkeypatch, capsys, run_folder, tmp_path
):
    def play_out(job):
        raise AssertionError("played")

    monkeypatch.setattr("surefoot.rollouts.jobs.play_out", play_out)
    for out in (tmp_path, tmp_path / "film.avi"):
        assert surefoot("play", run_folder, "--out", out) == 2
        assert f"{out}" in capsys.readouterr().err


def test_gaits_that_a_policy_does_not_have_are_refused(surefoot, capsys, run_folder):
    assert surefoot("play", run_folder, "--gaits", "trot", "bound") == 2
    assert "bound" in capsys.readouterr().err


def test_of_a_flight_of_an_own_robot_the_fault_is_told_and_its_file_asked_for(
    surefoot, films, capsys, tmp_path
):
    file = tmp_path / "flight.npz"
    save_flight(file, replace(flight_of(None, 3), robot=np.array("mine")))
    assert surefoot("play", file) == 2
    printed = capsys.readouterr()
    assert printed.out == "tilt: too far\n"
    assert "name its file with --robot FILE" in printed.err
    mine = tmp_path / "mine.json"
    write_json(mine, to_json(replace(SOLO12, name="mine")))
    assert surefoot("play", file, "--robot", mine) == 1
    assert films[0][0].robot.name == "mine"
    assert surefoot("play", "--robot", mine) == 2
    assert "--robot is for a recording" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "options"),
    [
        (("--json", "f.json", "--log", "l.csv"), "--log, --json: not for a flight"),
        (("--vx", 3, "--terrain", "mud"), "--terrain, --vx: not for a flight"),
        (("--episode", 3), "--episode: not for a flight"),
    ],
)
def test_what_a_flight_does_not_have_is_refused(
    surefoot, films, capsys, tmp_path, monkeypatch, args, options
):
    monkeypatch.chdir(tmp_path)
    save_flight(Path("flight.npz"), flight_of(None, 3))
    assert surefoot("play", "flight.npz", *args) == 2
    assert options in capsys.readouterr().err
    assert not films


def test_a_log_that_cannot_be_written_costs_no_report(
    surefoot, films, capsys, monkeypatch, run_folder, tmp_path
):
    def full(log, path):
        raise WriteError("the disk is full")

    monkeypatch.setattr("surefoot.interop.logs.sensor_log.write_sensor_log", full)
    file = tmp_path / "play.json"
    options = ("--seconds", 0.01, "--json", file, "--log", tmp_path / "log.csv")
    assert surefoot("play", run_folder, *options) == 2
    printed = capsys.readouterr()
    assert "the disk is full" in printed.err
    assert "mean_velocity" in printed.out
    assert json.loads(file.read_text())["seconds"] == 0.01


def test_a_report_that_cannot_be_written_costs_no_log(
    surefoot, films, monkeypatch, run_folder, tmp_path
):
    def full(path, record):
        raise WriteError("the disk is full")

    monkeypatch.setattr("surefoot.cli.episodes.write_json", full)
    log = tmp_path / "log.csv"
    options = ("--seconds", 0.01, "--json", tmp_path / "play.json", "--log", log)
    assert surefoot("play", run_folder, *options) == 2
    assert log.is_file()
