"""Records of studies: files of this version and of earlier ones, and what cannot be read."""

import json
from pathlib import Path

import pytest

from surefoot.evaluation.push_limits import PushResult
from surefoot.files import write_json
from surefoot.study.expert_survey import survey_table
from surefoot.study.records import read_comparison, read_survey, write_survey
from surefoot.study.tables import comparison_tables, page_with
from tests.fakes.comparisons import measure, pretend_measurements

DOCS = Path(__file__).parents[2] / "docs"
DATA = Path(__file__).parents[1] / "data"


def test_the_published_comparison_gives_the_published_tables():
    comparison = read_comparison(DOCS / "methods.json")
    page = DOCS / "methods.md"
    assert page_with(comparison_tables(comparison), page) == page.read_text()


LATER = {
    "body_contacts": None,
    "body_contact_successes": None,
    "initial_states": "",
    "touched": "",
    "lost_at": [],
    "latching": None,
    "covered": None,
    "gaits": None,
}
"""What evaluations of early versions do not hold yet."""


def test_the_published_comparison_is_read_as_it_is(tmp_path):
    path = DOCS / "methods.json"
    write_json(tmp_path / "again.json", read_comparison(path))
    before = json.loads(path.read_text())
    after = json.loads((tmp_path / "again.json").read_text())
    for key in ("rows", "episodes", "versions", "starts", "baseline"):
        assert after[key] == before[key]


def test_a_comparison_of_an_early_version_loses_nothing(tmp_path):
    path = DATA / "early_comparison.json"
    write_json(tmp_path / "again.json", read_comparison(path))
    before = json.loads(path.read_text())
    after = json.loads((tmp_path / "again.json").read_text())
    for row in before["rows"]:
        for differences in row["differences"].values():
            for to in ("expert", "baseline"):
                differences.setdefault(to, None)
        for measured in row["results"].values():
            measured["evaluation"] = LATER | measured["evaluation"]
            measured["pushes"] = {"measured": None} | measured["pushes"]
        if row["cost"] is not None:
            row["cost"]["seconds"]["gates"] = row["cost"]["seconds"].pop("guards")
    assert after["rows"] == before["rows"]
    for key in ("episodes", "versions", "starts", "baseline"):
        assert after[key] == before[key]


def test_the_published_survey_gives_the_published_table():
    survey = read_survey(DOCS / "expert.json")
    page = (DOCS / "expert.md").read_text()
    rows = survey_table(survey).splitlines()[2:]
    assert len(rows) == 8
    for row in rows:
        assert row in page


def test_the_published_survey_loses_nothing_but_a_count(tmp_path):
    write_survey(tmp_path / "again.json", read_survey(DOCS / "expert.json"))
    before = json.loads((DOCS / "expert.json").read_text())
    after = json.loads((tmp_path / "again.json").read_text())
    for cell in before["cells"]:
        assert cell["push"].pop("unpushed_successes") == 40
    for key in ("episodes", "versions", "starts", "cells", "lost_by_all"):
        assert after[key] == before[key]


def test_a_survey_of_this_version_keeps_the_outcome_of_every_robot(tmp_path):
    values = json.loads((DOCS / "expert.json").read_text())
    robots = {
        "split": "nominal",
        "lost_before": 0,
        "share": 0.8,
        "survived": [["1" * count + "0" * (40 - count) for count in (40, 39)]],
        "interval": [[1.0, 2.0]],
        "mean_interval": [1.0, 2.0],
    }
    for cell in values["cells"]:
        del cell["push"]["unpushed_successes"]
        cell["push"] |= robots | {"levels": [[0.0, 1.0]], "successes": [[40, 39]]}
    path = tmp_path / "survey.json"
    path.write_text(json.dumps(values))
    survey = read_survey(path)
    push = survey.cells[0].push
    assert isinstance(push, PushResult)
    assert push.survived == (("1" * 40, "1" * 39 + "0"),)
    write_survey(path, survey)
    assert read_survey(path) == survey


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda values: values["rows"][1].update(labl="x"), "labl.*did you mean.*label"),
        (lambda values: values["rows"][1].pop("label"), "lacks label"),
        (lambda values: values.pop("rows"), "rows"),
        (lambda values: values["rows"][1]["cost"].update(plans="many"), "cost.plans is 'many'"),
        (lambda values: values.update(rows=3), "rows is 3, expected a list"),
        (lambda values: values.update(rows=[3]), r"rows\[0\] is 3, expected an object"),
        (lambda values: values["rows"][1].update(cost=[]), r"rows\[1\].cost is \[\]"),
        (lambda values: values["rows"][1].update(results=[]), r"rows\[1\].results is \[\]"),
        (
            lambda values: values["rows"][1]["results"]["mujoco"]["evaluation"].update(
                outcomes="0x00"
            ),
            "outcomes must be 4 digits out of 0123",
        ),
        (
            lambda values: values["rows"][1]["results"]["mujoco"]["pushes"].update(
                survived=[["1", "11"], ["11", "11"]]
            ),
            "survived must have 2 digits",
        ),
    ],
)
def test_unknown_and_missing_keys_of_a_comparison_are_named(
    monkeypatch, runs, tmp_path, change, message
):
    pretend_measurements(monkeypatch)
    path = tmp_path / "methods.json"
    measure(runs, path)
    values = json.loads(path.read_text())
    change(values)
    path.write_text(json.dumps(values))
    with pytest.raises(ValueError, match=f"methods.json is no comparison.*{message}"):
        read_comparison(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda values: values["cells"][0].update(rule="own"), "rule.*did you mean.*rules"),
        (lambda values: values["cells"][0].pop("stalls"), "stalls"),
        (lambda values: values["cells"][0]["push"].pop("levels"), "push lacks levels"),
        (lambda values: values.pop("cells"), "cells"),
        (lambda values: values.update(cells={}), "cells is {}, expected a list"),
        (lambda values: values.update(cells=[None]), r"cells\[0\] is None, expected an object"),
        (lambda values: values["cells"][0].update(push=[]), r"cells\[0\].push is \[\]"),
    ],
)
def test_unknown_and_missing_keys_of_a_survey_are_named(tmp_path, change, message):
    values = json.loads((DOCS / "expert.json").read_text())
    change(values)
    path = tmp_path / "survey.json"
    path.write_text(json.dumps(values))
    with pytest.raises(ValueError, match=f"survey.json is no survey.*{message}"):
        read_survey(path)
