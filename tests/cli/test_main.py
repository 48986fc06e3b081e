"""The command line as a whole: the overview, help, errors, exit status."""

import os
import re
import subprocess
import sys

import pytest

import surefoot.cli.main as main_module
from surefoot.cli.compare import Compare
from surefoot.cli.evaluate import Evaluate
from surefoot.cli.gate_warnings import MeasureWarnings
from surefoot.cli.main import COMMANDS, overview
from surefoot.cli.play import Play
from surefoot.cli.train import Train, TrainReport
from surefoot.cli.walk import Walk, WalkReport
from surefoot.evaluation.gate_warnings import GateWarnings, RunWarnings
from surefoot.evaluation.report import EvaluationReport
from surefoot.study.records import Comparison, Row
from surefoot.viz.replay import EpisodeReport


def test_the_overview_fits_one_screen():
    child = subprocess.run(
        [sys.executable, "-m", "surefoot", "--help"],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "80"},
    )
    assert child.returncode == 0, child.stderr
    lines = child.stdout.splitlines()
    assert len(lines) <= 24
    assert max(len(line) for line in lines) <= 80
    described = [line.split()[0] for line in lines if line.startswith("  ")]
    assert described == list(COMMANDS)


def test_a_reader_that_stops_reading_is_no_error():
    command = [sys.executable, "-m", "surefoot", "walk", "--help"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        assert child.stdout is not None and child.stderr is not None
        child.stdout.close()
        assert child.stderr.read() == b""


def test_without_a_command_the_overview_is_an_error(surefoot, capsys):
    assert surefoot() == 2
    output = capsys.readouterr()
    assert output.err == overview() + "\n"
    assert not output.out


def test_a_wrong_command_lists_the_commands(surefoot, capsys):
    assert surefoot("evalute", "run") == 2
    error = capsys.readouterr().err
    assert "did you mean 'evaluate'" in error
    assert all(name in error for name in COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_help_of_its_own(surefoot, capsys, monkeypatch, command):
    monkeypatch.setenv("COLUMNS", "100")
    assert surefoot(command, "--help") == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: surefoot {command} ")
    assert "options" in text


@pytest.mark.parametrize(
    ("command", "report"),
    [
        (Walk, WalkReport),
        (Play, EpisodeReport),
        (Train, TrainReport),
        (Evaluate, EvaluationReport),
        (Compare, Comparison),
        (Compare, Row),
        (MeasureWarnings, RunWarnings),
        (MeasureWarnings, GateWarnings),
    ],
)
def test_help_names_every_json_key(command, report):
    keys = re.findall(r"\w+", command.__doc__.partition("JSON keys:")[2])
    missing = [key for key in report.__dataclass_fields__ if key not in keys]
    assert not missing


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("train", "loco_safe_dager"), "did you mean 'loco_safe_dagger'"),
        (("train", "behavior_cloning", "--preset", "quik"), "did you mean 'quick'"),
        (("train", "--preset", "papr", "behavior_cloning"), "did you mean 'paper'"),
        (("train", "--resume"), "needs the name of a method"),
        (("train",), "needs the name of a method: behavior_cloning, dagger, "),
        (("train", "--resum", "dagger"), "there is no option --resum;"),
        (("walk", "--seconds", "0", "--no-video"), "at least 0.001 s"),
        (("evaluate", "nowhere"), "no such run folder or policy file"),
        (("evaluate", ".", "--starts", "solo12-trot-v1-wid"), "did you mean 'solo12-trot-v1-wide'"),
        (("compare", "nowhere"), "holds no run"),
        (("play", "nowhere", "--episode", "3"), "holds no run"),
    ],
)
def test_bad_input_is_one_clear_line(surefoot, monkeypatch, capsys, tmp_path, args, message):
    monkeypatch.chdir(tmp_path)
    assert surefoot(*args) == 2
    error = capsys.readouterr().err
    last = error.splitlines()[-1]
    assert last.startswith("surefoot: ")
    assert message in last
    assert "Traceback" not in error
    assert not list(tmp_path.iterdir())


def test_an_unknown_option_names_the_nearest(surefoot, capsys):
    assert surefoot("train", "behavior_cloning", "--config.trainig.batch", 3) == 2
    assert "--config.training.batch" in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (KeyboardInterrupt(), 130, "resume with --resume"),
        (RuntimeError("a robot did not stand"), 2, "surefoot: a robot did not stand"),
        (OSError("disk full"), 2, "surefoot: disk full"),
    ],
)
def test_an_exception_sets_the_exit_status(surefoot, monkeypatch, capsys, error, status, message):
    def command() -> int:
        raise error

    monkeypatch.setattr(main_module, "parse", lambda args: command)
    assert surefoot("walk") == status
    assert message in capsys.readouterr().err


def test_a_traceback_is_shown_where_it_is_asked_for(surefoot, monkeypatch):
    monkeypatch.setenv("SUREFOOT_TRACEBACK", "1")
    with pytest.raises(ValueError, match="needs the name of a method"):
        surefoot("train")


@pytest.mark.parametrize("status", [0, 1])
def test_the_result_of_a_command_is_the_exit_status(surefoot, monkeypatch, status):
    monkeypatch.setattr(main_module, "parse", lambda args: lambda: status)
    assert surefoot("walk") == status
