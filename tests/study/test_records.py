"""Records of comparisons: files of this version and of earlier ones, and what cannot be read."""

import json
from pathlib import Path

import pytest

from surefoot.config.json_io import read_record
from surefoot.files import write_json
from surefoot.study.markdown_text import page_with
from surefoot.study.records import Comparison
from surefoot.study.tables import comparison_tables
from tests.fakes.comparisons import measure, pretend_measurements

DOCS = Path(__file__).parents[2] / "docs"
DATA = Path(__file__).parents[1] / "data"


def test_the_published_comparison_gives_the_published_tables():
    comparison = read_record(DOCS / "methods.json", Comparison)
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
    write_json(tmp_path / "again.json", read_record(path, Comparison))
    before = json.loads(path.read_text())
    after = json.loads((tmp_path / "again.json").read_text())
    for key in ("rows", "episodes", "versions", "starts", "baseline"):
        assert after[key] == before[key]


def test_a_comparison_of_an_early_version_loses_nothing(tmp_path):
    path = DATA / "early_comparison.json"
    write_json(tmp_path / "again.json", read_record(path, Comparison))
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
    with pytest.raises(ValueError, match=f"methods.json is no Comparison.*{message}"):
        read_record(path, Comparison)
