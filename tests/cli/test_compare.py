"""The command compare: tables and a picture, and errors before any work."""

import json
import shutil
import sys

import pytest


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
