"""The command line: which command runs, with which options, and how its errors are shown.

A command is a dataclass in a file of its own: its fields are the options, its docstring is the help
text, and calling it does the work and returns the exit status. Next: `command_line`, `options`.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from surefoot.cli.bench import Bench
from surefoot.cli.command_line import read_options
from surefoot.cli.compare import Compare, parse_compare
from surefoot.cli.doctor import Doctor
from surefoot.cli.evaluate import Evaluate, parse_evaluate
from surefoot.cli.gate_warnings import MeasureWarnings
from surefoot.cli.make_starts import MakeStarts
from surefoot.cli.play import Play
from surefoot.cli.progress import log_shown
from surefoot.cli.study import Study
from surefoot.cli.train import Train, parse_train
from surefoot.cli.walk import Walk
from surefoot.errors import unknown


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
    """

    command: type[Subcommand]
    summary: str


COMMANDS = {
    "doctor": Entry(Doctor, "Check this machine, and say how to fix what is broken."),
    "walk": Entry(Walk, "Let the expert walk, and film it."),
    "train": Entry(Train, "Train a policy with one of the six methods."),
    "evaluate": Entry(Evaluate, "Measure robustness and tracking of a policy and the expert."),
    "compare": Entry(Compare, "Compare the policies of several runs, and the expert."),
    "play": Entry(Play, "Film a policy, or a recorded episode of a run."),
    "study": Entry(Study, "Run many trainings and measurements, and see how far they are."),
    "gate-warnings": Entry(MeasureWarnings, "Measure how early the gates of a run warn of falls."),
    "make-starts": Entry(MakeStarts, "Make a new set of initial states."),
    "bench": Entry(Bench, "Measure throughput, compared with lower bounds."),
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
        print(overview(), file=sys.stderr)
        raise SystemExit(2)
    name = args[0]
    if name in ("-h", "--help"):
        print(overview())
        raise SystemExit(0)
    if name not in COMMANDS:
        raise ValueError(unknown("command", name, COMMANDS))
    if name == "train":
        return parse_train(args[1:])
    if name == "evaluate":
        return parse_evaluate(args[1:])
    if name == "compare":
        return parse_compare(args[1:])
    return read_options(COMMANDS[name].command, args[1:], f"surefoot {name}")


def overview() -> str:
    """The first help screen: one line for each command."""
    lines = ["usage: surefoot COMMAND [OPTIONS]", "", "commands:"]
    for name, entry in COMMANDS.items():
        lines.append(f"  {name:<14}{entry.summary}")
    lines += ["", "`surefoot COMMAND --help` lists the options of a command, and its JSON keys."]
    return "\n".join(lines)


def main() -> int:
    """Run the command that the command line names.

    Returns:
        0 if all is done, 1 if the robot fell or something is broken, 2 after bad input, 130 if the
        command was interrupted, 141 if the reader of the output closed it.
    """
    # A cluster's batch system asks to stop with SIGTERM: stop as after Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with log_shown():
            return parse(sys.argv[1:])()
    except KeyboardInterrupt:
        print(
            "\ninterrupted; what is finished is on disk (train: resume with --resume)",
            file=sys.stderr,
        )
        return 130
    except BrokenPipeError:  # the reader of the output, such as `head`, wants no more of it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (ValueError, ArithmeticError, OSError, ImportError, RuntimeError) as error:
        if os.environ.get("SUREFOOT_TRACEBACK"):
            raise
        print(f"surefoot: {error}", file=sys.stderr)
        return 2
