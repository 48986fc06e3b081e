"""The public API: every name resolves, editors know the same names, and importing it is cheap."""

import ast
import subprocess
import sys
from importlib.resources import files

import pytest

import surefoot

HEAVY = ("h5py", "matplotlib", "mujoco", "numba", "numpy", "pinocchio", "torch", "tyro")


def child_output(code: str) -> str:
    """Output of a program in a fresh interpreter."""
    command = [sys.executable, "-c", code]
    child = subprocess.run(command, capture_output=True, text=True, check=True)
    return child.stdout.strip()


@pytest.mark.parametrize("name", surefoot.__all__)
def test_every_public_name_resolves(name):
    value = getattr(surefoot, name)
    if name != "HandBack":  # a set of names (a `Literal`), which belongs to no module
        assert value.__module__.startswith("surefoot.")


def test_editors_know_the_same_names_from_the_same_modules():
    stub = ast.parse(files("surefoot").joinpath("__init__.pyi").read_text())
    imported = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                # Without `as` and the same name, a checker does not export it.
                assert alias.asname == alias.name
                imported[alias.name] = node.module
    assert imported == {
        name: f"surefoot.{module}"
        for module, names in surefoot._HOME.items()  # pyright: ignore[reportAttributeAccessIssue]
        for name in names
    }


def test_the_package_says_that_it_has_types():
    assert files("surefoot").joinpath("py.typed").is_file()


def test_importing_the_package_imports_nothing_heavy():
    code = f"import sys, surefoot\nprint([name for name in {HEAVY} if name in sys.modules])"
    assert child_output(code) == "[]"


def test_functions_are_not_hidden_by_modules_of_their_name():
    # A submodule becomes an attribute of the package once anything imports it.
    code = "import surefoot, surefoot.cli.main, surefoot.viz.replay, surefoot.bench.engine\n"
    code += "print([n for n in surefoot.__all__ if not callable(getattr(surefoot, n))"
    code += " and type(getattr(surefoot, n)).__name__ == 'module'])"
    assert child_output(code) == "[]"


def test_an_unknown_name_lists_those_that_exist():
    with pytest.raises(AttributeError, match="loco_safe_dagger"):
        _ = surefoot.locosafedagger  # pyright: ignore[reportAttributeAccessIssue]
