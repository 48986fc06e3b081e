"""The optional parts of the package: what each adds, and what of it is missing here."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires

from surefoot.runs.versions import installed

PACKAGE = "surefoot"
ADDS = {
    "viz": "films of robots, and the viewer in the browser",
    "pybullet": "the second simulator, the paper's",
    "ray": "rollouts on a cluster (--backend ray)",
    "tensorboard": "curves while a run trains (train --track tensorboard)",
    "wandb": "the same in Weights & Biases (train --track wandb)",
    "trackio": "the same in trackio, on this machine (train --track trackio)",
    "gym": "Gymnasium environments, for reinforcement learning",
    "exchange": "datasets for Minari and LeRobot (export-data)",
    "docs": "the documentation site (make docs)",
    "dev": "the tests and checks of the package itself",
}
"""What each extra adds."""


@dataclass(frozen=True)
class Extra:
    """An optional part of the package.

    Attributes:
        name: Its name, as in ``pip install 'surefoot[NAME]'``.
        adds: What it adds, in words; empty if it is not known here.
        missing: The packages of it that are not installed.
        available: False if none of its packages is made for this version of Python.
    """

    name: str
    adds: str
    missing: tuple[str, ...]
    available: bool = True

    @property
    def installed(self) -> bool:
        """Whether all of it is here."""
        return self.available and not self.missing

    @property
    def state(self) -> str:
        """Whether it is here, and if not, how it is installed."""
        if not self.available:
            return "not made for this Python"
        if self.missing:
            return f"missing: pip install '{PACKAGE}[{self.name}]'"
        return "installed"

    @property
    def line(self) -> str:
        """What a report says of it."""
        return f"{self.name:<12}{self.adds}: {self.state}"


def extras() -> list[Extra]:
    """The extras of the package, in the order of its metadata; none if it is not installed."""
    from packaging.requirements import Requirement

    try:
        wanted = [Requirement(text) for text in requires(PACKAGE) or ()]
    except PackageNotFoundError:
        return []
    found: list[Extra] = []
    for name in dict.fromkeys(_names(wanted)):
        marked = [each for each in wanted if name in _names([each])]
        mine = [each for each in marked if each.marker and each.marker.evaluate({"extra": name})]
        missing = tuple(each.name for each in mine if installed(each.name) is None)
        found.append(Extra(name, ADDS.get(name, ""), missing, available=bool(mine)))
    return found


def _names(wanted: list) -> Iterator[str]:
    """The names of the extras that packages are wanted for."""
    for each in wanted:
        yield from re.findall(r"extra == [\"']([\w.-]+)[\"']", str(each.marker))
