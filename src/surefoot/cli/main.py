"""The command line: which command with which options. What it does: `commands`."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any

import tyro

from surefoot.cli.bench import Bench
from surefoot.cli.compare import Compare
from surefoot.cli.evaluate import Evaluate
from surefoot.cli.play import Play
from surefoot.cli.train import Train
from surefoot.cli.walk import Doctor, Walk
from surefoot.config import METHODS
from surefoot.config.presets import preset

Commands = (
    Annotated[Doctor, tyro.conf.subcommand("doctor")]
    | Annotated[Walk, tyro.conf.subcommand("walk")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Compare, tyro.conf.subcommand("compare")]
    | Annotated[Play, tyro.conf.subcommand("play")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
)

FLAGS = {"--resume", "--no-resume", "--tensorboard", "--no-tensorboard"}
"""Options of train that take no value: what follows them may be the method."""


def parse(args: Sequence[str]) -> Any:
    """The command of an argument list; a method and preset set the defaults of its options.

    Raises:
        ValueError: unknown method or preset.
    """
    if args[:1] == ["train"] and not {"-h", "--help"} & set(args[:2]):
        name, method = preset_argument(args), method_argument(args)
        default = Train(method, name, config=preset(method, name))
        kind = Annotated[Train, tyro.conf.AvoidSubcommands]
        return tyro.cli(kind, args=args[1:], default=default, prog="surefoot train")
    return tyro.cli(Annotated[Commands, tyro.conf.AvoidSubcommands], args=args, prog="surefoot")


def method_argument(args: Sequence[str]) -> str:
    """The method, wherever it stands among the options.

    Raises:
        ValueError: there is none.
    """
    options_with_value = {a for a in args if a.startswith("--") and "=" not in a} - FLAGS
    for before, value in pairwise(args):
        if value in METHODS and before not in options_with_value:
            return value
    if len(args) > 1 and not args[1].startswith("-"):
        return args[1]
    raise ValueError(f"train what? Name a method: {', '.join(METHODS)}")


def preset_argument(args: Sequence[str]) -> str:
    """The value of --preset, `default` without it."""
    for option, value in zip(args, [*args[1:], ""], strict=True):
        if option == "--preset":
            return value
        if option.startswith("--preset="):
            return option.removeprefix("--preset=")
    return "default"


def main() -> int:
    """Entry point; 0 done, 1 the robot fell or something is broken, 2 bad input."""
    # A cluster's batch system asks to stop with SIGTERM: stop as after Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return parse(sys.argv[1:])()
    except KeyboardInterrupt:
        print(
            "\ninterrupted; what is finished is on disk (train: go on with --resume)",
            file=sys.stderr,
        )
        return 130
    except (ValueError, ArithmeticError, OSError, ImportError, RuntimeError) as error:
        if os.environ.get("SUREFOOT_TRACEBACK"):
            raise
        print(f"surefoot: {error}", file=sys.stderr)
        return 2
