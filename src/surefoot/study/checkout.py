"""The code that a study's jobs run: one commit, in its own checkout.

A study takes hours or days, and its jobs must all run the same code. Started from a git checkout,
it makes a worktree of the commit in its own folder, and its jobs import the package from there, so
the checkout itself may change in the meantime. The jobs of a study that is started from an
installed package run that package.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import surefoot
from surefoot.study.folder import StudyError
from surefoot.study.layout import CODE_FOLDER


def checkout_root() -> Path | None:
    """Root of the git checkout that this package lies in; None if it does not lie in one."""
    package = Path(surefoot.__file__).resolve().parent
    answer = _git(package, "rev-parse", "--show-toplevel")
    if answer is None:
        return None
    root = Path(answer)
    # An environment inside of a checkout is not the checkout's own code.
    tracked = _git(root, "ls-files", "--error-unmatch", str(package / "__init__.py"))
    return root if tracked is not None else None


def clean_commit(root: Path) -> str:
    """The commit of a checkout.

    Args:
        root: Root of the checkout.

    Raises:
        StudyError: Files of the package differ from it.
    """
    changed = _git(root, "status", "--porcelain", "--", "src")
    if changed is None:
        raise StudyError(f"git cannot read the checkout {root}; is git installed?")
    if changed:
        first = changed.splitlines()[0].split()[-1]
        raise StudyError(
            f"{root} has changes that are in no commit ({first}), so that nobody could repeat the "
            "study: commit them first, or set them aside with `git stash`"
        )
    commit = _git(root, "rev-parse", "HEAD")
    if commit is None:
        raise StudyError(f"{root} has no commit yet")
    return commit


def check_out(root: Path, commit: str, folder: Path) -> Path:
    """The code of a commit in the folder of a study; it is checked out if it is not there.

    Files that are missing or differ are restored, because git may have been killed as it wrote.

    Args:
        root: Root of a checkout that has the commit.
        commit: The commit.
        folder: Folder of the study.

    Returns:
        The folder from which the package is imported.

    Raises:
        StudyError: The checkout does not have the commit, or git fails.
    """
    code = (folder / CODE_FOLDER).resolve()
    if (code / ".git").exists() and _git(code, "rev-parse", "HEAD") is None:
        _git(root, "worktree", "repair", str(code))  # one of the two has been moved
    if _git(code, "rev-parse", "HEAD") != commit or not (code / "src").is_dir():
        _git(root, "worktree", "prune")
        try:
            subprocess.run(
                ["git", "worktree", "add", "--force", "--detach", str(code), commit],
                cwd=root,
                check=True,
                capture_output=True,
                text=True,
            )
        except (OSError, subprocess.CalledProcessError) as error:
            reason = (
                error.stderr.strip() if isinstance(error, subprocess.CalledProcessError) else error
            )
            raise StudyError(
                f"the code of commit {commit} cannot be checked out into {code}: {reason}. If the "
                "folder is there, delete it, and the same command makes it again"
            ) from error
    elif _git(code, "status", "--porcelain", "--", "src") != "":
        _restore(code)
    return code / "src"


def _restore(code: Path) -> None:
    """Bring a worktree back to its commit.

    Args:
        code: The worktree.

    Raises:
        StudyError: Git cannot do it.
    """
    lock = _git(code, "rev-parse", "--git-path", "index.lock")
    if lock is not None:
        (code / lock).unlink(missing_ok=True)  # left by a git that was killed
    if _git(code, "reset", "--hard", "--quiet") is None:
        raise StudyError(
            f"{code} has not all files of its commit, and git cannot restore them; delete it, and "
            "the same command makes it again"
        )


def _git(folder: Path, *arguments: str) -> str | None:
    """The output of git in a folder; None if it fails, or is not installed."""
    try:
        answer = subprocess.run(
            ["git", *arguments], cwd=folder, check=True, capture_output=True, text=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return answer.stdout.strip()
