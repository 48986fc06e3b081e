"""The command line: which command runs, with which options, and how its errors are shown.

A command is a dataclass in a file of its own: its fields are the options, its docstring is the help
text, and calling it does the work and returns the exit status. Next: `command_line`, `options`.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Protocol

from surefoot.cli.bench import Bench
from surefoot.cli.check import Check
from surefoot.cli.command_line import read_options
from surefoot.cli.compare import Compare, parse_compare
from surefoot.cli.completion import Completion
from surefoot.cli.demo import Demo
from surefoot.cli.doctor import Doctor
from surefoot.cli.evaluate import Evaluate, parse_evaluate
from surefoot.cli.export import Export
from surefoot.cli.export_data import ExportData
from surefoot.cli.fit import Fit, parse_fit
from surefoot.cli.gate_warnings import MeasureWarnings
from surefoot.cli.import_data import ImportData
from surefoot.cli.learn import Learn, parse_learn
from surefoot.cli.play import Play
from surefoot.cli.prepare import Prepare, parse_prepare
from surefoot.cli.progress import log_shown
from surefoot.cli.report import Report
from surefoot.cli.robot import ShowRobot
from surefoot.cli.run import RunPolicy
from surefoot.cli.streams import failure_of, lasting_output
from surefoot.cli.study import Study
from surefoot.cli.survey import Survey
from surefoot.cli.terrains import Terrains
from surefoot.cli.train import Train, parse_train
from surefoot.cli.twin import RunTwin
from surefoot.cli.view import View
from surefoot.cli.walk import Walk, parse_walk
from surefoot.errors import interrupt_behind, unknown
from surefoot.files import WriteError


class Subcommand(Protocol):
    """What the command line runs."""

    def __call__(self) -> int:
        """Do the work; the result is the exit status."""
        ...


@dataclass(frozen=True)
class Entry:
    """A line of the overview.

    Attributes:
        command: Dataclass of the command.
        summary: What the command does, in at most 64 characters.
        parse: Function that reads its options, if their defaults depend on other options.
        memory: The options that decide how much memory it takes, in words, if there are any.
        resume: What is not lost if it ends early, and how to go on; empty if it begins anew.
    """

    command: type[Subcommand]
    summary: str
    parse: Callable[[Sequence[str]], Subcommand] | None = None
    memory: str = ""
    resume: str = ""


COMMANDS = {
    "doctor": Entry(Doctor, "Check this machine, and say how to fix what is broken."),
    "demo": Entry(
        Demo,
        "Train a policy in minutes, measure it, and film it.",
        resume="what is finished is on disk: the same command goes on",
    ),
    "walk": Entry(Walk, "Let the expert walk, and film it.", parse_walk, memory="--seconds"),
    "train": Entry(
        Train,
        "Train a policy with one of the six methods.",
        parse_train,
        memory="--config.chunk, the durations of --config.method, or --workers",
        resume="what is finished is on disk: go on with --resume",
    ),
    "evaluate": Entry(
        Evaluate,
        "Measure robustness and tracking of a policy and the expert.",
        parse_evaluate,
        memory="--episodes or --workers",
    ),
    "compare": Entry(
        Compare,
        "Compare the policies of several runs, and the expert.",
        parse_compare,
        memory="--episodes or --workers",
        resume="with --json FILE the same command goes on where it ended",
    ),
    "play": Entry(Play, "Film a policy, or a recorded episode of a run.", memory="--seconds"),
    "view": Entry(View, "Drive a robot in the browser, or scrub a run's episodes."),
    "export": Entry(Export, "Write a policy to an ONNX file that says all about itself."),
    "check": Entry(Check, "Verify an exported policy, and replay what a robot logged."),
    "study": Entry(
        Study,
        "Run many trainings and measurements, and see how far they are.",
        resume="the same command goes on with it",
    ),
    "report": Entry(Report, "Make one HTML page of a study, or of a run."),
    "gate-warnings": Entry(
        MeasureWarnings,
        "Measure how early the gates of a run warn of falls.",
        memory="--episodes or --workers",
    ),
    "robot": Entry(ShowRobot, "Check a robot's description, and draw it."),
    "import-data": Entry(ImportData, "Make a dataset of your own expert's or robot's logs."),
    "fit": Entry(
        Fit,
        "Train a policy on a dataset, such as an imported one.",
        parse_fit,
        memory="--config.training.memory",
        resume="finished epochs are on disk: the same command goes on",
    ),
    "export-data": Entry(ExportData, "Write a run's dataset for Minari or LeRobot."),
    "prepare": Entry(
        Prepare,
        "Measure what a robot, a gait and a box of commands need.",
        parse_prepare,
        memory="--config",
        resume="the same command begins again, with the gains that are measured",
    ),
    "survey": Entry(
        Survey,
        "Measure each robot in each gait, and make one table of it.",
        memory="--workers",
        resume="the same command goes on with the next robot or gait",
    ),
    "terrains": Entry(
        Terrains,
        "Measure policies and the expert on several grounds.",
        memory="--episodes or --workers",
        resume="with --json FILE the same command goes on where it ended",
    ),
    "run": Entry(RunPolicy, "Drive a robot behind a bridge, and fail safely."),
    "learn": Entry(
        Learn,
        "Learn on a robot behind a bridge, and fail safely.",
        parse_learn,
        memory="the durations of --config.method",
        resume="what is finished is on disk: the same command goes on with it",
    ),
    "twin": Entry(RunTwin, "Simulate a robot behind a bridge."),
    "bench": Entry(
        Bench,
        "Measure throughput, compared with lower bounds.",
        memory="--config.chunk, --episodes or --workers",
        resume="`bench expert --json FILE` goes on where it ended",
    ),
    "completion": Entry(Completion, "Print a script for the Tab key: bash, zsh or fish."),
}
"""All commands, by name."""


def parse(args: Sequence[str]) -> Subcommand:
    """The command that an argument list asks for.

    Args:
        args: Command line, without the name of the program.

    Raises:
        ValueError: There is no such command, or no such method or preset of `train`.
        SystemExit: Help was asked for, or an option is wrong.
    """
    if not args:
        print(FIRST_STEPS, file=sys.stderr)
        raise SystemExit(2)
    name = args[0]
    if name in ("-h", "--help", "help"):
        if name == "help" and args[1:] and args[1] in COMMANDS:
            return parse([args[1], "--help"])
        print(overview())
        raise SystemExit(0)
    if name == "--version":
        print(f"surefoot {version('surefoot')}")
        raise SystemExit(0)
    if name not in COMMANDS:
        raise ValueError(unknown("command", name, COMMANDS))
    entry = COMMANDS[name]
    if entry.parse is not None:
        return entry.parse(args[1:])
    return read_options(entry.command, args[1:], f"surefoot {name}")


FIRST_STEPS = """\
surefoot distills a model predictive controller into a 1 kHz policy for a legged robot, safely.

