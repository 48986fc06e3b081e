"""What each extra adds is known, and what is missing is named."""

import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

import surefoot.cli.extras as module
from surefoot.cli.extras import ADDS, Extra, extras

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
REQUIRED = [
    "numpy>=2.0",
    "h5py>=3; extra == 'old'",
    "nowhere-else>=1; extra == 'new'",
    "numpy>=2.0; extra == 'new'",
    "pybullet; python_version < '3' and extra == 'past'",
]


def test_of_every_extra_it_is_said_what_it_adds():
    with PROJECT.open("rb") as file:
        names = tomllib.load(file)["project"]["optional-dependencies"]
    assert set(names) <= set(ADDS)


def test_what_is_installed_missing_or_not_made_for_this_python(monkeypatch):
    monkeypatch.setattr(module, "requires", lambda name: REQUIRED)
    monkeypatch.setitem(ADDS, "new", "more")
    assert extras() == [
        Extra("old", "", ()),
        Extra("new", "more", ("nowhere-else",)),
        Extra("past", "", (), available=False),
    ]


@pytest.mark.parametrize(
    ("extra", "state"),
    [
        (Extra("viz", "films", ()), "viz         films: installed"),
        (Extra("viz", "films", ("x",)), "viz         films: missing: pip install 'surefoot[viz]'"),
        (Extra("viz", "films", (), False), "viz         films: not made for this Python"),
    ],
)
def test_the_line_of_an_extra(extra, state):
    assert extra.line == state


def test_a_package_that_is_not_installed_has_no_extras(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(module, "requires", missing)
    assert extras() == []
