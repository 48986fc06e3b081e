"""The command study: its words, and what it says of a study that nobody runs."""

import json
from dataclasses import replace

import pytest

from surefoot.cli import study
from surefoot.config.json_io import to_json
from surefoot.config.studies import named_study
from surefoot.study import state
from surefoot.study.cells import jobs_of
from surefoot.study.estimate import Estimate
from surefoot.study.folder import StudySetup, read_study, save_setup
from surefoot.study.runner import StudyOutcome
from surefoot.study.state import FAILED_FILE, is_paused, job_folder

SMOKE = named_study("smoke")


@pytest.fixture
def folder(tmp_path):
    save_setup(tmp_path / "mine", StudySetup(SMOKE, None, "0", "float32"))
    return tmp_path / "mine"


def test_the_status_of_a_study_is_shown_and_written(surefoot, capsys, folder, tmp_path):
    file = tmp_path / "status.json"
    assert surefoot("study", "status", folder, "--json", file) == 0
    jobs = jobs_of(SMOKE)
    assert f"{len(jobs)} jobs: " in capsys.readouterr().out
    report = json.loads(file.read_text())
    assert [job["name"] for job in report["jobs"]] == [job.name for job in jobs]
    assert {job["state"] for job in report["jobs"]} == {"ready", "waiting"}
    assert report["paused"] is False


def test_a_study_is_paused_and_resumed(surefoot, capsys, folder):
    assert surefoot("study", "pause", folder) == 0
    assert is_paused(folder)
    assert "paused: `surefoot study resume" in capsys.readouterr().out
    assert surefoot("study", "resume", folder) == 0
    assert not is_paused(folder)


def test_a_failed_job_is_named_with_its_log_and_how_to_run_it_again(surefoot, capsys, folder):
    name = jobs_of(SMOKE)[0].name
    failed = job_folder(folder, name)
    failed.mkdir(parents=True)
    (failed / FAILED_FILE).write_text("no such thing")
    assert surefoot("study", "status", folder) == 0
    text = capsys.readouterr().out
    assert f"{name} failed, see " in text
    assert f"--jobs {name}" in text


