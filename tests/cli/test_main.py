"""The command line as a whole: the overview, help, errors, exit status."""

import os
import re
import subprocess
import sys
import warnings
from importlib.metadata import version
from pathlib import Path

import pytest

import surefoot.cli.main as main_module
from surefoot.cli.compare import Compare
from surefoot.cli.doctor import Doctor, DoctorReport
from surefoot.cli.evaluate import Evaluate
from surefoot.cli.export import Export, ExportReport
from surefoot.cli.fit import Fit, FitReport
from surefoot.cli.gate_warnings import MeasureWarnings
from surefoot.cli.main import COMMANDS, FIRST_STEPS
from surefoot.cli.play import Play
from surefoot.cli.run import RunPolicy
from surefoot.cli.train import Train, TrainReport
from surefoot.cli.walk import Walk, WalkReport
from surefoot.deploy.drive import DriveReport
from surefoot.evaluation.gate_warnings import GateWarnings, RunWarnings
from surefoot.evaluation.report import EvaluationReport
from surefoot.files import WriteError
from surefoot.study.records import Comparison, Row
from surefoot.viz.replay import EpisodeReport

RESUME = "; what is finished is on disk: go on with --resume"
NO_MEMORY = "surefoot: there is not enough memory (1 PiB)"


def test_the_overview_fits_one_screen():
    child = subprocess.run(
        [sys.executable, "-m", "surefoot", "--help"],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "80"},
    )
    assert child.returncode == 0, child.stderr
    lines = child.stdout.splitlines()
    assert len(lines) <= 30
    assert max(len(line) for line in lines) <= 80
    described = [line.split()[0] for line in lines if line.startswith("  ")]
    assert described == list(COMMANDS)


