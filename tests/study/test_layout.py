"""The files of a study's own: all that it keeps are among them, and what lies beside is not."""

from dataclasses import replace

import pytest

from surefoot.config.json_io import to_json
from surefoot.config.studies import named_study
from surefoot.files import write_json
from surefoot.study.cells import jobs_of
from surefoot.study.folder import StudySetup, results_folder, save_setup
from surefoot.study.layout import OWN, STUDY_FILE, study_that_owns
from surefoot.study.state import job_folder

SMOKE = named_study("smoke")


@pytest.fixture
def folder(tmp_path):
    """A study that has begun."""
    save_setup(tmp_path / "mine", StudySetup(SMOKE, None, "0", "float32"))
    return tmp_path / "mine"


def test_every_file_that_a_study_keeps_belongs_to_it(folder):
    job = jobs_of(SMOKE)[0]
    known = [
        *(folder / name for name in OWN),
        job_folder(folder, job.name) / "log.txt",
        results_folder(folder, job.cell) / "jobs" / f"{job.name}.json",
        results_folder(folder, job.cell) / "tests" / "success.json",
        folder / "figures" / "1.png",
    ]
    assert [study_that_owns(path) for path in known] == [folder] * len(known)


@pytest.mark.parametrize("name", sorted(name for name in OWN if not name.startswith(".")))
def test_no_part_of_a_study_has_the_name_of_one_of_its_files(name):
    with pytest.raises(ValueError, match="use another name than"):
        replace(SMOKE.settings[0], name=name)
    with pytest.raises(ValueError, match="use another name than"):
        replace(SMOKE.techniques[0], name=name)


def test_what_lies_beside_belongs_to_nobody(folder, tmp_path):
    for path in (folder / "mine.json", folder / "a/seed-0/play.mp4", tmp_path / "jobs/1.json"):
        assert study_that_owns(path) is None


def test_a_link_belongs_to_the_study_that_it_points_into(folder, tmp_path):
    link = tmp_path / "report.json"
    link.symlink_to(folder / STUDY_FILE)
    assert study_that_owns(link) == folder


def test_a_file_to_begin_with_makes_no_study_of_its_folder(tmp_path):
    write_json(tmp_path / STUDY_FILE, to_json(SMOKE))
    assert study_that_owns(tmp_path / "figures/mine.json") is None
    assert study_that_owns(tmp_path / "figures/mine.json", new_study=tmp_path) == tmp_path
    (tmp_path / STUDY_FILE).write_text("{")  # one that is damaged may be restored
    assert study_that_owns(tmp_path / "figures/mine.json") == tmp_path
