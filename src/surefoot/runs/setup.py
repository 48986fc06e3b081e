"""The content of a run's ``config.json``, which fixes the run's results. Next: `runs.run`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from surefoot.config import Config
from surefoot.config.json_io import from_json, read_json
from surefoot.learning.precision import PrecisionChoice
from surefoot.runs.layout import CONFIG_FILE, RunError


@dataclass(frozen=True)
class Setup:
    """The content of a run's ``config.json``, which fixes the run's results.

    Attributes:
        config: The run's configuration.
        versions: The Python version, the processor and each package's version when the run began,
            by name.
        precision: The number format in which all its trainings multiply; None in runs of versions
            that did not record it.
        starts_hash: The hash of its initial states; empty in runs of versions that did not record
            it.
    """

    config: Config
    versions: dict[str, str] = field(default_factory=dict)
    precision: PrecisionChoice | None = None
    starts_hash: str = ""


def has_setup(folder: Path) -> bool:
    """Whether a folder has a run's configuration; a damaged file counts as one.

    A ``config.json`` of another program does not count.
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
    """The setup that a run was begun with, read from its ``config.json``.

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
