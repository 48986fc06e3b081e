"""The files of a study's own in its folder, which nothing but the study and its report may write.

What lies beside them anything may write, such as films of the policies that a study keeps. What the
runs of a study own is in `surefoot.runs.layout`. `folder` says what the files hold, `state` how far
the study is, by them.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config.json_io import read_json
from surefoot.runs.layout import folder_that_owns

STUDY_FILE = "study.json"
"""File in a study's folder that makes the folder a study."""
JUDGED_FILE = "judged.json"
"""File in which whoever ran the study says what came of its predictions."""
ESTIMATE_FILE = "estimate.json"
"""File that keeps the study's estimate of how long it takes."""
PAUSED_FILE = "paused"
"""There while the study is paused."""
LOCK_FILE = ".lock"
"""Locked by the process that runs the study or, in the folder of a job, does the job."""
WORKERS_FILE = ".workers"
"""How many jobs the process that has claimed the study runs at a time."""
CODE_FOLDER = "code"
"""The worktree of the commit that the study's jobs run."""
JOBS_FOLDER = "jobs"
"""Folder of what the jobs print and, in that of a cell, of their records."""
TESTS_FOLDER = "tests"
"""Folder of what was measured, in that of a cell."""
PAGE_FILE = "report.html"
"""File of the page of a report."""
FIGURES_FOLDER = "figures"
"""Folder of the pictures of a report."""
OWN = frozenset(
    {
        STUDY_FILE,
        JUDGED_FILE,
        ESTIMATE_FILE,
        PAUSED_FILE,
        LOCK_FILE,
        WORKERS_FILE,
        CODE_FOLDER,
        JOBS_FOLDER,
        TESTS_FOLDER,
        PAGE_FILE,
        FIGURES_FOLDER,
    }
)
"""Names of a study's own files and folders, in its folder and in those of its cells."""


def study_that_owns(path: Path, new_study: Path | None = None) -> Path | None:
    """The folder of the study that a file belongs to, or None if it belongs to none.

    A link is followed: it belongs to a study if it lies there, or if what it points to does.

    Args:
        path: The file; it need not exist.
        new_study: A folder that is to become a study.
    """
    return folder_that_owns(path, new_study, _is_study, lambda parts: not OWN.isdisjoint(parts))


def _is_study(folder: Path) -> bool:
    """Whether a study has begun in a folder: a file to begin with may have the same name."""
    path = folder / STUDY_FILE
    if not path.is_file():
        return False
    try:
        values = read_json(path)
    except (OSError, ValueError):
        return True  # of one that is damaged, all else is still worth keeping
    return isinstance(values, dict) and "study" in values
