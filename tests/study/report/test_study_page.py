"""The page of a study: every number is the stored one; names cannot break it; verdicts."""

from dataclasses import replace

import pytest

from surefoot.config.json_io import read_json, to_json
from surefoot.files import write_json
from surefoot.runs.layout import CONFIG_FILE
from surefoot.study.folder import Judged, JudgedPrediction, StudyError
from surefoot.study.layout import JUDGED_FILE
from surefoot.study.report import numbers, verdicts
from surefoot.study.report.study_page import study_report, write_study_report
from surefoot.study.report.tables import figure_tables
from surefoot.study.report.verdicts import JudgedSentence
from surefoot.study.results import read_results
from tests.fakes.pages import Page, check_numbers


@pytest.fixture(scope="module")
def written(study_folder, tmp_path_factory):
    """The folder of a report, and its page."""
    out = tmp_path_factory.mktemp("report")
    results = read_results(study_folder)
    path = write_study_report(results, study_report(results), out)
    return out, Page(path.read_text()), path.read_text()


def test_every_number_on_the_page_is_the_stored_one(written, study_folder):
    _, page, _ = written
    assert len(page.numbers) > 500
    check_numbers(page, study_folder)


def test_a_changed_result_is_noticed(written, own_study):
    _, page, _ = written
    file = own_study / "loco_safe_dagger/seed-0/tests/test.json"
    file.write_text(file.read_text().replace('"successes": 8', '"successes": 7'))
    with pytest.raises(AssertionError):
        check_numbers(page, own_study)


def tables_of_figures(results) -> str:
    """The tables of all figures of a report."""
    return "".join(figure_tables(figure) for figure in study_report(results).figures)


def test_a_wrong_interval_is_noticed(monkeypatch, study_folder):
    """The check of a page's intervals shares nothing with the code that computes them."""
    results = read_results(study_folder)
    check_numbers(Page(tables_of_figures(results)), study_folder)
    right = numbers.mean_of_runs

    def too_wide(runs):
        means = right(runs)
        if means.interval is None:
            return means
        low, high = means.interval
        return replace(means, interval=(low, high + 0.01))

    monkeypatch.setattr(numbers, "mean_of_runs", too_wide)
    with pytest.raises(AssertionError):
        check_numbers(Page(tables_of_figures(results)), study_folder)


def test_names_cannot_break_the_page(written):
    _, page, text = written
    assert "<b>" not in text and "<of" not in text
    assert '<b>"Safe" & sound</b> $x$' in page.text
    assert "a processor <of 2 & more cores>" in page.text


def test_the_page_needs_nothing_else(written):
    _, page, text = written
    assert page.external == []
    assert "default-src 'none'" in text
    assert len(page.ids) == len(set(page.ids))
    assert page.tables > 10 and page.headers > 3 * page.tables


def test_what_is_missing_is_listed(written):
    _, page, _ = written
    assert "loco_dagger-0.8/seed-1" in page.text
    assert "8 of 9 complete" in page.text


def test_figures_are_files_too(written):
    out, _, _ = written
    names = {path.name for path in (out / "figures").iterdir()}
    for name in ("1-failures", "2-expert-share", "3-success-test", "5-pushes-push"):
        assert {f"{name}.png", f"{name}.pdf"} <= names
    assert (out / "figures/1-failures.png").read_bytes().startswith(b"\x89PNG")


ALL = pytest.param(slice(None), marks=pytest.mark.thorough)


@pytest.mark.parametrize("figures", [slice(1), ALL])
def test_the_same_results_give_the_same_page(study_folder, tmp_path, figures):
    """With one of the figures, which takes a few seconds, or with all."""
    texts = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        results = read_results(study_folder)
        report = study_report(results)
        report = replace(report, figures=report.figures[figures])
        texts.append(write_study_report(results, report, folder).read_text())
    assert "<svg" in texts[0]
    assert texts[0] == texts[1]


def test_claims_and_comparisons_stand_with_their_verdicts(monkeypatch, study_folder, tmp_path):
    claim = JudgedSentence("Under 5 % fail.", "V-A", "does not hold", "7.5 %", "over <5 %")
    outcome = JudgedSentence(
        "BC withstands less.", "in a storm", "cannot tell", "0.1 N s", "p = 0.4"
    )
    monkeypatch.setattr(verdicts, "paper_claims", lambda results: (claim,))
    monkeypatch.setattr(verdicts, "comparison_outcomes", lambda results: (outcome,))
    results = read_results(study_folder)
    report = study_report(results)
    assert report.verdicts.claims == (claim,) and report.verdicts.comparisons == (outcome,)
    without_figures = replace(report, figures=())
    page = Page(write_study_report(results, without_figures, tmp_path).read_text())
    for text in (
        "Under 5 % fail.",
        "V-A",
        "in a storm",
        "✗ does not hold",
        "? cannot tell",
        "over <5 %",
    ):
        assert text in page.text


def test_the_records_are_json(study_folder):
    values = to_json(study_report(read_results(study_folder)))
    number = values["figures"][0]["rows"][0][0]["curves"][0]["groups"][0]["estimate"]["mean"]
    assert set(number) == {"value", "source", "trials"}


def test_a_run_that_differs_from_others_of_its_technique_is_refused(own_study):
    """In what the study does not name too."""
    path = own_study / "loco_safe_dagger/seed-1" / CONFIG_FILE
    values = read_json(path)
    values["config"]["training"]["learning_rate"] *= 2
    write_json(path, values)
    with pytest.raises(StudyError, match=r"seed-1 and .*seed-0 are of different configurations"):
        read_results(own_study)


def test_predictions_stand_beside_what_came_of_them(own_study, tmp_path):
    [first, *others] = read_results(own_study).study.predictions
    judged = Judged((JudgedPrediction(first, "false <b>", "1 & 2 of 5"),))
    write_json(own_study / JUDGED_FILE, judged)
    results = read_results(own_study)
    report = study_report(results)
    assert report.predictions[0] == judged.predictions[0]
    without_figures = replace(report, figures=())
    page = Page(write_study_report(results, without_figures, tmp_path / "report").read_text())
    assert "false <b>" in page.text and "1 & 2 of 5" in page.text
    assert page.text.count("not judged yet") == len(others)


def test_a_prediction_is_judged_once(own_study):
    [first, *_] = read_results(own_study).study.predictions
    each = JudgedPrediction(first, "true", "")
    write_json(own_study / JUDGED_FILE, Judged((each, replace(each, verdict="false"))))
    with pytest.raises(StudyError, match="judges a prediction twice"):
        study_report(read_results(own_study))


def test_a_judgement_of_what_was_not_predicted_is_refused(own_study):
    judged = Judged((JudgedPrediction("It flies.", "true", "it did"),))
    write_json(own_study / JUDGED_FILE, judged)
    with pytest.raises(StudyError, match=r"judges 'It flies\.', which study\.json does not"):
        study_report(read_results(own_study))
