"""The public API: every name resolves, and no module hides a function of its name."""

import subprocess
import sys

import pytest

import surefoot


@pytest.mark.parametrize("name", surefoot.__all__)
def test_every_public_name_resolves(name):
    assert getattr(surefoot, name).__module__.startswith("surefoot.")


def test_functions_are_not_hidden_by_modules_of_their_name():
    # A submodule becomes an attribute of the package once anything imports it.
    code = "import surefoot, surefoot.cli.main, surefoot.viz.replay, surefoot.bench.engine\n"
    code += "print([n for n in surefoot.__all__ if not callable(getattr(surefoot, n))"
    code += " and type(getattr(surefoot, n)).__name__ == 'module'])"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "[]"


def test_an_unknown_name_lists_those_that_exist():
    with pytest.raises(AttributeError, match="loco_safe_dagger"):
        _ = surefoot.locosafedagger  # pyright: ignore[reportAttributeAccessIssue]
