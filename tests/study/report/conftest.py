import shutil
from pathlib import Path

import pytest

from tests.fakes.study_folders import paper_like, write_study


@pytest.fixture(scope="session")
def study_folder(tmp_path_factory) -> Path:
    """A study of which one run is missing; tests must not write to it."""
    folder = tmp_path_factory.mktemp("study") / "paper"
    return write_study(folder, paper_like(), without=("loco_dagger-0.8/seed-1",))


@pytest.fixture
def own_study(study_folder, tmp_path) -> Path:
    """The same, to be changed."""
    return Path(shutil.copytree(study_folder, tmp_path / "own"))
