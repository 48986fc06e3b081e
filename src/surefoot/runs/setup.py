"""What fixes a run's results, as it stands in the run's ``config.json``. Next: `runs.run`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from surefoot.config import Config
from surefoot.config.json_io import from_json, read_json
from surefoot.learning.precision import PrecisionChoice
from surefoot.runs.layout import CONFIG_FILE, RunError


@dataclass(frozen=True)
class Setup:
    """The content of a run's ``config.json``: what fixes its results.

    Attributes:
        config: The run's configuration.
        versions: Version of Python, the processor and each package by name, when it was begun.
        precision: The number format that all its trainings multiply in; None in runs of versions
            that did not write it down.
        starts_hash: The hash of its initial states; empty in runs of versions that did not write it
            down.
    """

    config: Config
    versions: dict[str, str] = field(default_factory=dict)
    precision: PrecisionChoice | None = None
    starts_hash: str = ""


def has_setup(folder: Path) -> bool:
    """Whether a folder has a run's configuration; a damaged file is taken for one.

    Other programs have a ``config.json`` too.
    """
    path = folder / CONFIG_FILE
    if not path.exists():
        return False
    try:
        content = read_json(path)
    except ValueError:
        return True
    return isinstance(content, dict) and "config" in content


def read_setup(folder: Path) -> Setup:
    """The configuration and the versions that a run was started with, as they are in its file.

    Raises:
        RunError: There is no run, or its config cannot be read.
    """
    path = folder / CONFIG_FILE
    if not path.exists():
        raise RunError(f"{folder} holds no run (no {path.name}); `surefoot train` makes one")
    try:
        return from_json(Setup, read_json(path))
    except ValueError as error:
        raise RunError(
            f"{path} cannot be read: {error}. Restore it from a copy, or from another run with the "
            "same options; what lies beside it is not touched"
        ) from error
