"""The cells of a survey of robots and gaits: their files, their order and their table."""

from dataclasses import replace

import pytest

from surefoot.files import write_json
from surefoot.study.robot_cells import Use, in_order, read_cells, survey_page
from tests.fakes.surveys import WALKED, gait_cell


def test_cells_come_back_from_their_files(tmp_path):
    walked = gait_cell("go2", "bound", "bullet", reason="falls")
    lies = gait_cell("hyq", "pace", walked=None, reason="falls")
    for cell in (walked, lies):
        write_json(tmp_path / cell.file, cell)
    assert read_cells(tmp_path) == {
        "go2-bound-bullet.json": walked,
        "hyq-pace-mujoco.json": lies,
    }
    assert read_cells(tmp_path / "missing") == {}


def test_a_file_that_is_no_cell_is_named(tmp_path):
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ValueError, match=r"other\.json"):
        read_cells(tmp_path)


def test_the_packages_robots_come_first_and_gaits_and_simulators_in_their_order():
    names = ["my_dog", "go2", "solo12"]
    cells = [gait_cell(name, "bound") for name in names]
    cells += [gait_cell("go2", "trot", "bullet"), gait_cell("go2", "trot")]
    ordered = [(cell.robot, cell.gait, cell.simulator) for cell in in_order(cells).cells]
    assert ordered == [
        ("solo12", "bound", "mujoco"),
        ("go2", "trot", "mujoco"),
        ("go2", "trot", "bullet"),
        ("go2", "bound", "mujoco"),
        ("my_dog", "bound", "mujoco"),
    ]


def test_the_table_has_what_was_measured():
    lines = survey_page(in_order([gait_cell()])).splitlines()
    assert lines[0] == "20 perturbed initial states each, 5 s; one core."
    assert lines[-1] == (
        "| go2 | trot | mujoco | -0.3 to 0.6, -0.2 to 0.2, -0.5 to 0.5 | 3.3 (4.0) "
        "| 19 of 20 (76.4 to 99.1 %) | 1, 0, 0 "
        "| 0.001, 0.002, 0.003 (0.010, 0.020, 0.040) | 0.50 (0.75) | 0.80 (1.10) |"
    )


def test_a_speed_limit_that_is_exceeded_is_said_in_bold_with_the_share_of_the_time():
    fast = replace(WALKED, speed=Use(1.3, 2.0, 0.125))
    page = survey_page(in_order([gait_cell(walked=fast)]))
    assert page.endswith("| **1.30 (2.00), 12.5 %** |")


def test_what_was_not_measured_is_a_dash():
    fell = replace(WALKED, tracking=None, torque=None, speed=None)
    assert survey_page(in_order([gait_cell(walked=fell)])).endswith("| - | - | - |")
    assert survey_page(in_order([])).startswith("Nothing has been measured yet.")


def test_reasons_are_said_below_the_table():
    cells = [
        gait_cell("go2", "crawl", reason="falls\nat 0.6"),
        gait_cell("go2", "pace", walked=None, reason="falls on the spot"),
    ]
    page = survey_page(in_order(cells))
    table, smaller, not_walked = page.partition("In a smaller box")[0], *page.split("\n\n")[-3::2]
    assert "pace" not in table
    assert smaller == "- go2, crawl, mujoco: falls at 0.6"
    assert not_walked == "- go2, pace, mujoco: falls on the spot"
