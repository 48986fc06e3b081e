"""The command terrains: its options, and the files that it writes."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

import surefoot.study.terrain_table as module
from surefoot.cli.terrains import Terrains
from surefoot.config import Config, ExpertConfig, OtherGait, RobotConfig
from surefoot.config.gait_table import GAITS
from surefoot.config.robot_table import SOLO12
from surefoot.config.sim import GROUNDS
from surefoot.runs import policies
from surefoot.runs.policies import PACKAGED_POLICY
from surefoot.scenarios import prepare
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.study.terrain_table import TerrainCell, TerrainTable, Walker
from tests.fakes.results import robustness

TABLE = TerrainTable(
    (TerrainCell("k", "flat", "expert", robustness(3, 3, covered=2), (0.01, 0.02)),)
)


@pytest.fixture
def asked(monkeypatch) -> list:
    """What was to be measured; a table of one cell comes of it."""
    calls = []

    def measure_terrains(config, walkers, terrains, workers, known, keep):
        calls.append((walkers, terrains, config.evaluation.episodes, known))
        keep(TABLE)
        return TABLE

    monkeypatch.setattr(module, "measure_terrains", measure_terrains)
    return calls


def test_without_options_the_packaged_policy_is_measured_beside_the_expert(surefoot, asked):
    assert surefoot("terrains") == 0
    walkers = [Walker("expert"), Walker("packaged", Path(PACKAGED_POLICY))]
    assert asked == [(walkers, GROUNDS, 100, TerrainTable())]


def test_options_are_heard_and_files_are_written(surefoot, asked, capsys, tmp_path):
    page = tmp_path / "terrain.md"
    page.write_text("before\n<!-- table -->\nold\n<!-- end of table -->\nafter\n")
    report = tmp_path / "table.json"
    options = ("--names", "flat", "--terrains", "bumps:0.02", "slope:5..10", "--episodes", 3)
    files = ("--json", report, "--page", page)
    assert surefoot("terrains", PACKAGED_POLICY, *options, *files) == 0
    [(walkers, terrains, episodes, _)] = asked
    assert [walker.label for walker in walkers] == ["expert", "flat"]
    assert (terrains, episodes) == (("bumps:0.02", "slope:5..10"), 3)
    table = capsys.readouterr().out
    assert "| `flat` | 3 up, 2 covered; 0.010, 0.020 |" in table
    assert page.read_text() == f"before\n<!-- table -->\n{table}<!-- end of table -->\nafter\n"
    assert json.loads(report.read_text())["cells"][0]["label"] == "expert"
    assert surefoot("terrains", PACKAGED_POLICY, *options, *files) == 0
    assert asked[-1][-1] == TABLE


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--names", "a", "b"), "--names: 2 names for 1 policies; give one for each"),
        (("--json", "table.txt"), "table.txt must end in .json"),
        (("nowhere",), "nowhere: there is no such run folder or policy file"),
    ],
)
def test_what_cannot_be_done_is_refused_before_any_work(
    surefoot, asked, capsys, tmp_path, monkeypatch, options, message
):
    monkeypatch.chdir(tmp_path)
    assert surefoot("terrains", *options) == 2
    assert message in capsys.readouterr().err
    assert asked == []


def test_a_policy_in_no_run_is_prepared(surefoot, asked, monkeypatch, run_folder):
    completed = []
    monkeypatch.setattr(prepare, "completed", lambda config: completed.append(config) or config)
    assert surefoot("terrains", run_folder) == 0
    assert completed == []
    assert surefoot("terrains", PACKAGED_POLICY) == 0
    assert [config.robot.model for config in completed] == ["solo12"]


@pytest.fixture
def two_gaits(monkeypatch, tmp_path):
    """A file that is a policy of two gaits, where the packaged one is of one."""
    states = tmp_path / "bound.npz"
    save_starts(replace(load_starts(), gait=GAITS["bound"]), states)
    gains = ExpertConfig(command_gain=(1.0, 1.0, 1.0))
    found = policies.find_policy

    def find_policy(target):
        path, config = found(PACKAGED_POLICY)
        if target is None or target.name != "several.safetensors":
            return path, config
        return path, replace(config, other_gaits=(OtherGait(GAITS["bound"], gains, str(states)),))

    monkeypatch.setattr(policies, "find_policy", find_policy)
    return Path("several.safetensors")


def test_a_policy_of_several_gaits_is_measured_but_not_beside_one_of_one(
    surefoot, asked, capsys, two_gaits
):
    assert surefoot("terrains", two_gaits) == 0
    assert len(asked) == 1
    assert surefoot("terrains", PACKAGED_POLICY, two_gaits, "--names", "one", "two") == 2
    assert "two is a policy of another robot or other gaits than one" in capsys.readouterr().err
    assert len(asked) == 1


def test_two_robots_of_one_name_are_told_apart(surefoot, asked, capsys, monkeypatch):
    edited = RobotConfig("solo12", spec=replace(SOLO12, foot_radius=0.02))
    found = policies.find_policy

    def find_policy(target):
        path, config = found(PACKAGED_POLICY)
        return path, replace(config, robot=edited) if target == Path("edited") else config

    monkeypatch.setattr(policies, "find_policy", find_policy)
    assert surefoot("terrains", PACKAGED_POLICY, "edited", "--names", "one", "two") == 2
    assert "two is a policy of another robot" in capsys.readouterr().err
    assert asked == []


def test_the_names_of_folders_have_points(surefoot, asked, tmp_path, monkeypatch):
    for name in ("a-0.5", "a-0.8"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr("surefoot.runs.policies.find_policy", lambda _: (PACKAGED_POLICY, Config()))
    monkeypatch.chdir(tmp_path / "a-0.5")
    assert surefoot("terrains", ".", tmp_path / "a-0.8") == 0
    [(walkers, *_)] = asked
    assert [walker.label for walker in walkers] == ["expert", "a-0.5", "a-0.8"]


@pytest.mark.parametrize("record", [TerrainTable, TerrainCell])
def test_the_help_names_every_json_key(record):
    words = set(re.findall(r"\w+", Terrains.__doc__ or ""))
    assert set(record.__dataclass_fields__) <= words


def test_the_file_of_another_process_is_left_alone(surefoot, asked, capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("surefoot.files.lock_file", lambda path: False)
    file = tmp_path / "table.json"
    assert surefoot("terrains", PACKAGED_POLICY, "--json", file) == 2
    assert f"another process is adding results to {file}" in capsys.readouterr().err
    assert not asked
