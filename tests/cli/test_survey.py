"""The command survey: its options, and the files that it writes."""

import json
import re

import pytest

import surefoot.study.robot_survey as module
from surefoot.cli.survey import Survey
from surefoot.config.gait_table import GAITS
from surefoot.config.robot_table import ROBOTS
from surefoot.study.robot_cells import GaitCell, RobotSurvey, Walked
from surefoot.study.robot_survey import SurveyPlan
from tests.fakes.surveys import gait_cell


@pytest.fixture
def asked(monkeypatch) -> list:
    """What was to be measured; a survey of two cells comes of it."""
    calls = []

    def survey_robots(plan, folder, workers):
        calls.append((plan, folder, workers.count))
        return RobotSurvey((gait_cell(), gait_cell("go2", "pace", walked=None, reason="falls")))

    monkeypatch.setattr(module, "survey_robots", survey_robots)
    return calls


def test_without_options_every_robot_is_measured_in_every_gait(surefoot, asked, tmp_path):
    assert surefoot("survey", "--out", tmp_path / "cells") == 0
    [(plan, folder, _)] = asked
    assert plan == SurveyPlan(tuple(ROBOTS), tuple(GAITS), ("mujoco",), 100, 5.0)
    assert folder == tmp_path / "cells"


def test_options_are_heard(surefoot, asked, tmp_path):
    options = ("--robots", "go2", "a1", "--gaits", "trot", "--episodes", 7, "--seconds", 2)
    more = ("--sim", "both", "--workers", 1, "--out", tmp_path)
    assert surefoot("survey", *options, *more) == 0
    plan = SurveyPlan(("go2", "a1"), ("trot",), ("mujoco", "bullet"), 7, 2.0)
    assert asked == [(plan, tmp_path, 1)]


def test_the_table_is_printed_and_put_into_the_page_and_the_prose_stays(
    surefoot, asked, capsys, tmp_path
):
    page = tmp_path / "robots.md"
    page.write_text("before\n<!-- table -->\nold\n<!-- end of table -->\nafter\n")
    report = tmp_path / "robots.json"
    options = ("--out", tmp_path / "cells", "--page", page, "--json", report)
    assert surefoot("survey", *options) == 0
    table = capsys.readouterr().out
    assert "| go2 | trot | mujoco |" in table
    assert page.read_text() == (f"before\n<!-- table -->\n{table}<!-- end of table -->\nafter\n")
    cells = json.loads(report.read_text())["cells"]
    assert [cell["walked"] is None for cell in cells] == [False, True]


def test_a_page_without_a_place_for_the_table_is_refused_before_any_work(
    surefoot, asked, capsys, tmp_path
):
    page = tmp_path / "robots.md"
    page.write_text("no place")
    assert surefoot("survey", "--out", tmp_path / "cells", "--page", page) == 2
    assert "has no place for the tables" in capsys.readouterr().err
    assert asked == []


def test_a_report_among_the_cells_is_refused(surefoot, asked, capsys, tmp_path):
    assert surefoot("survey", "--out", tmp_path, "--json", tmp_path / "all.json") == 2
    assert "would lie among the cells" in capsys.readouterr().err
    assert asked == []


def test_a_time_that_is_none_is_refused(surefoot, asked, capsys, tmp_path):
    assert surefoot("survey", "--out", tmp_path, "--seconds", 0) == 2
    assert "--seconds 0" in capsys.readouterr().err


@pytest.mark.parametrize("record", [GaitCell, Walked])
def test_the_help_names_every_json_key(record):
    words = set(re.findall(r"\w+", Survey.__doc__ or ""))
    assert set(record.__dataclass_fields__) <= words
