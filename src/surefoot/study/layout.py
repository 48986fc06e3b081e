"""A study's own files in its folder, which no command but the study's and its report's may write.

Other commands may write anything else there, such as films of the policies that a study keeps. Read
`surefoot.runs.layout` for the files that the study's runs own, `folder` for what the files contain,
and `state` for what they show about the study's progress.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config.json_io import read_json
from surefoot.runs.layout import folder_that_owns

STUDY_FILE = "study.json"
"""File in a study's folder that makes the folder a study."""
JUDGED_FILE = "judged.json"
"""File in which whoever ran the study records the outcome of its predictions."""
ESTIMATE_FILE = "estimate.json"
"""File that keeps the study's estimate of how long it takes."""
PAUSED_FILE = "paused"
"""File that exists while the study is paused."""
LOCK_FILE = ".lock"
"""File locked by the process that runs the study or, in a job's folder, by the one that does it."""
WORKERS_FILE = ".workers"
"""File with the number of jobs at a time, from the process that runs the study."""
CODE_FOLDER = "code"
"""The worktree of the commit that the study's jobs run."""
JOBS_FOLDER = "jobs"
"""Folder of the jobs' output and, in a cell's folder, of their records."""
TESTS_FOLDER = "tests"
"""Folder of the measurements, in a cell's folder."""
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

    Links are followed: a link belongs to a study if it, or the file that it points to, does.

    Args:
        path: The file; it need not exist.
        new_study: A folder that is to become a study.
    """
    return folder_that_owns(path, new_study, _is_study, lambda parts: not OWN.isdisjoint(parts))


def _is_study(folder: Path) -> bool:
    """Whether a study has begun in a folder; a file that describes one may have the same name."""
    path = folder / STUDY_FILE
    if not path.is_file():
        return False
    try:
        values = read_json(path)
    except (OSError, ValueError):
        return True  # even if this file is damaged, all else is worth keeping
    return isinstance(values, dict) and "study" in values
