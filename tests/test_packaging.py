"""What pyproject.toml promises agrees with itself, with the pins, and with what installs them."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

from surefoot.cli.doctor import CHECKS, LIBRARIES
from surefoot.viz.renderer import FIX

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ALLOWED = [
    minor
    for minor in range(100)
    if SpecifierSet(PROJECT["requires-python"]).contains(f"3.{minor}.0")
]
"""The minor versions of Python 3 that the package may be installed on."""
PINS = [
    Requirement(line)
    for line in (ROOT / "constraints.txt").read_text().splitlines()
    if not line.startswith("#")
]
UNPINNED = ("trackio",)
"""What cannot be installed beside the pins, as docs/install.md says."""
REQUIREMENTS = sorted(
    {
        *PROJECT["dependencies"],
        *(text for extra in PROJECT["optional-dependencies"].values() for text in extra),
    }
)


def pinned(name):
    """The versions that constraints.txt has of a package."""
    same = [pin for pin in PINS if canonicalize_name(pin.name) == canonicalize_name(name)]
    return [specifier.version for pin in same for specifier in pin.specifier]


def test_the_classifiers_name_the_versions_of_python_that_are_allowed():
    start = "Programming Language :: Python :: 3."
    named = [each.removeprefix(start) for each in PROJECT["classifiers"] if each.startswith(start)]
    assert sorted(map(int, named)) == ALLOWED


def test_make_refuses_the_versions_of_python_that_pip_refuses():
    text = (ROOT / "Makefile").read_text()
    (found,) = re.findall(r"\(3, (\d+)\) <= sys.version_info < \(3, (\d+)\)", text)
    assert list(range(*map(int, found))) == ALLOWED


def test_every_pin_is_an_exact_version_and_there_is_one_for_a_package():
    assert [str(pin) for pin in PINS if len(pinned(pin.name)) != 1] == []
    assert {specifier.operator for pin in PINS for specifier in pin.specifier} == {"=="}


@pytest.mark.parametrize("text", REQUIREMENTS)
def test_what_the_package_asks_for_has_a_pin_that_fits(text):
    wanted = Requirement(text)
    if wanted.name in UNPINNED:
        assert pinned(wanted.name) == []
        return
    (version,) = pinned(wanted.name)
    assert wanted.specifier.contains(version)


def debian_packages(text):
    """The packages that the first apt-get install of a text installs."""
    line = re.findall(r"apt-get install ([^\n\\]+)", text)[0]
    return {word for word in line.split() if not word.startswith("-")}


def test_container_and_make_install_what_wheels_and_films_need_of_debian():
    container = debian_packages((ROOT / "Containerfile").read_text())
    assert container == debian_packages((ROOT / "Makefile").read_text())
    (drawing,) = re.findall(r"apt-get install ([\w -]+)", FIX)
    assert container == {*LIBRARIES.values(), *drawing.split()}
    (render,) = [check for check in CHECKS if check.name == "render"]
    assert drawing in render.remedy


def test_the_container_takes_a_python_that_is_allowed_and_the_pinned_torch():
    text = (ROOT / "Containerfile").read_text()
    (minor,) = re.findall(r"^FROM \S+/python:3\.(\d+)", text, flags=re.MULTILINE)
    assert int(minor) in ALLOWED
    assert re.findall(r"torch==(\S+)", text) == pinned("torch")
