"""The command line: figures as JSON, clear errors, nothing lost on bad input."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import surefoot.cli.main as cli
import surefoot.cli.play as play_command
from surefoot.cli.evaluate import Evaluate
from surefoot.config import Config, ExpertData, LocoSafeDaggerConfig, PolicyConfig, PushConfig
from surefoot.config.presets import preset
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.methods.loco_safe_dagger import loco_safe_dagger
from surefoot.runs.run import create
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.viz.replay import recorded_episode
from surefoot.workers import Workers
from tests.fakes.robots import needs_pybullet


def surefoot(monkeypatch, *args: object) -> int:
    """Exit status of a command, as the entry point gives it."""
    monkeypatch.setattr(sys, "argv", ["surefoot", *map(str, args)])
    try:
        return cli.main()
    except SystemExit as stop:
        return int(stop.code or 0)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory) -> Path:
    """A finished run, too small to have learned anything."""
    method = LocoSafeDaggerConfig(
        pretraining=ExpertData(2, 1, False, 0.3),
        pretraining_epochs=1,
        iterations=1,
        velocities=2,
        perturbations=1,
        T=0.3,
        T_end=0.1,
        epochs=1,
    )
    config = Config(method=method, policy=PolicyConfig(hidden=(16, 16)))
    push = PushConfig(speeds=1, before=0.05, after=0.1, directions=2, resolution=4.0, levels=1)
    evaluation = replace(config.evaluation, duration=0.2, episodes=4)
    config = replace(config, evaluation=evaluation, push=push)
    run = create(tmp_path_factory.mktemp("run") / "tiny", config)
    loco_safe_dagger(run, workers=Workers(1))
    return run.folder


def test_walk_writes_its_figures(monkeypatch, tmp_path):
    file = tmp_path / "walk.json"
    args = ("--vx", 0.2, "--seconds", 2, "--no-video", "--json", file)
    assert surefoot(monkeypatch, "walk", *args) == 0
    figures = json.loads(file.read_text())
    assert figures["fell"] is False
    assert figures["command"] == [0.2, 0.0, 0.0]
    assert figures["mean_velocity"][0] == pytest.approx(0.2, abs=0.03)
    assert 0 < figures["max_torque"] <= 2.7
    assert (figures["plans"], figures["invalid_plans"]) == (40, 0)


def test_evaluate_reports_policy_and_expert_on_the_same_starts(monkeypatch, run_folder):
    file = run_folder / "figures.json"
    args = ("evaluate", run_folder, "--episodes", 4, "--workers", 1, "--json", file)
    assert surefoot(monkeypatch, *args) == 0
    figures = json.loads(file.read_text())
    for part in (figures, figures["expert"]):
        assert part["episodes"] == 4
        assert part["successes"] + part["falls"] + part["stalls"] + part["diverged"] == 4
        assert len(part["success_interval"]) == 2
        assert {"success_rate", "mse"} <= part.keys()
    assert figures["starts_hash"] == figures["expert"]["starts_hash"]


def test_evaluate_with_pushes(monkeypatch, capsys, run_folder, tmp_path):
    file = tmp_path / "figures.json"
    args = ("evaluate", run_folder, "--episodes", 2, "--workers", 1, "--pushes", "--json", file)
    assert surefoot(monkeypatch, *args) == 0
    figures = json.loads(file.read_text())
    expert = figures["expert"]["pushes"]
    assert expert["mean_fitted_impulse"] > figures["pushes"]["mean_fitted_impulse"] - 1e-9
    assert figures["push_difference"]["difference"] == pytest.approx(
        figures["pushes"]["mean_fitted_impulse"] - expert["mean_fitted_impulse"]
    )
    printed = capsys.readouterr().out
    assert f"push that 80 % survive [N s]: {expert['mean_fitted_impulse']:.2f} (" in printed
    assert "policy minus expert: " in printed


@pytest.mark.parametrize("split", ["select", "test"])
def test_pushes_are_on_the_split_asked_for(split):
    command = Evaluate(Path("run"), split=split, pushes=True)
    config = command.as_asked(Config())
    assert config == replace(Config(), push=replace(PushConfig(), split=split))
    nominal = replace(Config(), push=replace(PushConfig(), split="nominal"))
    expected = "nominal" if split == "test" else split  # what a run was configured with
    assert command.as_asked(nominal).push.split == expected


def test_what_is_evaluated_names_the_file(monkeypatch, run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    own = tmp_path / "solo12-trot-v1.npz"  # a file may hold anything, whatever its name
    save_starts(load_starts("solo12-trot-v1-wide"), own)
    digest = load_starts("solo12-trot-v1-wide").hash
    noisy = ("--disturbance.noise.joint-position", 0.01, "--disturbance.delay", 3)
    expected = {
        (): "evaluation-test.json",
        ("--starts", "solo12-trot-v1-wide"): "evaluation-test-solo12-trot-v1-wide.json",
        ("--starts", own): f"evaluation-test-solo12-trot-v1_{digest[:8]}.json",
        ("--disturbance.friction", 0.6, 0.7): "evaluation-test-friction_0.6_0.7.json",
        noisy: "evaluation-test-noise.joint_position_0.01-delay_3.json",
    }
    found = {}
    for number, (args, name) in enumerate(expected.items(), 1):
        assert surefoot(monkeypatch, "evaluate", folder, "--workers", 1, *args) == 0
        assert len(list(folder.glob("evaluation-*.json"))) == number
        found[args] = json.loads((folder / name).read_text())
    assert found[()]["disturbance"] == {}
    assert found[noisy]["disturbance"] == {"noise.joint_position": 0.01, "delay": 3}
    assert found["--starts", own]["starts_hash"] == digest != found[()]["starts_hash"]
    tracking = [figures["expert"]["mse"] for figures in found.values()]
    assert tracking[1] == tracking[2]
    assert len({json.dumps(mse) for mse in tracking}) == 4  # each of them did something
    assert found[()] == json.loads((folder / "evaluation-test.json").read_text())
    bad = ("--disturbance.mass", -1, 1)
    assert surefoot(monkeypatch, "evaluate", folder, *bad) == 2


def test_compare_writes_tables_and_picture(monkeypatch, capsys, run_folder, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(run_folder, other)
    shutil.copy(other / "policies/000.safetensors", other / "policies/001.safetensors")
    page, figure, file = (tmp_path / name for name in ("methods.md", "methods.png", "m.json"))
    page.write_text("prose")
    args = ("compare", run_folder, other, "--policy", "last", "--sim", "mujoco", "--no-pushes")
    args = (*args, "--episodes", 3, "--workers", 1, "--json", file, "--out", page)
    assert surefoot(monkeypatch, *args) == 2
    assert "no place for the tables" in capsys.readouterr().err
    assert not file.exists()  # said before anything was measured
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "surefoot.sim.bullet", None)  # not installed
        assert surefoot(patch, *(part for part in args if part not in ("--sim", "mujoco"))) == 2
    assert "pip install 'surefoot[pybullet]'" in capsys.readouterr().err
    assert not file.exists()
    page.write_text("# Title\n<!-- table -->\n<!-- end of table -->\nprose\n")
    assert surefoot(monkeypatch, *args, "--names", "one", "two", "--figure", figure) == 0
    text = page.read_text()
    assert text.startswith("# Title\n<!-- table -->\n") and text.endswith("-->\nprose\n")
    assert "| mujoco | two | " in text and "| mujoco | two | " in capsys.readouterr().out
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert [row["label"] for row in json.loads(file.read_text())["rows"]] == [
        "expert",
        "one",
        "two",
    ]


@needs_pybullet
def test_sim_overrides_the_configuration(monkeypatch, tmp_path):
    file = tmp_path / "walk.json"
    figures = []
    for sim in (("--sim", "bullet"), ("--config.simulation.backend", "bullet"), ()):
        args = ("--seconds", 0.3, "--no-video", "--json", file, *sim)
        assert surefoot(monkeypatch, "walk", *args) == 0
        figures.append(json.loads(file.read_text()))
    assert figures[0] == figures[1]
    assert figures[0]["base_height"] != figures[2]["base_height"]
    for command in ("train", "evaluate", "compare", "play", "bench", "doctor"):
        target = {"train": ["behavior_cloning"], "bench": ["plan"], "doctor": []}
        parsed = cli.parse([command, *target.get(command, ["run"]), "--sim", "bullet"])
        assert parsed.simulated(Config()).simulation.backend == "bullet"
        assert parsed.simulated(Config()) != Config()
        assert replace(parsed, sim=None).simulated(Config()) == Config()


@needs_pybullet
def test_sim_to_sim_leaves_the_runs_own_evaluation_alone(monkeypatch, run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    written = []
    for sim in ((), ("--sim", "mujoco"), ("--sim", "bullet")):
        assert surefoot(monkeypatch, "evaluate", folder, "--workers", 1, *sim) == 0
        files = sorted(path.name for path in folder.glob("evaluation-*.json"))
        written.append((files, (folder / "evaluation-test.json").read_bytes()))
    assert [files for files, _ in written] == [
        ["evaluation-test.json"],
        ["evaluation-test.json"],
        ["evaluation-test-bullet.json", "evaluation-test.json"],
    ]
    assert written[0][1] == written[1][1] == written[2][1]
    other = json.loads((folder / "evaluation-test-bullet.json").read_text())
    assert other["simulator"] == "bullet"
    assert other["starts_hash"] == json.loads(written[0][1])["starts_hash"]
    monkeypatch.setattr(play_command, "film_episode", lambda *_: None)
    file = tmp_path / "play.json"
    played = []
    for sim in ("mujoco", "bullet"):
        args = ("play", folder, "--seconds", 0.05, "--sim", sim, "--json", file)
        assert surefoot(monkeypatch, *args) == 0
        played.append(json.loads(file.read_text())["mean_velocity"])
    assert played[0] != played[1]


def test_a_recorded_episode_repeats_bit_for_bit(run_folder):
    from surefoot.rollouts.jobs import play_out
    from surefoot.runs.run import open_run

    frames = open_run(run_folder).dataset.load()
    episode = int(frames.episode[-1])
    mine = frames[frames.episode == episode]
    record, _ = play_out(recorded_episode(run_folder, episode))
    rows = mine.tick - record.starts.tick[0]
    np.testing.assert_array_equal(record.q[0, rows], mine.q)
    np.testing.assert_array_equal(record.torque[0, rows], mine.torque)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("train", "loco_safe_dager"), "did you mean 'loco_safe_dagger'"),
        (("train", "behavior_cloning", "--preset", "quik"), "did you mean 'quick'"),
        (("train", "--preset", "papr", "behavior_cloning"), "did you mean 'paper'"),
        (("train", "--resume"), "Name a method"),
        (("walk", "--seconds", "0", "--no-video"), "at least 0.001 s"),
        (("evaluate", "nowhere"), "no such run folder or policy file"),
        (("evaluate", ".", "--starts", "solo12-trot-v1-wid"), "did you mean 'solo12-trot-v1-wide'"),
        (("compare", "nowhere"), "holds no run"),
        (("play", "nowhere", "--episode", "3"), "holds no run"),
    ],
)
def test_bad_input_gets_a_clear_error(monkeypatch, capsys, tmp_path, args, message):
    monkeypatch.chdir(tmp_path)
    assert surefoot(monkeypatch, *args) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert not list(tmp_path.iterdir())


def test_an_unknown_option_names_the_nearest(monkeypatch, capsys):
    status = surefoot(monkeypatch, "train", "behavior_cloning", "--config.trainig.batch", 3)
    assert status == 2
    assert "--config.training.batch" in "".join(capsys.readouterr())


def test_options_may_stand_before_the_method():
    first = cli.parse(["train", "--preset", "quick", "--run", "r", "behavior_cloning"])
    second = cli.parse(["train", "behavior_cloning", "--preset=quick", "--run", "r"])
    assert first == second
    for flag in ("--resume", "--tensorboard", "--no-tensorboard"):
        assert cli.parse(["train", flag, "behavior_cloning"]).method == "behavior_cloning"
    assert first.config == preset("behavior_cloning", "quick")


def test_a_slip_does_not_occupy_the_folder(monkeypatch, capsys, tmp_path):
    folder = tmp_path / "run"
    args = ("train", "loco_safe_dagger", "--run", folder)
    assert surefoot(monkeypatch, *args, "--config.method.velocities", 50) == 2
    assert "50 velocities asked for" in capsys.readouterr().err
    assert create(folder, Config()).config == Config()  # nothing was collected, nothing is lost


def test_a_folder_with_a_run_is_left_alone(monkeypatch, capsys, run_folder):
    before = {path: path.read_bytes() for path in run_folder.rglob("*") if path.is_file()}
    assert surefoot(monkeypatch, "train", "loco_safe_dagger", "--run", run_folder) == 2
    assert "already holds a run" in capsys.readouterr().err
    assert before == {path: path.read_bytes() for path in before}


def test_policies_that_do_not_fit_are_refused(monkeypatch, capsys, tmp_path, run_folder):
    whole = (run_folder / "policies/000.safetensors").read_bytes()
    cut = tmp_path / "cut.safetensors"
    cut.write_bytes(whole[: len(whole) // 2])
    network = PolicyNetwork(PolicyConfig(hidden=(8,)))
    other = Policy(network, PolicyConfig(hidden=(8,)), 500, np.zeros((2, 3)), robot="a1")
    save(other, tmp_path / "other.safetensors")
    layout = tmp_path / "layout.safetensors"
    layout.write_bytes(whole.replace(b"base_height", b"base_heigth"))
    for name, message in (("cut", "not a whole"), ("other", "robot"), ("layout", "observation")):
        assert surefoot(monkeypatch, "evaluate", tmp_path / f"{name}.safetensors") == 2
        assert message in capsys.readouterr().err


def test_a_command_outside_the_training_warns(monkeypatch, tmp_path, run_folder):
    policy = tmp_path / "policy.safetensors"
    shutil.copy(run_folder / "policies/001.safetensors", policy)
    monkeypatch.setattr(play_command, "film_episode", lambda *_: None)
    with pytest.warns(UserWarning, match="outside what the policy was trained on"):
        surefoot(monkeypatch, "play", policy, "--vx", 1.5, "--seconds", 0.1)


def test_help_of_every_command():
    for command in ("doctor", "walk", "train", "evaluate", "compare", "play", "bench"):
        child = subprocess.run(
            [sys.executable, "-m", "surefoot", command, "--help"],
            capture_output=True,
            text=True,
            env={**os.environ, "COLUMNS": "100"},
        )
        assert child.returncode == 0, child.stderr
        assert "options" in child.stdout
