"""The run's own files in its folder, which only the run may write.

Other files in the folder, such as films and evaluation reports, may be written by anyone.
`runs.run` creates the files and describes each of them.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from surefoot.config import MOST_GAITS
from surefoot.files import lock_file, whole_name

CONFIG_FILE = "config.json"
"""File in a run's folder that makes the folder a run."""
STARTS_FILE = "starts.npz"
"""File of the run's own copy of its initial states, if these do not come with the package."""
OTHER_STARTS_FILE = "starts-{number}.npz"
"""File of the copy of the initial states of any gait after the first one, by its number."""
ROBOT_FILE = "robot.urdf"
"""File of the run's own copy of the description of a robot that does not come with the package."""
STARTS_FILES = (
    STARTS_FILE,
    *(OTHER_STARTS_FILE.format(number=number) for number in range(1, MOST_GAITS)),
)
"""All files of copies of initial states."""
COPIES = (*STARTS_FILES, ROBOT_FILE)
"""All files that a run may copy when it begins, so that it needs no files elsewhere."""
METRICS_FILE = "metrics.jsonl"
"""File of the metrics: one line for each stage that is done."""
EXPERT_FILE = "expert.json"
"""File with the identity of a user's own MPC."""
LOCK_FILE = ".lock"
"""File that the process that trains in the folder has locked."""
ATTEMPTS_FILE = "attempts.jsonl"
"""Log of the attempts of a run that learns on a robot (`surefoot.field.attempts`)."""
CURVES_FILE = "curves.png"
"""The learning curves, which `surefoot train` draws."""
KEPT_POLICY_FILE = "policy.safetensors"
"""The best policy, if a study keeps only that one of a run's policies."""
OWN = {
    CONFIG_FILE,
    *COPIES,
    METRICS_FILE,
    EXPERT_FILE,
    ATTEMPTS_FILE,
    LOCK_FILE,
    CURVES_FILE,
    KEPT_POLICY_FILE,
    "data",
    "policies",
    "checkpoints",
    "episodes",
    "traces",
    "gates",
    "flights",
}
"""Names of a run's own files and folders, in its folder."""

EARLY = (LOCK_FILE, *COPIES)
"""Files that may be left if a run is killed as it begins."""


class RunError(ValueError):
    """A run folder cannot be used as asked."""


def claim(folder: Path) -> None:
    """Keep other processes from training in a folder until this one ends, even if killed.

    Raises:
        RunError: Another process is training in the folder.
        WriteError: The folder cannot be written to.
    """
    if not lock_file(folder / LOCK_FILE):
        raise RunError(
            f"another process trains in {folder}; wait for it, or choose another folder with --run"
        )


def remove_left_overs(folder: Path) -> None:
    """Remove partly written files of a killed process from the run's folder, now locked.

    Only the run's own files count: others may be films that another process is drawing now.
    """
    own = [part for name in OWN for part in (folder / name).glob(".*")]
    for part in [*own, *folder.glob(".*")]:
        name = whole_name(part)
        if name is not None and (part in own or name in OWN):
            part.unlink()


def run_that_owns(path: Path, new_run: Path | None = None) -> Path | None:
    """The folder of the run that a file belongs to, or None if it belongs to none.

    A link is followed: it belongs to a run if the link or its target lies in the run's folder.

    Args:
        path: The file; it need not exist.
        new_run: A folder that is to become a run.
    """
    return folder_that_owns(path, new_run, _is_run, lambda parts: parts[0] in OWN)


def folder_that_owns(
    path: Path,
    new: Path | None,
    has_begun: Callable[[Path], bool],
    owns: Callable[[tuple[str, ...]], bool],
) -> Path | None:
    """The folder of a run or a study that a file belongs to, or None if it belongs to none.

    A link is followed: it belongs to a folder if the link or its target lies there.

    Args:
        path: The file; it need not exist.
        new: A folder that is to become a run or a study.
        has_begun: Returns whether a folder is a run or a study.
        owns: Returns whether a run or a study owns a file, by the parts of its path in the folder.
    """
    begins = None if new is None else Path(os.path.realpath(new))
    for file in (Path(os.path.realpath(path.parent)) / path.name, Path(os.path.realpath(path))):
        for folder in file.parents:
            if owns(file.relative_to(folder).parts) and (folder == begins or has_begun(folder)):
                return folder
    return None


def _is_run(folder: Path) -> bool:
    """Whether a folder holds a run, not just a ``config.json`` of another program."""
    has_begun = any((folder / name).exists() for name in (LOCK_FILE, METRICS_FILE))
    return has_begun and (folder / CONFIG_FILE).exists()
