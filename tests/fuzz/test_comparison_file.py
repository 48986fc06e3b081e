"""Damaged results of comparisons, surveys and evaluations: an error that names the file."""

import json
from functools import partial
from pathlib import Path

from surefoot.config.json_io import read_record, to_json
from surefoot.evaluation.report import EvaluationReport, read_report
from surefoot.study.expert_cells import Survey
from surefoot.study.records import Comparison
from tests.fakes.results import robustness
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz, json_texts

DOCS = Path(__file__).parents[2] / "docs"


def short(values):
    """The published results with the first two of their rows or cells, to be quick."""
    return values | {name: values[name][:2] for name in ("rows", "cells") if name in values}


def test_a_comparison_of_another_shape(tmp_path):
    values = short(json.loads((DOCS / "methods.json").read_text()))

    def check(damaged):
        check_loader(
            partial(read_record, kind=Comparison), tmp_path / "methods.json", damaged, ValueError
        )

    check(json.dumps(values).encode())
    fuzz(json_texts(values), check, 20)


def test_damaged_bytes_of_a_comparison(tmp_path):
    content = json.dumps(short(json.loads((DOCS / "methods.json").read_text()))).encode()

    def check(damaged):
        check_loader(
            partial(read_record, kind=Comparison), tmp_path / "methods.json", damaged, ValueError
        )

    fuzz(byte_mutations(content), check, 20)


def test_a_survey_of_another_shape(tmp_path):
    values = short(json.loads((DOCS / "expert.json").read_text()))

    def check(damaged):
        check_loader(
            partial(read_record, kind=Survey), tmp_path / "survey.json", damaged, ValueError
        )

    check(json.dumps(values).encode())
    fuzz(json_texts(values), check, 25)


def test_an_evaluation_of_another_shape(tmp_path):
    report = EvaluationReport(
        **vars(robustness(3, 4)),
        policy="runs/demo/policies/002.safetensors",
        simulator="bullet",
        disturbance={"delay": 3, "friction": (0.6, 0.7)},
    )

    def check(damaged):
        check_loader(read_report, tmp_path / "evaluation-test.json", damaged, ValueError)

    check(json.dumps(to_json(report)).encode())
    fuzz(json_texts(to_json(report)), check)
