"""Plain Python: what ruff does not check of the style that keeps the code readable.

One statement a line, results as records, functions of few parameters, small modules, whole
sentences in docstrings. `python checks/plain_python.py FOLDER...` prints what breaks a rule, and
what to write instead; it exits with 1 if anything does. `code_figures.py` counts the same things.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

PARAMETERS = 8
LINES = 400
TOP_LEVEL_FILES = 8
PACKAGE = Path("src/surefoot")
UNTYPED = {
    "config/checked.py": 2,
    "config/json_io.py": 4,
    "interop/gym/env.py": 1,
    "learning/classifier.py": 1,
    "learning/policy.py": 2,
    "learning/step.py": 1,
    "learning/tensor_file.py": 1,
    "sim/mujoco_model.py": 1,
}
"""How many mappings to anything the files at the edge (JSON, weights) hold; others hold none."""

Finding = tuple[int, str]
"""A line number, and what to write instead of what stands there."""


def tuple_assignments(tree: ast.AST) -> Iterator[Finding]:
    """Assignments like `a, b = x, y`, unless the same names stand on both sides (a swap)."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
            continue
        values = {ast.unparse(value) for value in node.value.elts}
        for target in node.targets:
            if not isinstance(target, ast.Tuple | ast.List):
                continue
            if {ast.unparse(name) for name in target.elts} != values:
                yield node.lineno, "a tuple assignment of unrelated values: one line for each"


def walruses(tree: ast.AST) -> Iterator[Finding]:
    """Walruses in the arguments of a call."""
    lines = set()
    for call in ast.walk(tree):
        if isinstance(call, ast.Call):
            for argument in [*call.args, *call.keywords]:
                lines |= {n.lineno for n in ast.walk(argument) if isinstance(n, ast.NamedExpr)}
    message = "a walrus in the arguments of a call: assign on the line before"
    return iter([(line, message) for line in lines])


def fragments(tree: ast.AST) -> Iterator[Finding]:
    """Docstrings, or their entries, that begin with "of"."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant):
            continue
        if isinstance(node.value.value, str):
            for number, line in enumerate(node.value.value.splitlines()):
                if re.match(r"\s+[\w`, ]+: +of\b" if number else r"of\b", line, re.IGNORECASE):
                    yield node.lineno + number, 'begins with "of": a sentence, "Seed for the ..."'


def long_signatures(tree: ast.AST, most: int = PARAMETERS) -> Iterator[Finding]:
    """Functions with more parameters than `most`, not counting `self` and `cls`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            arguments = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            count = len([entry for entry in arguments if entry.arg not in ("self", "cls")])
            if count > most:
                yield node.lineno, f"{node.name} has {count} parameters, at most {most}: a record"


def untyped(tree: ast.AST) -> Iterator[Finding]:
    """Mappings from text to anything."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript):
            kind = ast.unparse(node)
            if re.fullmatch(r"([\w.]*\.)?(dict|Dict|\w*Mapping)\[str, (Any|object)\]", kind):
                yield node.lineno, f"{kind}: return a frozen dataclass with documented fields"


def check_module(path: Path) -> list[Finding]:
    """Everything that breaks a rule in one file; those of the package have more rules."""
    source = path.read_text()
    tree = ast.parse(source)
    findings = [*tuple_assignments(tree), *walruses(tree)]
    if PACKAGE in path.parents:
        findings += [*fragments(tree), *long_signatures(tree)]
        open_mappings = list(untyped(tree))
        if len(open_mappings) > UNTYPED.get(path.relative_to(PACKAGE).as_posix(), 0):
            findings += open_mappings
        length = source.count("\n")
        if length > LINES:
            findings.append((length, f"{length} lines, at most {LINES}: split it by idea"))
    return sorted(findings)


def main(folders: list[str]) -> int:
    """Check all modules in these folders."""
    broken = 0
    for path in sorted(path for folder in folders for path in Path(folder).rglob("*.py")):
        for line, text in check_module(path):
            print(f"{path}:{line}: {text}")
            broken += 1
    top_level = sorted(PACKAGE.glob("*.py"))
    if len(top_level) > TOP_LEVEL_FILES:
        print(f"{PACKAGE}: {len(top_level)} files, at most {TOP_LEVEL_FILES}: move one to a room")
        broken += 1
    if broken:
        print(f"{broken} places to rewrite", file=sys.stderr)
    return int(broken > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
