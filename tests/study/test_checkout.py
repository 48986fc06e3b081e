"""The code of a study: a commit in a checkout of its own."""

import subprocess

import pytest

from surefoot.study.checkout import check_out, clean_commit
from surefoot.study.folder import StudyError


def git(folder, *arguments):
    identity = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    answer = subprocess.run(
        ["git", *identity, *arguments], cwd=folder, check=True, capture_output=True, text=True
    )
    return answer.stdout.strip()


@pytest.fixture
def checkout(tmp_path):
    root = tmp_path / "checkout"
    (root / "src").mkdir(parents=True)
    (root / "src" / "code.py").write_text("VALUE = 1\n")
    git(root, "init", "-q")
    git(root, "add", ".")
    git(root, "commit", "-qm", "first")
    return root


def test_a_study_keeps_the_code_of_its_commit_while_the_checkout_goes_on(checkout, tmp_path):
    commit = clean_commit(checkout)
    source = check_out(checkout, commit, tmp_path / "study")
    (checkout / "src" / "code.py").write_text("VALUE = 2\n")
    git(checkout, "commit", "-qam", "second")
    assert check_out(checkout, commit, tmp_path / "study") == source
    assert (source / "code.py").read_text() == "VALUE = 1\n"


def test_code_that_is_lost_is_checked_out_again(checkout, tmp_path):
    commit = clean_commit(checkout)
    source = check_out(checkout, commit, tmp_path / "study")
    subprocess.run(["rm", "-r", str(source.parent)], check=True)
    assert check_out(checkout, commit, tmp_path / "study") == source
    assert (source / "code.py").exists()


def test_a_checkout_or_a_study_that_has_been_moved_goes_on(checkout, tmp_path):
    commit = clean_commit(checkout)
    check_out(checkout, commit, tmp_path / "study")
    moved = checkout.rename(tmp_path / "moved")
    source = check_out(moved, commit, tmp_path / "study")
    assert git(source, "rev-parse", "HEAD") == commit
    (tmp_path / "study").rename(tmp_path / "elsewhere")
    source = check_out(moved, commit, tmp_path / "elsewhere")
    assert (source / "code.py").read_text() == "VALUE = 1\n"


def test_code_that_is_no_worktree_any_more_may_be_deleted(checkout, tmp_path):
    """As after the study was moved, and git has forgotten it since."""
    commit = clean_commit(checkout)
    check_out(checkout, commit, tmp_path / "study")
    (tmp_path / "study").rename(tmp_path / "elsewhere")
    git(checkout, "worktree", "prune")
    with pytest.raises(StudyError, match="delete it, and the same command makes it again"):
        check_out(checkout, commit, tmp_path / "elsewhere")


def test_code_that_git_was_killed_in_writing_is_completed(checkout, tmp_path):
    commit = clean_commit(checkout)
    source = check_out(checkout, commit, tmp_path / "study")
    (source / "code.py").unlink()
    lock = git(source, "rev-parse", "--git-path", "index.lock")
    (source / lock).touch()
    assert check_out(checkout, commit, tmp_path / "study") == source
    assert (source / "code.py").read_text() == "VALUE = 1\n"


def test_changes_that_are_in_no_commit_are_refused(checkout):
    (checkout / "src" / "code.py").write_text("VALUE = 2\n")
    with pytest.raises(StudyError, match=r"src/code\.py.*commit them first"):
        clean_commit(checkout)


def test_changes_beside_the_package_do_not_matter(checkout):
    (checkout / "notes.txt").write_text("remember")
    assert clean_commit(checkout) == git(checkout, "rev-parse", "HEAD")


def test_a_commit_that_is_not_there_is_refused(checkout, tmp_path):
    with pytest.raises(StudyError, match="cannot be checked out"):
        check_out(checkout, "0" * 40, tmp_path / "study")
