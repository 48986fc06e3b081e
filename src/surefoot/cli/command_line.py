"""Reads a command's options with tyro, and lays its help out for the width of the terminal.

tyro keeps the line breaks that a field's docstring has in the source, and does not wrap the text
above the options. Both are joined or filled here. Next: `arguments`.
"""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from inspect import cleandoc
from typing import Annotated, Any, TypeVar, get_args, get_origin

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    StructConstructorSpec,
    StructFieldSpec,
    StructTypeInfo,
)

from surefoot.cli.arguments import sort_arguments
from surefoot.config.checked import annotations_of
from surefoot.config.field_docs import field_docstrings

CommandKind = TypeVar("CommandKind")

_registry = ConstructorRegistry()


def read_options(
    command: type[CommandKind],
    args: Sequence[str],
    program: str,
    default: CommandKind | None = None,
) -> CommandKind:
    """A command with the options of a command line.

    Args:
        command: Dataclass of the command.
        args: Command line, without the name of the command.
        program: Name of the program and of the command.
        default: A command that has the defaults; without it those of the dataclass.

    Raises:
        SystemExit: Help was asked for, or an option is wrong.
        ValueError: An option of several numbers has fewer.
    """
    description = filled(command.__doc__ or "", shutil.get_terminal_size().columns)
    # tyro takes all that follows an option of two numbers, or None, for values of it.
    arguments = sort_arguments(args, command)
    with _registry:
        options: CommandKind | None = tyro.cli(
            command,
            args=[*arguments.positional, *arguments.options],
            prog=program,
            description=description,
            default=default,
            config=(tyro.conf.AvoidSubcommands,),
        )
    if options is None:  # tyro's types allow it where a default may be None
        raise ValueError(f"{program} has no options")
    return options


def filled(text: str, width: int) -> str:
    """The paragraphs of a docstring, filled to a width, with all but their first line indented.

    The indentation tells tyro not to join the lines again.

    Args:
        text: The docstring.
        width: Number of characters of the longest line.
    """
    paragraphs = [" ".join(paragraph.split()) for paragraph in cleandoc(text).split("\n\n")]
    return "\n\n".join(
        textwrap.fill(paragraph, width, subsequent_indent="  ", break_on_hyphens=False)
        for paragraph in paragraphs
    )


@_registry.struct_rule
def _dataclass_rule(info: StructTypeInfo) -> StructConstructorSpec | None:
    """What tyro does with a dataclass, but for its fields' docstrings, whose lines are joined."""
    kind = info.type
    if not (isinstance(kind, type) and is_dataclass(kind)):
        return None
    hints = annotations_of(kind)
    docs = field_docstrings(kind)
    return StructConstructorSpec(
        instantiate=kind,
        fields=tuple(
            StructFieldSpec(
                name=field.name,
                type=_shown(hints[field.name]),
                default=_default_of(field, info.default),
                helptext=docs.get(field.name),
            )
            for field in fields(kind)
        ),
    )


def _shown(hint: Any) -> Any:
    """The type of an option; any number of records are not written on a command line, but made."""
    kinds = get_args(hint)
    of_records = get_origin(hint) is tuple and is_dataclass(kinds[0])
    return Annotated[hint, tyro.conf.Fixed, tyro.conf.Suppress] if of_records else hint


def _default_of(field: Field, instance: object) -> object:
    """The default of a field: that of an instance, if there is one, or the dataclass's own."""
    if is_dataclass(instance):
        return getattr(instance, field.name)
    if field.default is not MISSING:
        return field.default
    if field.default_factory is not MISSING:
        return field.default_factory()
    return tyro.MISSING
