"""The command report: a study, a run, and errors that say what is missing."""

import json
from dataclasses import replace

import pytest

from surefoot.study.report import study_page
from surefoot.study.report.markup import NOTHING
from tests.fakes.study_folders import paper_like, write_study


@pytest.fixture
def study_folder(tmp_path):
    study = paper_like(1)
    small = {"techniques": study.techniques[:2], "measurements": study.measurements[:1]}
    study = replace(study, **small, comparisons=(), claims="none")
    return write_study(tmp_path / "studies" / "mine", study, iterations=1)


def test_a_study_has_a_page_and_figures_in_its_folder(
    surefoot, capsys, monkeypatch, tmp_path, study_folder
):
    monkeypatch.chdir(tmp_path)
    assert surefoot("report", "mine", "--no-film-policies", "--json", "r.json") == 0
    shown = capsys.readouterr()
    assert "studies/mine/report.html" in shown.out
    assert "results:" in shown.err and "figures:" in shown.err
    assert (study_folder / "figures/3-success-test.pdf").is_file()
    assert json.loads((tmp_path / "r.json").read_text())["study"] == "paper"


def test_a_folder_of_the_studys_name_that_holds_none_is_not_taken_for_it(
    surefoot, monkeypatch, tmp_path, study_folder
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    page = tmp_path / "page.md"
    page.write_text("without a place\n")
    json_file = tmp_path / "r.json"
    asked = ("report", "mine", "--no-film-policies", "--tables", page, "--json", json_file)
    assert surefoot(*asked) == 2  # before anything is drawn
    assert not (study_folder / "report.html").exists()


def test_claims_stand_in_the_page_that_was_asked_for(surefoot, tmp_path, monkeypatch):
    # That page has no figures, and drawing them takes most of a report's time.
    monkeypatch.setattr(study_page, "draw_all", lambda figures, folder: [NOTHING] * len(figures))
    folder = write_study(tmp_path / "paper", paper_like(1), iterations=1)
    page = tmp_path / "claims.md"
    assert surefoot("report", folder, "--no-film-policies", "--tables", page) == 0
    text = page.read_text()
    assert "LocoSafeDAGGER fails in less than 5 %" in text
    assert "finished runs" in text


@pytest.mark.parametrize("option", ["--json", "--tables"])
def test_an_output_never_replaces_what_the_report_is_of(
    surefoot, capsys, study_folder, run_folder, option
):
    for file in (study_folder / "study.json", run_folder / "config.json"):
        before = file.read_bytes()
        assert surefoot("report", file.parent, option, file) == 2
        assert f"{option}: " in capsys.readouterr().err
        assert file.read_bytes() == before


def test_a_run_has_a_model_card_where_it_was_asked_for(surefoot, capsys, run_folder, tmp_path):
    out = tmp_path / "card"
    assert surefoot("report", run_folder, "--out", out, "--json", tmp_path / "r.json") == 0
    assert "Model card" in (out / "report.html").read_text()
    assert json.loads((tmp_path / "r.json").read_text())["method"] == "loco_safe_dagger"


def test_a_folder_without_either_is_an_error(surefoot, capsys, tmp_path):
    assert surefoot("report", tmp_path) == 2
    assert "neither a study (study.json) nor a run (config.json)" in capsys.readouterr().err


def test_results_of_several_commits_are_refused(surefoot, capsys, study_folder):
    [job] = (study_folder / "behavior_cloning/seed-0/jobs").glob("test*.json")
    job.write_text(job.read_text().replace("c0ffee", "decaf0"))
    assert surefoot("report", study_folder) == 2
    assert "several commits (c0ffee, decaf0)" in capsys.readouterr().err


def test_results_of_several_precisions_are_refused(surefoot, capsys, study_folder):
    [job] = (study_folder / "behavior_cloning/seed-0/jobs").glob("test*.json")
    job.write_text(job.read_text().replace('"float32"', '"bfloat16"'))
    assert surefoot("report", study_folder) == 2
    assert "several precisions (bfloat16, float32)" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--json", "--tables"])
def test_an_output_never_replaces_the_page(
    surefoot, capsys, study_folder, run_folder, tmp_path, option
):
    out = tmp_path / "rp"
    out.mkdir()
    page = out / "report.html"
    page.write_text("the page")
    for folder in (study_folder, run_folder):
        assert surefoot("report", folder, "--out", out, option, page) == 2
        assert "is the file of --out (its page) too" in capsys.readouterr().err
        assert page.read_text() == "the page"


def test_a_folder_that_cannot_be_is_refused_before_anything_is_drawn(
    surefoot, capsys, run_folder, tmp_path, monkeypatch
):
    monkeypatch.setattr("surefoot.study.report.run_card.run_card", lambda folder: 1 / 0)
    file = tmp_path / "card.html"
    file.touch()
    assert surefoot("report", run_folder, "--out", file) == 2
    assert "--out (its page): " in capsys.readouterr().err


def test_the_tables_of_a_run_are_refused(surefoot, capsys, run_folder, tmp_path):
    page = tmp_path / "t.md"
    assert surefoot("report", run_folder, "--out", tmp_path / "card", "--tables", page) == 2
    assert "--tables is for a study" in capsys.readouterr().err
    assert not (tmp_path / "card").exists()