def test_an_output_never_replaces_the_study(surefoot, capsys, folder):
    before = (folder / "study.json").read_bytes()
    assert surefoot("study", "status", folder, "--json", folder / "study.json") == 2
    assert "--json: " in capsys.readouterr().err
    assert (folder / "study.json").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "study needs the name of one study, and got none"),
        (("status",), "study needs the name of one study, and got none"),
        (("smok",), "did you mean 'smoke'"),
        (("status", "nowhere"), "holds no study"),
        (("pause", "nowhere"), "holds no study"),
        (("status", "nowhere", "--estimate"), "leave out --jobs and --estimate"),
        (("resume", "nowhere", "--jobs", "a"), "leave out --jobs and --estimate"),
        (("broken.json",), "broken.json: there is no key 'sedes'; did you mean 'seeds'"),
    ],
)
def test_bad_words_are_one_clear_line(surefoot, capsys, tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.json").write_text(json.dumps(to_json(SMOKE) | {"sedes": [1]}))
    assert surefoot("study", *words) == 2
    assert message in capsys.readouterr().err


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """The current folder, with a study in the file grids/a.json whose name is `mine`."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "grids").mkdir()
    mine = to_json(SMOKE) | {"name": "mine"}
    (tmp_path / "grids" / "a.json").write_text(json.dumps(mine))
    return tmp_path


@pytest.mark.parametrize(
    ("word", "folder"),
    [
        ("v1.2", "studies/v1.2"),
        ("smoke", "studies/smoke"),
        ("grids/a.json", "studies/mine"),
        ("studies/smoke", "studies/smoke"),
        ("grids/mine", "grids/mine"),
    ],
)
def test_the_folder_of_a_study_has_its_name(surefoot, capsys, elsewhere, word, folder):
    assert surefoot("study", "status", word) == 2
    assert f"surefoot: {folder} holds no study" in capsys.readouterr().err


def test_the_file_of_a_study_that_has_begun_is_a_study_too(folder):
    assert study.study_named(str(folder / "study.json")) == SMOKE


def test_a_study_goes_on_with_the_jobs_that_it_began_with(surefoot, folder, monkeypatch, capsys):
    # Its beginnings are those of its file, whatever cells would share one today.
    setup = read_study(folder)
    other = replace(setup, beginnings={})
    (folder / "study.json").unlink()
    save_setup(folder, other)
    estimate = Estimate({job.name: 1800.0 for job in other.jobs}, "a processor")
    assert {job.name for job in jobs_of(SMOKE)} != set(estimate.seconds)
    monkeypatch.setattr("surefoot.study.estimate.estimate_study", lambda *_: estimate)
    monkeypatch.setattr("surefoot.study.runner.open_study", lambda *_: other)
    outcome = StudyOutcome(0, 0, ())
    monkeypatch.setattr("surefoot.study.runner.run_study", lambda *_: outcome)
    assert surefoot("study", folder) == 0
    assert f": {len(other.jobs)} jobs, about" in capsys.readouterr().out


def test_a_study_under_studies_is_found_by_its_name(surefoot, elsewhere):
    mine = replace(SMOKE, name="mine")
    save_setup(elsewhere / "studies" / "mine", StudySetup(mine, None, "0", "float32"))
    assert study.study_named("mine") == mine


def test_the_hours_that_are_left_are_those_of_the_workers_that_run_it(
    surefoot, folder, monkeypatch
):
    asked = []

    def described(_statuses, _estimate, workers):
        asked.append(workers)
        return ""

    monkeypatch.setattr(study, "describe_state", described)
    assert surefoot("study", "status", folder, "--workers", 7) == 0
    monkeypatch.setattr(state, "workers_of", lambda _folder: 3)
    assert surefoot("study", "status", folder, "--workers", 7) == 0
    assert asked == [7, 3]


def test_an_output_never_replaces_what_the_study_keeps(surefoot, capsys, folder):
    job = jobs_of(SMOKE)[0].name
    for name in ("report.html", "estimate.json", f"jobs/{job}/done.json", "judged.json"):
        assert surefoot("study", "status", folder, "--json", folder / name) == 2
        assert "is one of the study's own files in" in capsys.readouterr().err
        assert not (folder / name).exists()


def test_the_file_of_a_study_is_not_replaced_by_its_status(surefoot, elsewhere):
    before = (elsewhere / "grids/a.json").read_bytes()
    save_setup(elsewhere / "studies/mine", StudySetup(SMOKE, None, "0", "float32"))
    assert surefoot("study", "status", "grids/a.json", "--json", "grids/a.json") == 2
    assert (elsewhere / "grids/a.json").read_bytes() == before


def test_an_estimate_is_written_where_it_was_asked_for(surefoot, monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(
        "surefoot.study.estimate.estimate_study",
        lambda study, jobs: Estimate({job.name: 1800.0 for job in jobs}, "a processor"),
    )
    file = tmp_path / "estimate.json"
    assert surefoot("study", "smoke", "--estimate", "--workers", 2, "--json", file) == 0
    report = json.loads(file.read_text())
    names = [job.name for job in jobs_of(SMOKE)]
    assert report["jobs"] == [{"name": name, "seconds": 1800.0} for name in names]
    assert (report["processor"], report["workers"]) == ("a processor", 2)
    assert report["hours"] == (len(names) + 1) // 2 / 2  # the last of the fifteen runs alone
    assert (
        f"{len(names)} jobs, about {len(names) / 2:.1f} hours of a core" in capsys.readouterr().out
    )


def test_an_estimate_for_some_jobs_is_of_them_and_those_that_they_need(
    surefoot, monkeypatch, tmp_path
):
    monkeypatch.setattr(
        "surefoot.study.estimate.estimate_study",
        lambda study, jobs: Estimate({job.name: 1800.0 for job in jobs}, "a processor"),
    )
    file = tmp_path / "estimate.json"
    chosen = "measure--behavior_cloning--seed-1"
    assert surefoot("study", "smoke", "--estimate", "--jobs", chosen, "--json", file) == 0
    report = json.loads(file.read_text())
    needed = ["train--behavior_cloning--seed-1", chosen]
    assert [job["name"] for job in report["jobs"]] == needed


def test_an_estimate_of_a_study_that_has_begun_is_of_the_jobs_with_which_it_began(
    surefoot, monkeypatch, folder, tmp_path
):
    monkeypatch.setattr(
        "surefoot.study.estimate.estimate_study",
        lambda study, jobs: Estimate({job.name: 1800.0 for job in jobs}, "a processor"),
    )
    (folder / "study.json").unlink()
    begun = StudySetup(SMOKE, None, "0", "float32", beginnings={})
    save_setup(folder, begun)
    names = {job.name for job in begun.jobs}
    shared = next(job.name for job in jobs_of(SMOKE) if job.kind == "share")
    file = tmp_path / "estimate.json"
    asked = ("study", folder, "--estimate", "--json", file)
    assert surefoot(*asked) == 0
    assert {job["name"] for job in json.loads(file.read_text())["jobs"]} == names
    assert surefoot(*asked, "--jobs", shared) == 2
    other = tmp_path / "other.json"
    other.write_text(json.dumps(to_json(replace(SMOKE, title="Another"))))
    assert surefoot("study", other, "--folder", folder, "--estimate", "--json", file) == 0
    assert shared in {job["name"] for job in json.loads(file.read_text())["jobs"]}


@pytest.mark.parametrize("words", [("smoke",), ("smoke", "--estimate"), ("status", "smoke")])
def test_a_number_of_workers_that_cannot_be_is_refused_before_any_work(
    surefoot, capsys, tmp_path, monkeypatch, words
):
    monkeypatch.chdir(tmp_path)
    assert surefoot("study", *words, "--workers", 0) == 2
    assert "0 workers; use at least 1" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
