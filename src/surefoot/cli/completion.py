"""The command completion: a script with which the shell completes commands, options and values.

The script holds all words and starts no program, so that Tab answers at once. It is written anew by
each version: `source <(surefoot completion bash)` in a start-up file is always right. tyro's own
scripts know one command's options; here each command is read when it is named (`cli.main`).
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from surefoot.cli.arguments import (
    option_choices,
    option_sizes,
    positional_choices,
)
from surefoot.cli.options import OnGait, OnRobot, OnTerrain
from surefoot.cli.robot import ShowRobot
from surefoot.cli.study import ACTIONS, Study
from surefoot.cli.train import Train
from surefoot.config import METHODS
from surefoot.config.gait_table import GAITS
from surefoot.config.presets import PRESETS
from surefoot.config.robot_table import ROBOTS
from surefoot.config.studies import STUDIES

Shell = Literal["bash", "zsh", "fish"]
"""The shells that there is a script for."""


@dataclass(frozen=True)
class Completion:
    """Print a script that completes commands, options and values with the Tab key.

    For bash, put `source <(surefoot completion bash)` into ~/.bashrc; for zsh, put the same with
    zsh into ~/.zshrc, below compinit; for fish, run `surefoot completion fish >
    ~/.config/fish/completions/surefoot.fish`.
    """

    shell: Annotated[Shell, tyro.conf.Positional]
    """The shell."""

    def __call__(self) -> int:
        """Print the script."""
        print(completion_script(self.shell), end="")
        return 0


@dataclass(frozen=True)
class Words:
    """What may follow the name of a command.

    Attributes:
        summary: What the command does, in a line.
        options: Names of its options, with their dashes.
        values: The values of each option that takes one of a few words.
        flags: Names of the options that take no value.
        positional: The words that a positional argument may be; a path where there are none.
    """

    summary: str
    options: tuple[str, ...]
    values: Mapping[str, tuple[str, ...]]
    flags: frozenset[str]
    positional: tuple[str, ...] = ()


def completion_script(shell: Shell) -> str:
    """The script for a shell.

    Args:
        shell: Name of the shell.
    """
    from surefoot.cli.main import COMMANDS

    table = {name: words_of(entry.command, entry.summary) for name, entry in COMMANDS.items()}
    if shell == "fish":
        return _fish(table)
    if shell == "zsh":
        return _ZSH + _bash(table)
    return _bash(table)


def words_of(command: type, summary: str) -> Words:
    """What may follow the name of a command.

    Args:
        command: Dataclass of the command.
        summary: What it does, in a line.
    """
    sizes = option_sizes(command)
    values = option_choices(command)
    if issubclass(command, OnGait):
        values["--gait"] = tuple(GAITS)
    if issubclass(command, OnRobot):
        values["--robot"] = tuple(ROBOTS)
    if issubclass(command, OnTerrain):
        values["--terrain"] = ("flat", "bumps:0.03", "blocks:0.03", "slope:10", "stairs:0.03")
    if "--preset" in sizes:
        values["--preset"] = tuple(PRESETS)
    positional = positional_choices(command)
    if issubclass(command, Train):
        positional = tuple(METHODS)
    elif issubclass(command, ShowRobot):
        positional = tuple(ROBOTS)
    elif issubclass(command, Study):
        positional = (*ACTIONS, *STUDIES)
    flags = frozenset(name for name, size in sizes.items() if size == 0)
    return Words(summary, (*sizes, "--help"), values, flags | {"--help"}, positional)


_ZSH = """#compdef surefoot
autoload -U +X bashcompinit && bashcompinit
"""
"""What lets zsh read a script for bash."""

_BASH = """# Completion of surefoot for bash; `surefoot completion bash` prints it.
_surefoot() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}"
    local before="${{COMP_WORDS[COMP_CWORD-1]}}"
    local words=""
    COMPREPLY=()
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    elif [ "${{current#-}}" != "$current" ]; then
        case "${{COMP_WORDS[1]}}" in
{options}
        esac
    else
        case "${{COMP_WORDS[1]}} $before" in
{values}
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$current"))
}}
complete -o default -F _surefoot surefoot
"""
"""The script for bash. Where no word fits, the shell completes names of files."""


def _bash(table: Mapping[str, Words]) -> str:
    """The script for bash."""
    options = [
        f'            {name}) words="{" ".join(words.options)}" ;;' for name, words in table.items()
    ]
    values: list[str] = []
    for name, words in table.items():
        for option, choices in words.values.items():
            values.append(f'            "{name} {option}") words="{" ".join(choices)}" ;;')
        # What follows an option that takes a value is no positional argument.
        takers = sorted(set(words.options) - words.flags - set(words.values))
        if words.positional:
            if takers:
                patterns = "|".join(f'"{name} {option}"' for option in takers)
                values.append(f"            {patterns}) ;;")
            values.append(f'            "{name} "*) words="{" ".join(words.positional)}" ;;')
    return _BASH.format(
        commands=" ".join(table), options="\n".join(options), values="\n".join(values)
    )


def _fish(table: Mapping[str, Words]) -> str:
    """The script for fish: a line for each option, with the commands that have it."""
    lines = [
        "# Completion of surefoot for fish; `surefoot completion fish` prints it.",
        "complete -c surefoot -e",
    ]
    for name, words in table.items():
        summary = shlex.quote(words.summary)
        lines.append(f"complete -c surefoot -n __fish_use_subcommand -f -a {name} -d {summary}")
        if words.positional:
            choices = shlex.quote(" ".join(words.positional))
            lines.append(f"complete -c surefoot {_within((name,))} -a {choices}")
    owners: dict[tuple[str, bool, tuple[str, ...]], list[str]] = {}
    for name, words in table.items():
        for option in words.options:
            key = (option, option in words.flags, words.values.get(option, ()))
            owners.setdefault(key, []).append(name)
    for (option, is_flag, choices), names in owners.items():
        line = f"complete -c surefoot {_within(tuple(names))} -l {option[2:]}"
        if choices:
            line += f" -x -a {shlex.quote(' '.join(choices))}"
        elif not is_flag:
            line += " -r"
        lines.append(line)
    return "\n".join(lines) + "\n"


def _within(names: tuple[str, ...]) -> str:
    """Fish's condition that one of these commands was named."""
    return f"-n '__fish_seen_subcommand_from {' '.join(names)}'"