def test_a_reader_that_stops_reading_is_no_error():
    command = [sys.executable, "-m", "surefoot", "walk", "--help"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        assert child.stdout is not None and child.stderr is not None
        child.stdout.close()
        assert child.stderr.read() == b""


def test_without_a_command_the_first_steps_are_an_error(surefoot, capsys):
    assert surefoot() == 2
    output = capsys.readouterr()
    assert output.err == FIRST_STEPS + "\n"
    assert not output.out
    named = re.findall(r"^  surefoot ([a-z-]+)", FIRST_STEPS, flags=re.MULTILINE)
    assert named == ["doctor", "play", "demo", "walk", "view"]
    assert set(named) <= set(COMMANDS)
    lines = FIRST_STEPS.splitlines()
    assert len(lines) <= 24 and max(map(len, lines)) <= 100


def test_a_wrong_command_lists_the_commands(surefoot, capsys):
    assert surefoot("evalute", "run") == 2
    error = capsys.readouterr().err
    assert "did you mean 'evaluate'" in error
    assert all(name in error for name in COMMANDS)


@pytest.mark.parametrize(
    ("command", "report"),
    [
        (Doctor, DoctorReport),
        (Fit, FitReport),
        (Export, ExportReport),
        (Walk, WalkReport),
        (Play, EpisodeReport),
        (Train, TrainReport),
        (Evaluate, EvaluationReport),
        (Compare, Comparison),
        (Compare, Row),
        (RunPolicy, DriveReport),
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
        (("walk", "--seconds", "1e12", "--no-video"), "--seconds 1e+12: use at least 0.001 s, and"),
        (("walk", "--seconds", "nan", "--no-video"), "--seconds nan: use at least 0.001 s, and at"),
        (("play", "nowhere", "--seconds", "1e12"), "at most 3600 s"),
        (("walk", "--out", "pic.png"), "--out: pic.png must end in .mp4"),
        (("walk", "--out", "."), "--out: '.' is an empty name, and cannot be written"),
        (
            ("walk", "--json", ""),
            "--json: '.' is an empty name, and cannot be",
        ),
        (("walk", "--json", "/"), "--json: '/' is a folder, and cannot be written; name a file"),
        (("play", "nowhere", "--json", "/"), "--json: '/' is a folder"),
        (("bench", "plan", "--json", "/"), "--json: '/' is a folder"),
        (("bench", "expert", "--json", "/"), "--json: '/' is a folder"),
        (("train", "dagger", "--json", "/"), "--json: '/' is a folder"),
        (("prepare", "--out", "set.txt"), "--out: set.txt must end in .npz"),
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


def hiding(error: Exception) -> Exception:
    """An error that hides Ctrl-C, as that of compiled code does."""
    error.__cause__ = KeyboardInterrupt()
    return error


def test_an_unknown_option_names_the_nearest(surefoot, capsys):
    assert surefoot("train", "behavior_cloning", "--config.trainig.batch", 3) == 2
    assert "--config.training.batch" in "".join(capsys.readouterr())


@pytest.mark.parametrize(
    ("name", "error", "status", "message"),
    [
        ("walk", KeyboardInterrupt(), 130, "\ninterrupted"),
        (
            "train",
            KeyboardInterrupt(),
            130,
            "\ninterrupted" + RESUME,
        ),
        ("walk", RuntimeError("a robot did not stand"), 2, "surefoot: a robot did not stand"),
        ("walk", OSError("disk full"), 2, "surefoot: disk full"),
        ("walk", WriteError("a is full"), 2, "surefoot: a is full"),
        (
            "train",
            WriteError("a is full"),
            2,
            "surefoot: a is full" + RESUME,
        ),
        (
            "walk",
            MemoryError("1 PiB"),
            2,
            NO_MEMORY + "; ask for less with --seconds",
        ),
        ("doctor", MemoryError("1 PiB"), 2, NO_MEMORY),
        ("twin", hiding(SystemError("a result with an exception set")), 130, "\ninterrupted"),
        ("train", hiding(ImportError("initialization failed")), 130, "\ninterrupted" + RESUME),
        ("walk", hiding(WriteError("a is full")), 130, "surefoot: a is full\n\ninterrupted"),
        ("walk", ImportError("it is not installed"), 2, "surefoot: it is not installed"),
    ],
)
def test_an_exception_sets_the_exit_status(
    surefoot, monkeypatch, capsys, name, error, status, message
):
    """And what is said of going on is true of the command."""

    def command() -> int:
        raise error

    monkeypatch.setattr(main_module, "parse", lambda args: command)
    assert surefoot(name) == status
    assert capsys.readouterr().err == f"{message}\n"


def test_a_defect_shows_its_traceback(surefoot, monkeypatch):
    def command() -> int:
        raise SystemError("a result with an exception set")

    monkeypatch.setattr(main_module, "parse", lambda args: command)
    with pytest.raises(SystemError):
        surefoot("walk")


PRINTING = """
import sys
import surefoot.cli.main as main

def command():
    for number in range(2000):
        print("10 m\\u00b2 a line", number)
    open(sys.argv[1], "w").write("done")
    return {status}

main.parse = lambda args: command
sys.exit(main.main())
"""


def run_printing(folder, status: int = 0, **options) -> tuple[int, bytes]:
    """Exit status and stderr of a command that prints much and then writes a file."""
    command = [sys.executable, "-c", PRINTING.format(status=status), str(folder / "file")]
    child = subprocess.run(command, stderr=subprocess.PIPE, **options)
    assert (folder / "file").read_text() == "done"
    return child.returncode, child.stderr


@pytest.mark.parametrize("status", [0, 1])
def test_a_reader_that_leaves_does_not_end_the_work(tmp_path, status):
    reader, writer = os.pipe()
    os.close(reader)
    result = run_printing(tmp_path, status, stdout=writer)
    os.close(writer)
    assert result == (status or 141, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_under_the_output_does_not_end_the_work(tmp_path):
    with open("/dev/full", "wb") as full:
        status, error = run_printing(tmp_path, stdout=full)
    assert status == 2
    assert error.startswith(b"surefoot: what it prints could not be written (")
    assert len(error.splitlines()) == 1


def test_characters_that_the_terminal_lacks_are_escaped(tmp_path):
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    with (tmp_path / "printed").open("wb") as printed:
        assert run_printing(tmp_path, stdout=printed, env=environment) == (0, b"")
    assert (tmp_path / "printed").read_bytes().startswith(rb"10 m\xb2 a line 0")


def test_a_traceback_is_shown_where_it_is_asked_for(surefoot, monkeypatch):
    monkeypatch.setenv("SUREFOOT_TRACEBACK", "1")
    with pytest.raises(ValueError, match="needs the name of a method"):
        surefoot("train")


def test_a_warning_is_shown_without_the_code_that_gave_it(surefoot, monkeypatch):
    shown = []
    before = warnings.formatwarning

    def command() -> int:
        shown.append(warnings.formatwarning(UserWarning("it is far"), UserWarning, "a.py", 3))
        return 0

    monkeypatch.setattr(main_module, "parse", lambda args: command)
    assert surefoot("doctor") == 0
    assert shown == ["surefoot: warning: it is far\n"]
    assert warnings.formatwarning is before


@pytest.mark.parametrize("status", [0, 1])
def test_the_result_of_a_command_is_the_exit_status(surefoot, monkeypatch, status):
    monkeypatch.setattr(main_module, "parse", lambda args: lambda: status)
    assert surefoot("walk") == status


def test_help_and_version_are_what_users_try_first(surefoot, capsys):
    assert surefoot("help") == 0
    assert "usage: surefoot COMMAND" in capsys.readouterr().out
    assert surefoot("help", "walk") == 0
    assert "usage: surefoot walk" in capsys.readouterr().out
    assert surefoot("--version") == 0
    assert capsys.readouterr().out == f"surefoot {version('surefoot')}\n"
