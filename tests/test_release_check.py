"""What is to be published holds what commands need, and nothing that is made on a machine."""

import io
import tarfile
import zipfile

import pytest
from release_check import DATA, check_contents


def published(folder, wheel_names, sdist_names=("surefoot-1/pyproject.toml",)):
    wheel = folder / "surefoot-1-py3-none-any.whl"
    sdist = folder / "surefoot-1.tar.gz"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name in (*wheel_names, "surefoot-1.dist-info/METADATA"):
            archive.writestr(name, "")
    with tarfile.open(sdist, "w:gz") as archive:
        for name in sdist_names:
            archive.addfile(tarfile.TarInfo(name), io.BytesIO())
    return wheel, sdist


def test_a_whole_package_is_right(tmp_path):
    assert check_contents(*published(tmp_path, DATA)) == []


def test_what_is_missing_is_named(tmp_path):
    assert check_contents(*published(tmp_path, DATA[1:])) == [f"the wheel lacks {DATA[0]}"]


@pytest.mark.parametrize(
    "name", ["surefoot/__pycache__/a.py", "surefoot/mpc/plan.py311.nbi", "surefoot/mpc/a.1.nbc"]
)
def test_caches_are_not_published(tmp_path, name):
    assert check_contents(*published(tmp_path, (*DATA, name))) == [f"{name} is a cache"]
    assert check_contents(*published(tmp_path, DATA, (name,))) == [f"{name} is a cache"]


def test_what_is_no_part_of_the_package_is_refused(tmp_path):
    wrong = check_contents(*published(tmp_path, (*DATA, "tests/test_a.py")))
    assert wrong == ["tests/test_a.py is no part of the package"]
