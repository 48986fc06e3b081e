"""The command train: method and preset wherever they stand, and folders that are left alone."""

import json
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.cli.main import parse
from surefoot.cli.train import Train, parse_train
from surefoot.config import BehaviorCloningConfig, Config, DaggerConfig
from surefoot.config.presets import preset
from surefoot.methods import METHODS
from surefoot.robots.scaling import with_own_values
from surefoot.runs.run import create
from tests.cases import first_often
from tests.fakes.learning import FLOAT32

OPTIONS = [
    "--config.method.pretraining.no-nominal",
    "--config.training.learning_rate 0.1",
    "--config.training.batch=32",
    "--config.collection.impulse 0.5 1.5",
    "--run loco_dagger",
    "--run=loco_dagger",
    "--preset quick",
    "--sim bullet --device cpu --resume --config.seed 3",
    "--config.method.pretraining.nominal",
    "--config.training.batch 32",
    "--resume",
    "--no-resume",
    "--track tensorboard",
    "--track=wandb",
    "--preset=quick",
]
"""Options of every form; the last ones have the form of others."""


@pytest.mark.parametrize("options", first_often(8, OPTIONS))
def test_the_method_may_stand_before_or_after_any_option(options):
    before = parse_train([*options.split(), "dagger"])
    after = parse_train(["dagger", *options.split()])
    assert before == after
    assert before.method == "dagger"


def test_the_options_reach_the_configuration():
    args = "--config.method.pretraining.no-nominal --run=a --preset quick dagger --config.seed 3"
    command = parse_train(args.split())
    assert command.run == Path("a")
    assert command.config.seed == 3
    assert isinstance(command.config.method, DaggerConfig)
    assert not command.config.method.pretraining.nominal


def test_an_option_of_any_number_of_values_ends_with_the_next_option():
    args = "--config.method.frames 4000 8000 --resume behavior_cloning"
    command = parse_train(args.split())
    assert isinstance(command.config.method, BehaviorCloningConfig)
    assert command.config.method.frames == (4000, 8000)
    assert command.resume


TRAINED = ("behavior_cloning", "dagger", "loco_safe_dagger")
PRESETS = ("default", "quick", "pushed", "paper")
# The first four have every preset, and every method.
PAIRS = [(TRAINED[(i + j) % 3], name) for j in range(3) for i, name in enumerate(PRESETS)]


@pytest.mark.parametrize(("method", "name"), first_often(4, PAIRS))
def test_defaults_are_those_of_method_and_preset(method, name):
    command = parse(["train", "--preset", name, method])
    assert command == Train(method, name, config=preset(method, name))


def test_the_last_of_two_presets_counts():
    command = parse_train(["--preset", "paper", "dagger", "--preset", "quick"])
    assert command == parse_train(["dagger", "--preset", "quick"])


@pytest.mark.parametrize("args", [(), ("dagger",), ("--preset", "quick", "loco_dagger")])
def test_help_shows_the_defaults_of_the_method(surefoot, capsys, args):
    assert surefoot("train", *args, "--help") == 0
    text = capsys.readouterr().out
    assert text.startswith("usage: surefoot train ")
    assert ("--config.method.N-query" in text) == ("loco_dagger" in args)
    assert ("--config.method.p " in text) == ("dagger" in args)


def test_a_wrong_option_does_not_occupy_the_folder(surefoot, capsys, tmp_path):
    folder = tmp_path / "run"
    args = ("train", "loco_safe_dagger", "--run", folder, "--config.training.precision", "float32")
    assert surefoot(*args, "--config.method.velocities", 50) == 2
    assert "method.velocities is 50; use at most 20" in capsys.readouterr().err
    assert surefoot(*args, "--workers", 0) == 2
    assert "0 workers; use at least 1" in capsys.readouterr().err
    assert not folder.exists()
    other = Config(training=FLOAT32)
    assert create(folder, other).config == with_own_values(
        other
    )  # nothing was collected, nothing is lost


