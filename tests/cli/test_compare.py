"""The command compare: tables and a picture, and errors before any work."""

import json
import shutil
import sys

import pytest

from surefoot.cli.compare import parse_compare
from surefoot.study import comparison


@pytest.fixture
def other_run(run_folder, tmp_path):
    """A second run, with another last policy."""
    folder = tmp_path / "other"
    shutil.copytree(run_folder, folder)
    shutil.copy(folder / "policies/000.safetensors", folder / "policies/001.safetensors")
    return folder


def test_a_page_without_a_place_for_tables_is_refused(surefoot, capsys, run_folder, tmp_path):
    page = tmp_path / "methods.md"
    page.write_text("prose")
    file = tmp_path / "figures.json"
    assert surefoot("compare", run_folder, "--workers", 1, "--json", file, "--out", page) == 2
    assert "no place for the tables" in capsys.readouterr().err
    assert not file.exists()  # said before anything was measured


@pytest.mark.parametrize(
    ("option", "name", "message"),
    [
        ("--figure", "methods.xyz", "methods.xyz must end in .png or .svg"),
        ("--figure", "", "is a folder, and cannot be written"),
        ("--json", "", "is a folder, and cannot be written"),
        ("--out", "", "is a folder, and cannot be written"),
    ],
)
def test_outputs_are_checked_before_any_work(
    surefoot, capsys, monkeypatch, run_folder, tmp_path, option, name, message
):
    monkeypatch.setattr(comparison, "compare", None)  # nothing is measured
    path = tmp_path / name if name else tmp_path
    assert surefoot("compare", run_folder, "--workers", 1, option, path) == 2
    error = capsys.readouterr().err
    assert f"surefoot: {option}: " in error
    assert message in error


def test_without_pybullet_the_option_for_mujoco_is_named(surefoot, capsys, monkeypatch, run_folder):
    monkeypatch.setattr(comparison, "compare", None)  # nothing is measured
    monkeypatch.delitem(sys.modules, "surefoot.sim.bullet", raising=False)
    monkeypatch.setitem(sys.modules, "pybullet", None)
    assert surefoot("compare", run_folder, "--workers", 1) == 2
    assert "--sim mujoco" in capsys.readouterr().err


def test_options_without_pushes_are_an_error(surefoot, capsys, run_folder):
    assert surefoot("compare", run_folder, "--no-pushes", "--push-speeds", 2) == 2
    assert "--push-speeds without pushes; leave --no-pushes out" in capsys.readouterr().err


def test_the_default_disturbance_is_that_of_the_first_run(run_folder, tmp_path):
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    setup = json.loads((folder / "config.json").read_text())
    setup["config"]["evaluation"]["disturbance"]["delay"] = 9
    (folder / "config.json").write_text(json.dumps(setup))
    assert parse_compare([str(folder)]).disturbance.delay == 9
    assert parse_compare([str(folder), "--disturbance.delay", "0"]).disturbance.delay == 0
    wide = parse_compare([str(folder), str(run_folder), "--starts", "solo12-trot-v1-wide"])
    assert (wide.starts, wide.disturbance.delay) == ("solo12-trot-v1-wide", 9)
    assert wide.runs == (folder, run_folder)


def test_initial_states_and_disturbance_are_written(surefoot, capsys, run_folder, tmp_path):
    file = tmp_path / "figures.json"
    page = tmp_path / "page.md"
    figure = tmp_path / "figure.svg"
    args = ("compare", run_folder, "--policy", "last", "--sim", "mujoco", "--no-pushes")
    args = (*args, "--episodes", 2, "--workers", 1, "--json", file, "--starts")
    wide = "solo12-trot-v1-wide"
    delay = ("--disturbance.delay", 3)
    assert surefoot(*args, wide, *delay, "--out", page, "--figure", figure) == 0
    written = json.loads(file.read_text())
    assert list(written["starts"]) == [wide]
    assert written["config"]["evaluation"]["disturbance"]["delay"] == 3
    assert f"states of {wide}, disturbed: delay 3;" in page.read_text(encoding="utf-8")
    capsys.readouterr()
    assert surefoot(*args, "solo12-trot-v1", *delay) == 2
    assert "holds a comparison of other starts" in capsys.readouterr().err
    assert surefoot(*args, wide) == 2
    assert "evaluation.disturbance.delay is 3, not 0" in capsys.readouterr().err


def test_a_simulator_that_is_missing_is_an_error(
    surefoot, capsys, monkeypatch, run_folder, tmp_path
):
    file = tmp_path / "figures.json"
    monkeypatch.setitem(sys.modules, "surefoot.sim.bullet", None)  # not installed
    assert surefoot("compare", run_folder, "--workers", 1, "--json", file) == 2
    assert "pip install 'surefoot[pybullet]'" in capsys.readouterr().err
    assert not file.exists()


def test_tables_and_a_picture_are_written(surefoot, capsys, run_folder, other_run, tmp_path):
    page = tmp_path / "methods.md"
    figure = tmp_path / "methods.png"
    file = tmp_path / "figures.json"
    page.write_text("# Title\n<!-- table -->\n<!-- end of table -->\nprose\n")
    args = ("compare", run_folder, other_run, "--policy", "last", "--sim", "mujoco", "--no-pushes")
    args = (*args, "--names", "one", "two", "--episodes", 3, "--workers", 1)
    assert surefoot(*args, "--json", file, "--out", page, "--figure", figure) == 0
    text = page.read_text()
    assert text.startswith("# Title\n<!-- table -->\n") and text.endswith("-->\nprose\n")
    assert "| mujoco | two | " in text and "| mujoco | two | " in capsys.readouterr().out
    assert figure.read_bytes().startswith(b"\x89PNG")
    rows = json.loads(file.read_text())["rows"]
    assert [row["label"] for row in rows] == ["expert", "one", "two"]
