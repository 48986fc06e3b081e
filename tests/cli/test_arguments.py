"""Positional arguments are told from values of options, as tyro does."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import pytest
import tyro

from surefoot.cli.arguments import (
    ANY_NUMBER,
    option_choices,
    option_sizes,
    positional_choices,
    sort_arguments,
)
from surefoot.cli.train import Train
from surefoot.config import METHODS


@dataclass(frozen=True)
class Arm:
    long_name: float = 0.0
    bent: bool = False


@dataclass(frozen=True)
class Leg:
    range: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True)
class Toy:
    target: Annotated[str, tyro.conf.Positional]
    limb: Arm | Leg
    file: Path | None = None
    names: tuple[str, ...] = ()
    dry: bool = False


def test_the_number_of_values_follows_from_the_type():
    assert option_sizes(Toy) == {
        "--limb.long-name": 1,
        "--limb.bent": 0,
        "--limb.no-bent": 0,
        "--limb.range": 2,
        "--file": 1,
        "--names": ANY_NUMBER,
        "--dry": 0,
        "--no-dry": 0,
    }


@pytest.mark.parametrize(
    ("args", "positional"),
    [
        ("a", "a"),
        ("--dry a", "a"),
        ("--no-dry a", "a"),
        ("--limb.bent a", "a"),
        ("--limb.no-bent a", "a"),
        ("--file a", ""),
        ("--file a b", "b"),
        ("--file=a b", "b"),
        ("--limb.long-name -0.5 a", "a"),
        ("--limb.long_name 0.5 a", "a"),
        ("--limb.range -1 2 a", "a"),
        ("--names a b --dry c", "c"),
        ("--names --dry a", "a"),
        ("a --names b c", "a"),
        ("-h a", "a"),
        ("--file", ""),
    ],
)
def test_values_of_options_are_not_positional(args, positional):
    arguments = sort_arguments(args.split(), Toy)
    assert arguments.positional == tuple(positional.split())
    assert not arguments.unknown


def test_values_and_unknown_options_are_named():
    arguments = sort_arguments(
        ["--file=a", "--fil", "b", "--limb.range", "1", "2", "--file", "c", "d"], Toy
    )
    assert arguments.values == {"--file": ["c"], "--fil": ["b"], "--limb.range": ["1", "2"]}
    assert arguments.unknown == ("--fil",)
    assert arguments.positional == ("d",)


def test_the_options_of_train_are_those_that_tyro_has(surefoot, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")  # wide enough for each option's line
    flags = set()
    with_values = set()
    for method in METHODS:
        assert surefoot("train", method, "--help") == 0
        for line in capsys.readouterr().out.splitlines():
            words = line.strip("│ ").replace(",", "").split()
            if re.match(r"--\w", " ".join(words)):
                if words[-1].startswith("--"):
                    flags |= set(words)
                else:
                    with_values.add(words[0])
    sizes = option_sizes(Train)
    assert flags == {name for name, size in sizes.items() if size == 0}
    assert with_values == {name for name, size in sizes.items() if size > 0}


def test_options_keep_their_values_apart_from_what_is_positional():
    args = [
        "--vx",
        "-0.5",
        "1.0",
        "dagger",
        "--config.collection.impulse",
        "0.5",
        "1.5",
        "--resume",
    ]
    arguments = sort_arguments(args, Train)
    assert arguments.positional == ("dagger",)
    assert arguments.options == tuple(arg for arg in args if arg != "dagger")
    assert option_sizes(Train)["--config.safety.com-height"] == 2


@pytest.mark.parametrize(
    ("args", "positional"),
    [
        ("--config.collection.impulse None loco_dagger", "loco_dagger"),
        ("--config.collection.impulse 0.5 1.5 loco_dagger", "loco_dagger"),
        ("--vx None loco_dagger", "loco_dagger"),
        ("--gaits None loco_dagger", "loco_dagger"),
        ("--config.commands.vx None loco_dagger", ""),  # these may not be None
    ],
)
def test_none_is_the_only_value_of_an_option_that_may_be_none(args, positional):
    assert sort_arguments(args.split(), Train).positional == tuple(positional.split())


@dataclass(frozen=True)
class Choosing:
    place: Annotated[Literal["here", "there"] | None, tyro.conf.Positional]
    color: Literal["red", "blue"] | None = None
    days: tuple[Literal["Monday", "Friday"], ...] = ()
    limb: Arm | Leg = Arm()


def test_words_to_choose_from_follow_from_the_type():
    assert option_choices(Choosing) == {
        "--color": ("red", "blue"),
        "--days": ("Monday", "Friday"),
    }
    assert positional_choices(Choosing) == ("here", "there")
    assert positional_choices(Toy) == ()


@pytest.mark.parametrize("args", [["--vx", "0.3"], ["--vx"], ["--vx", "0.3", "--vy", "0", "1"]])
def test_an_option_of_two_numbers_that_has_one_is_said_in_words(args):
    with pytest.raises(ValueError, match=r"--vx takes 2 values, such as --vx 0 0\.3; this has"):
        sort_arguments(args, Train)


@pytest.mark.parametrize("help_option", ["-h", "--help"])
def test_help_is_heard_wherever_it_is_asked_for(help_option):
    assert sort_arguments(["--vx", help_option], Train).options == ("--vx", help_option)
    assert sort_arguments(["--gaits", "trot", help_option], Train).values == {"--gaits": ["trot"]}