def contents(folder: Path) -> dict[Path, bytes | None]:
    """Everything in a folder: bytes of files, None for folders."""
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def test_a_folder_with_a_run_is_left_alone(surefoot, capsys, run_folder):
    before = contents(run_folder)
    assert surefoot("train", "loco_safe_dagger", "--run", run_folder) == 2
    assert "already holds a run" in capsys.readouterr().err
    assert contents(run_folder) == before


def test_training_prints_its_progress_and_writes_its_metrics(surefoot, capsys, tmp_path):
    folder = tmp_path / "run"
    file = tmp_path / "metrics.json"
    sizes = "--config.method.data.velocities 2 --config.method.data.perturbations 1"
    sizes += " --config.method.data.no-nominal --config.method.data.duration 0.1"
    sizes += " --config.method.epochs 1 --config.method.frames 1000 --config.policy.hidden 16"
    sizes += " --config.evaluation.duration 0.05 --config.evaluation.episodes 2"
    sizes += " --config.training.precision float32"
    args = ("train", "behavior_cloning", *sizes.split(), "--run", folder, "--workers", 1)
    assert surefoot(*args, "--json", file) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(
        f"behavior_cloning, preset default, seed 0, in {folder}\ntraining in float32\n"
    )
    assert "\niteration 0: 20 rollouts, 0 fell" in printed
    assert f"best policy: {folder}/policies/" in printed
    report = json.loads(file.read_text())
    lines = (folder / "metrics.jsonl").read_text().splitlines()
    assert report == {"run": str(folder), "metrics": [json.loads(line) for line in lines]}
    assert report["metrics"][-1]["stage"] == "best"
    assert (folder / "curves.png").read_bytes().startswith(b"\x89PNG")


def test_the_tracker_hears_of_the_training_and_of_its_end(surefoot, tmp_path, monkeypatch):
    heard = []

    @contextmanager
    def tracked(run, tracker):
        heard.append((run.folder, tracker))
        try:
            yield
        finally:
            heard.append("closed")

    def train(run, workers, plan):
        heard.append("training")
        raise RuntimeError("out of time")

    monkeypatch.setattr("surefoot.runs.tracking.tracked", tracked)
    monkeypatch.setitem(METHODS, "dagger", replace(METHODS["dagger"], train=train))
    folder = tmp_path / "run"
    options = ("--config.training.precision", "float32", "--track", "wandb")
    assert surefoot("train", "dagger", "--run", folder, *options) == 2
    assert heard == [(folder, "wandb"), "training", "closed"]


def test_a_folder_that_cannot_be_made_is_refused_before_any_work(surefoot, capsys, tmp_path):
    """Nothing is said of resuming what has not begun."""
    (tmp_path / "file").touch()
    assert surefoot("train", "dagger", "--run", tmp_path / "file") == 2
    error = capsys.readouterr().err
    assert error.startswith(f"surefoot: --run: {tmp_path}/file is a file; name a folder")
    assert "--resume" not in error
    assert surefoot("train", "dagger", "--run", tmp_path / "file" / "run") == 2
    assert "metrics.jsonl cannot be written (Not" in capsys.readouterr().err


def test_a_run_that_is_not_there_begins_and_that_is_said(surefoot, capsys, tmp_path, monkeypatch):
    def create(*_):
        raise RuntimeError("begun")

    monkeypatch.setattr("surefoot.runs.run.create", create)
    folder = tmp_path / "mistyped"
    assert surefoot("train", "dagger", "--run", folder, "--resume") == 2
    assert f"there is no run in {folder} to resume: it begins now" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["config.json", "curves.png"])
def test_the_metrics_replace_no_file_of_the_run(surefoot, capsys, tmp_path, name):
    folder = tmp_path / "run"
    assert surefoot("train", "dagger", "--run", folder, "--json", folder / name) == 2
    assert "is one of the run's own files in" in capsys.readouterr().err
    assert not folder.exists()
