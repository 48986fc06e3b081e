"""How many values each option of a command takes, derived from the types of its fields.

The defaults of some options depend on other arguments (those of `train` on the method and the
preset), so these have to be known before tyro parses the command line, wherever they stand.
``train --config.method.pretraining.nominal dagger`` names a method, but ``train --run dagger`` a
folder. Next: `train`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from itertools import takewhile
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import tyro

from surefoot.config.checked import annotations_of

ANY_NUMBER = 1_000_000
"""The number of values of an option that takes as many as there are."""


@dataclass(frozen=True)
class Arguments:
    """What a command line consists of.

    Attributes:
        positional: Arguments that are neither options nor values of options.
        values: Values of each option that has any, by the option's name; as for tyro, an option
            that is given again has the later ones.
        unknown: Options that the command does not have.
        options: All options with their values.
    """

    positional: tuple[str, ...]
    values: dict[str, list[str]]
    unknown: tuple[str, ...]
    options: tuple[str, ...]


def sort_arguments(args: Sequence[str], command: type) -> Arguments:
    """Tell positional arguments from options and their values.

    Args:
        args: Command line, without the name of the command.
        command: Dataclass of the command, whose fields are its options.

    Raises:
        ValueError: An option of two numbers or more has fewer.
    """
    sizes = {"-h": 0, "--help": 0} | option_sizes(command)
    asks_for_help = not {"-h", "--help"}.isdisjoint(args)
    # "None" is then the only word of the option's value.
    optional = {name for name, _, may_be_none in _options(command) if may_be_none}
    positional: list[str] = []
    values: dict[str, list[str]] = {}
    unknown: list[str] = []
    options: list[str] = []
    position = 0
    while position < len(args):
        argument = args[position]
        position += 1
        if not argument.startswith("-"):
            positional.append(argument)
            continue
        options.append(argument)
        name, equals, value = argument.partition("=")
        name = name.replace("_", "-")
        if name not in sizes:
            unknown.append(name)
        if equals:
            values[name] = [value]
            continue
        # An option that does not exist is refused later; most options take one value.
        size = sizes.get(name, 1)
        if name in optional and args[position : position + 1] == ["None"]:
            size = 1
        after = args[position : position + size]
        given = list(takewhile(lambda word: not word.startswith("--") and word != "-h", after))
        if 1 < size < ANY_NUMBER and len(given) < size and not asks_for_help:
            raise ValueError(
                f"{name} takes {size} values, such as {name} {' '.join('0' * (size - 1))} 0.3; "
                f"this has {len(given)}: {' '.join([argument, *given])}"
            )
        if given:
            values[name] = given
        options += given
        position += len(given)
    return Arguments(tuple(positional), values, tuple(unknown), tuple(options))


def option_sizes(command: type) -> dict[str, int]:
    """Number of values that each option of a command takes, by the option's name.

    A group that may be missing, as a robot's own description, comes from a file and is no option.

    Args:
        command: Dataclass whose fields are options; a field that is a dataclass is a group.
    """
    sizes: dict[str, int] = {}
    for name, kind, _ in _options(command):
        if kind is bool:
            sizes[name] = 0
            group, dot, last = name.rpartition(".")
            sizes[f"{group}{dot}no-{last}" if dot else f"--no-{name[2:]}"] = 0
        else:
            sizes[name] = _number_of_values(kind)
    return sizes


def option_choices(command: type) -> dict[str, tuple[str, ...]]:
    """The values of each option that takes one of a few words, by the option's name.

    Args:
        command: Dataclass whose fields are options.
    """
    words = {name: _words(kind) for name, kind, _ in _options(command)}
    return {name: choices for name, choices in words.items() if choices}


def positional_choices(command: type) -> tuple[str, ...]:
    """The words that a positional argument of a command may be, if it is one of a few.

    Args:
        command: Dataclass of the command.
    """
    hints = annotations_of(command)
    positional = [
        hints[field.name] for field in fields(command) if _is_positional(hints[field.name])
    ]
    return tuple(
        word for hint in positional for kind in _alternatives(hint) for word in _words(kind)
    )


@cache
def _options(command: type) -> tuple[tuple[str, Any, bool], ...]:
    """The name and the type of each option, and whether it may be None.

    Args:
        command: Dataclass whose fields are options.
    """
    return tuple(_options_of_group(command, ""))


def _options_of_group(group: type, prefix: str) -> Iterator[tuple[str, Any, bool]]:
    """The options of a command, or of a group of its options.

    An option comes once for each type that its value may have.

    Args:
        group: Dataclass whose fields are options.
        prefix: Dotted name of the group, with a dot at the end; empty for the command.
    """
    hints = annotations_of(group)
    for field in fields(group):
        hint = hints[field.name]
        if _is_positional(hint):
            continue
        name = field.name.replace("_", "-")
        may_be_none = type(None) in get_args(hint)
        for kind in _alternatives(hint):
            if get_origin(kind) is tuple and is_dataclass(get_args(kind)[0]):
                continue  # records that are made, not written
            if not (isinstance(kind, type) and is_dataclass(kind)):
                yield f"--{prefix}{name}", kind, may_be_none
            elif not may_be_none:
                yield from _options_of_group(kind, f"{prefix}{name}.")


def _is_positional(hint: Any) -> bool:
    """Whether a field is a positional argument."""
    return get_origin(hint) is Annotated and tyro.conf.Positional in get_args(hint)


def _words(kind: Any) -> tuple[str, ...]:
    """The words that a type consists of, also as the members of a tuple."""
    if get_origin(kind) is tuple:
        return _words(get_args(kind)[0])
    return tuple(map(str, get_args(kind))) if get_origin(kind) is Literal else ()


def _alternatives(hint: Any) -> tuple[Any, ...]:
    """The types that a value of a field may have, apart from None and without annotations."""
    if get_origin(hint) is Annotated:
        return _alternatives(get_args(hint)[0])
    if get_origin(hint) in (Union, UnionType):
        kinds = [kind for kind in get_args(hint) if kind is not type(None)]
        return tuple(each for kind in kinds for each in _alternatives(kind))
    return (hint,)


def _number_of_values(kind: Any) -> int:
    """Number of values that an option of a type takes."""
    if get_origin(kind) is not tuple:
        return 1
    parts = get_args(kind)
    return ANY_NUMBER if parts[-1] is Ellipsis else len(parts)
