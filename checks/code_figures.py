"""How large and how plain the package is: `python checks/code_figures.py [CHECKOUT...]`.

A table with one column for each checkout of the repository (without any: this one), so that two
states of the code can be compared. The rules are those of `plain_python.py`.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from statistics import median

from plain_python import Finding, fragments, long_signatures, tuple_assignments, untyped, walruses


def count_layers(checkout: Path) -> int:
    """Number of layers in the import contract."""
    settings = tomllib.loads((checkout / "pyproject.toml").read_text())
    contracts = settings["tool"]["importlinter"]["contracts"]
    return sum(len(entry["layers"]) for entry in contracts if entry["type"] == "layers")


def longest_function(trees: list[ast.Module]) -> int:
    """Lines of the longest function, its signature and docstring included."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    nodes = [n for n in chain.from_iterable(map(ast.walk, trees)) if isinstance(n, functions)]
    return max((node.end_lineno or node.lineno) - node.lineno + 1 for node in nodes)


def figures(checkout: Path) -> dict[str, str]:
    """The figures of one checkout as text, by what they count."""
    package = checkout / "src" / "surefoot"
    sources = [path.read_text() for path in package.rglob("*.py")]
    trees = [ast.parse(source) for source in sources]
    lengths = [source.count("\n") for source in sources]
    lines = sum(lengths)

    def count(rule: Callable[[ast.AST], Iterator[Finding]]) -> int:
        return sum(len(list(rule(tree))) for tree in trees)

    tuples = count(tuple_assignments)
    return {
        "files at the top level of the package": f"{len(list(package.glob('*.py')))}",
        "modules": f"{len(lengths)}",
        "lines": f"{lines}",
        "lines of a module: median, longest": f"{median(lengths):.0f}, {max(lengths)}",
        "lines of the longest function": f"{longest_function(trees)}",
        "tuple assignments": f"{tuples}",
        "tuple assignments per 1000 lines": f"{1000 * tuples / lines:.1f}",
        "walruses in the arguments of a call": f"{count(walruses)}",
        "functions with more than 6 parameters": f"{count(partial(long_signatures, most=6))}",
        "functions with more than 8 parameters": f"{count(long_signatures)}",
        "mappings from text to anything": f"{count(untyped)}",
        'docstrings and entries that begin with "of"': f"{count(fragments)}",
        "layers of the import contract": f"{count_layers(checkout)}",
    }


def main(checkouts: list[str]) -> None:
    """Print the table."""
    columns = [figures(Path(checkout)) for checkout in checkouts]
    print("| | " + " | ".join(checkouts) + " |")
    print("|---|" + "---|" * len(columns))
    for what in columns[0]:
        print(f"| {what} | " + " | ".join(column[what] for column in columns) + " |")


if __name__ == "__main__":
    main(sys.argv[1:] or ["."])
