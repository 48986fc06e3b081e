"""Ctrl-C and `kill -9` in the midst of a real `surefoot train`: the same bits as if left alone."""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from surefoot.cli.main import run_command
from surefoot.runs.run import open_run
from tests.fakes.runs import measurements

TINY = [
    "--config.training.precision",
    "float32",
    "--config.method.pretraining.velocities",
    "2",
    "--config.method.pretraining.perturbations",
    "1",
    "--config.method.pretraining.duration",
    "0.3",
    "--config.method.pretraining-epochs",
    "2",
    "--config.method.iterations",
    "2",
    "--config.method.velocities",
    "2",
    "--config.method.T",
    "0.8",
    "--config.method.T-block",
    "0.2",
    "--config.method.T-end",
    "0.2",
    "--config.method.epochs",
    "2",
    "--config.chunk",
    "4",
    "--config.policy.hidden",
    "64",
    "64",
    "--config.training.batch",
    "64",
    "--config.evaluation.episodes",
    "8",
    "--config.evaluation.duration",
    "0.3",
]

SHORT = [
    "--config.training.precision",
    "float32",
    "--config.method.pretraining.duration",
    "0.4",
    "--config.method.pretraining-epochs",
    "6",
    "--config.method.T",
    "2.0",
    "--config.evaluation.episodes",
    "10",
    "--config.evaluation.duration",
    "0.5",
]
"""An evaluation is repeated whole: a longer one would take most of the kills."""


def arguments(folder: Path, options: list[str], workers: int) -> list[str]:
    """The command line of a training, without the name of the program."""
    command = ["train", "loco_safe_dagger", "--preset", "quick", "--run", str(folder), "--resume"]
    return [*command, "--workers", str(workers), *options]


def start(folder: Path, options: list[str], workers: int) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "surefoot", *arguments(folder, options, workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Tests that are started in the background have children that ignore Ctrl-C.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )


def finish(folder: Path, options: list[str]) -> float:
    """Let it run to its end; how long that took from its first word on [s]."""
    process = start(folder, options, workers=1)
    begun(process)
    began = time.monotonic()
    _, errors = process.communicate()
    assert process.returncode == 0, errors
    return time.monotonic() - began


def begun(process: subprocess.Popen) -> None:
    """Wait until it has read everything and says what it trains."""
    assert process.stdout is not None
    assert "preset quick" in process.stdout.readline()


def bits(folder: Path) -> dict:
    run = open_run(folder)
    policies = {path.name: path.read_bytes() for path in folder.glob("policies/*.safetensors")}
    return {"data": run.dataset.hash, "metrics": measurements(run), "policies": policies}


def stage(folder: Path) -> str:
    """Where a run that was killed stands: the stage, shards, checkpoint."""
    run = open_run(folder)
    stages = ("collect", "train", "validate")
    iteration, which = divmod(len(run.metrics), len(stages))
    checkpoints = len(list(folder.glob("checkpoints/*")))
    return (
        f"in {stages[which]} {iteration}, {len(run.dataset.shards)} shards, "
        f"{checkpoints} checkpoints"
    )


def interrupt(folder: Path, options: list[str]) -> None:
    """Ctrl-C in the middle of a collection, as a terminal sends it: to all processes."""
    process = start(folder, options, workers=2)
    while not list(folder.glob("**/*.h5")):
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "go on with --resume" in errors
    assert "Traceback" not in errors
    print(f"Ctrl-C: {stage(folder)}")


def kill_until_done(
    tmp_path: Path, options: list[str], kills: int, seed: int, longest: float
) -> None:
    """Kill every try; the longest gets that share of the time that an undisturbed run takes.

    Each try first starts its workers again, so that shorter ones would never reach the end. The
    undisturbed run, and what is left after the last kill, take place in one process.
    """
    undisturbed = finish(tmp_path / "undisturbed" / "run", options)
    rng = random.Random(seed)
    folder = tmp_path / "killed" / "run"
    killed = 0
    interrupt(folder, options)
    for attempt in range(10 * kills):
        process = start(folder, options, workers=2)
        begun(process)
        delay = rng.uniform(0.2, 1.0) * longest * undisturbed
        try:
            process.communicate(timeout=delay)
            assert process.returncode == 0
            break
        except subprocess.TimeoutExpired:
            whole_group = attempt % 2 == 1  # at first the parent alone, whose workers live on
            if whole_group:
                os.killpg(process.pid, signal.SIGKILL)
            else:
                process.kill()
            process.wait()
            killed += 1
        print(f"kill {killed} after {delay:.2f} s: {stage(folder)}")
        if killed == kills:
            finish(folder, options)
            break
    print(f"{killed} kills, undisturbed {undisturbed:.1f} s, dataset {bits(folder)['data'][:16]}")
    assert killed >= kills // 2
    assert bits(folder) == bits(tmp_path / "undisturbed" / "run")


@pytest.mark.thorough
def test_kills_at_a_few_random_instants(tmp_path):
    kill_until_done(tmp_path, TINY, kills=2, seed=1, longest=1.0)


@pytest.mark.slow
def test_kills_at_twenty_random_instants(tmp_path):
    """With `-s`, says where each kill struck."""
    kill_until_done(tmp_path, SHORT, kills=20, seed=2, longest=0.1)


def test_a_second_training_in_the_same_folder_is_refused(tmp_path, capsys):
    folder = tmp_path / "run"
    first = start(folder, TINY, workers=2)
    try:
        while not (folder / "config.json").exists():
            assert first.poll() is None
            time.sleep(0.02)
        assert run_command(arguments(folder, TINY, workers=2)) == 2
        errors = capsys.readouterr().err
        assert re.search(r"another process trains in .*run; wait for it", errors)
    finally:
        first.send_signal(signal.SIGTERM)
        _, errors = first.communicate(timeout=30)
    # Batch systems ask first: the answer is that of Ctrl-C.
    assert first.returncode == 130
    assert "go on with --resume" in errors
    assert json.loads((folder / "config.json").read_text())["config"]["chunk"] == 4
