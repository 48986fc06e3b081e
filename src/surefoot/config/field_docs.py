"""The docstrings of a dataclass's fields, which the help of the command line and errors show.

A field's docstring is the string below it. Python does not keep it, so it is read from the source.
"""

from __future__ import annotations

import ast
import re
import textwrap
from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import cache
from inspect import getsource
from itertools import pairwise


@cache
def field_docstrings(kind: type) -> Mapping[str, str]:
    """The docstring of each field of a dataclass on one line, those of its bases included.

    Args:
        kind: The dataclass.
    """
    docstrings: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if not is_dataclass(base):
            continue
        try:
            [definition] = ast.parse(textwrap.dedent(getsource(base))).body
        except (OSError, SyntaxError):  # a program without its source, or with a changed one
            continue
        assert isinstance(definition, ast.ClassDef)
        for statement, following in pairwise(definition.body):
            match statement, following:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(ast.Constant(str(text))):
                    docstrings[name] = " ".join(text.split())
    return docstrings


def unit_of(kind: type, name: str) -> str:
    """The unit of a field, with which its docstring begins, as in "[m] height"; '' without one.

    Args:
        kind: The dataclass.
        name: The field.
    """
    found = re.match(r"\[([^]]+)\]", field_docstrings(kind).get(name, ""))
    return found[1] if found else ""
