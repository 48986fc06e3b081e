"""Records of a survey of the expert: files of this version, and what cannot be read."""

import json
from pathlib import Path

import pytest

from surefoot.config.json_io import read_record
from surefoot.evaluation.push_limits import PushResult
from surefoot.files import write_json
from surefoot.study.expert_cells import Survey, survey_table

DOCS = Path(__file__).parents[2] / "docs"


def test_the_published_survey_gives_the_published_table():
    survey = read_record(DOCS / "expert.json", Survey)
    page = (DOCS / "expert.md").read_text()
    rows = survey_table(survey).splitlines()[2:]
    assert len(rows) == 8
    for row in rows:
        assert row in page


def test_the_published_survey_is_read_as_it_is(tmp_path):
    write_json(tmp_path / "again.json", read_record(DOCS / "expert.json", Survey))
    before = json.loads((DOCS / "expert.json").read_text())
    after = json.loads((tmp_path / "again.json").read_text())
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
        cell["push"] |= robots | {"levels": [[0.0, 1.0]], "successes": [[40, 39]]}
    path = tmp_path / "survey.json"
    path.write_text(json.dumps(values))
    survey = read_record(path, Survey)
    push = survey.cells[0].push
    assert isinstance(push, PushResult)
    assert push.survived == (("1" * 40, "1" * 39 + "0"),)
    write_json(path, survey)
    assert read_record(path, Survey) == survey


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda values: values["cells"][0].update(rule="own"), "rule.*did you mean.*rules"),
        (lambda values: values["cells"][0]["wide"].pop("stalls"), "wide lacks stalls"),
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
    with pytest.raises(ValueError, match=f"survey.json is no Survey.*{message}"):
        read_record(path, Survey)