Begin with:
  surefoot doctor              is this machine ready, and what would each extra add?
  surefoot play                film the policy that comes with the package (seconds)
  surefoot demo                train a policy, measure it, film it (minutes; --robot go2)
  surefoot walk --gait bound   let the expert walk, in another gait
  surefoot view                drive a robot in the browser, and push it (extra viz)

Then train with `surefoot train loco_safe_dagger`, for any robot, gait and commands, or with an MPC
of your own from Python. `surefoot --help` lists all commands, `surefoot COMMAND --help` the options
of one, and `surefoot completion --help` says how the Tab key completes them."""
"""What a user sees who has named no command. The first plan on a machine compiles, for a minute."""


def overview() -> str:
    """The first help screen: one line for each command."""
    lines = ["usage: surefoot COMMAND [OPTIONS]; COMMAND --help lists options and JSON keys", ""]
    for name, entry in COMMANDS.items():
        lines.append(f"  {name:<14}{entry.summary}")
    return "\n".join(lines)


def main() -> int:
    """Run the command that the command line names.

    Returns:
        0 if all is done, 1 if the robot fell or something is broken, 2 after bad input, 130 if the
        command was interrupted. If all is done, but what it prints could not be written, 141 where
        the reader has closed it and 2 otherwise; files are written nevertheless.
    """
    with plain_warnings(), lasting_output() as output:
        status = run_command(sys.argv[1:])
        output.flush()
        failure = failure_of(output)
        if isinstance(failure, BrokenPipeError):  # such as `head`, which wants no more of it
            return status or 141
        if failure is not None:
            print(f"surefoot: what it prints could not be written ({failure})", file=sys.stderr)
            return status or 2
        return status


EXPECTED = (ValueError, ArithmeticError, OSError, ImportError, RuntimeError, MemoryError)
"""Errors that say by themselves what is wrong; any other is a defect, and shows a traceback."""


def run_command(args: Sequence[str]) -> int:
    """Run a command, and show its errors.

    Args:
        args: Command line, without the name of the program.

    Returns:
        The exit status.
    """
    entry = COMMANDS.get(args[0]) if args else None
    try:
        with log_shown():
            return parse(args)()
    except SystemExit as stop:  # after help
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    except KeyboardInterrupt:
        return _interrupted(entry)
    except Exception as error:
        if interrupt_behind(error) is not None:
            if isinstance(error, OSError):  # such as a disk that was full when the work ended
                print(f"surefoot: {error}", file=sys.stderr)
            return _interrupted(entry)
        if os.environ.get("SUREFOOT_TRACEBACK") or not isinstance(error, EXPECTED):
            raise
        print(f"surefoot: {_message(error, entry)}", file=sys.stderr)
        return 2


@contextmanager
def plain_warnings() -> Iterator[None]:
    """Show warnings as a user reads them, unless tracebacks are asked for, until it is left."""
    before = warnings.formatwarning
    if not os.environ.get("SUREFOOT_TRACEBACK"):
        warnings.formatwarning = plain_warning
    try:
        yield
    finally:
        warnings.formatwarning = before


def plain_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    line: str | None = None,
) -> str:
    """Return a warning as a user reads it, without the code that gave it.

    Args:
        message: The warning.
        category: Its class.
        filename: The file of the code.
        lineno: The line of the code.
        line: The code.
    """
    return f"surefoot: warning: {message}\n"


def _interrupted(entry: Entry | None) -> int:
    """Say that a command was interrupted; return its exit status."""
    print(f"\ninterrupted{_advice(entry)}", file=sys.stderr)
    return 130


def _message(error: Exception, entry: Entry | None) -> str:
    """Why a command failed, and what to do about it where the error itself does not say."""
    if isinstance(error, MemoryError):
        advice = f"; ask for less with {entry.memory}" if entry and entry.memory else ""
        return f"there is not enough memory ({error}){advice}"
    if isinstance(error, WriteError):
        return f"{error}{_advice(entry)}"
    return str(error)


def _advice(entry: Entry | None) -> str:
    """What is not lost of a command that ended early, and how to go on."""
    return f"; {entry.resume}" if entry and entry.resume else ""
