"""Every import of surefoot, in a function too, finds its module and the name in it.

pyright refuses a module that is not there, but only warns of a name that is gone, since compiled
modules without stubs look the same to it. This takes a second, and needs no type checker.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("src", "tests", "benchmarks", "checks", "examples")


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def file_of(module: str) -> Path | None:
    """The file of a module of the package; None if there is none."""
    path = ROOT / "src" / module.replace(".", "/")
    # The names of the package itself are loaded late, and its stub has them all.
    for file in (path / "__init__.pyi", path / "__init__.py", path.with_suffix(".py")):
        if file.exists():
            return file
    return None


@cache
def names_of(path: Path) -> set[str]:
    """What a module binds, however deep within conditions; more rather than less."""
    names = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}
    return names | {"__all__", "__version__", "__file__"}


def broken_imports(path: Path) -> Iterator[str]:
    """The imports of a file that find nothing in the package."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "surefoot" and file_of(alias.name) is None:
                    yield f"line {node.lineno}: {alias.name}"
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "surefoot":
            module = str(node.module)
            file = file_of(module)
            for alias in node.names:
                found = file is not None and alias.name in names_of(file)
                if not found and file_of(f"{module}.{alias.name}") is None:
                    yield f"line {node.lineno}: {module}.{alias.name}"


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_import_of_the_package_finds_what_it_names(folder):
    broken = {
        str(path.relative_to(ROOT)): lines
        for path in sorted((ROOT / folder).rglob("*.py"))
        if (lines := list(broken_imports(path)))
    }
    assert broken == {}


def test_a_module_that_has_moved_and_a_name_that_is_gone_are_found(tmp_path):
    file = tmp_path / "user.py"
    file.write_text(
        "import surefoot\n"
        "def late():\n"
        "    from surefoot.interop.onnx_file import describe\n"
        "from surefoot.types import Command, Comand\n"
        "import surefoot.fields\n"
        "from surefoot import train, runs\n"
    )
    assert [line.split(": ")[1] for line in broken_imports(file)] == [
        "surefoot.types.Comand",
        "surefoot.fields",
        "surefoot.train",
        "surefoot.interop.onnx_file.describe",
    ]
