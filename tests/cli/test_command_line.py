"""Options are read as tyro reads them, and the help fits the width of the terminal."""

from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import pytest
import tyro

from surefoot.cli.command_line import filled, read_options
from surefoot.cli.main import COMMANDS
from surefoot.config import METHODS, Config
from surefoot.config.field_docs import field_docstrings
from tests.cases import first_often


@dataclass(frozen=True)
class Part:
    """A part of a toy."""

    size: float = 1.0
    """Its size, which takes so many words to describe that the source needs
    a second line."""


@dataclass(frozen=True)
class Base:
    count: int
    """How many there are."""


@dataclass(frozen=True)
class Toy(Base):
    """A toy with a description that takes so many words that it needs
    a second line.

    Keys: one,
    two.
    """

    name: str
    """The name."""
    file: Path | None = None
    small: Part = field(default_factory=Part)


def test_options_have_the_defaults_of_the_dataclass():
    assert read_options(Toy, ["--name", "a", "--count", "2"], "toy") == Toy(2, "a")
    args = ["--name", "a", "--small.size", "3", "--file", "b", "--count", "5"]
    assert read_options(Toy, args, "toy") == Toy(5, "a", Path("b"), Part(3.0))


def test_options_have_the_defaults_of_an_instance():
    default = Toy(7, "a", Path("b"), Part(5.0))
    assert read_options(Toy, [], "toy", default) == default


def test_an_option_without_a_default_is_required(capsys):
    with pytest.raises(SystemExit):
        read_options(Toy, [], "toy")
    assert "--name" in capsys.readouterr().err


def test_docstrings_of_fields_are_joined_with_those_of_bases():
    assert field_docstrings(Toy) == {"count": "How many there are.", "name": "The name."}
    assert field_docstrings(Part)["size"].endswith("that the source needs a second line.")


def test_paragraphs_are_filled_and_indented():
    assert filled("One two\n    three four.\n\n    Five.\n    ", 13) == (
        "One two three\n  four.\n\nFive."
    )


def test_the_help_keeps_no_line_break_of_the_source(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    with pytest.raises(SystemExit):
        read_options(Toy, ["--help"], "toy")
    text = capsys.readouterr().out
    assert "\nA toy with a description that takes so many words that it\n  needs" in text
    assert "\nKeys: one, two.\n" in text
    joined = " ".join(text.replace("│", " ").split())
    assert "so many words to describe that the source needs a second line. (default: 1.0)" in joined
    lines = [line.strip("│ ") for line in text.splitlines()]
    assert "a second line. (default: 1.0)" not in lines  # it would begin a line of its own


# Every command in a narrow terminal, and one of them in a wide one.
@pytest.mark.parametrize(
    ("columns", "command"),
    first_often(len(COMMANDS) + 1, [*product([80], COMMANDS), *product([120], COMMANDS)]),
)
def test_each_command_has_help_of_its_own_that_fits_the_terminal(
    surefoot, capsys, monkeypatch, command, columns
):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert surefoot(command, "--help") == 0
    text = capsys.readouterr().out
    assert text.startswith(f"usage: surefoot {command} ")
    assert "options" in text
    assert "\n\n\n" not in text
    lines = text.splitlines()
    assert max(len(line) for line in lines) <= columns


@pytest.mark.parametrize("method", first_often(2, METHODS))
def test_a_union_is_decided_by_the_default(method):
    default = Config(method=METHODS[method]())
    config = tyro.conf.AvoidSubcommands[Config]
    assert read_options(Config, [], "config", default) == tyro.cli(config, args=[], default=default)
