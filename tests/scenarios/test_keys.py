"""Keys change with what decides the bits, and with nothing else."""

from dataclasses import replace

import pytest

import surefoot
from surefoot.config import Config, SimulationConfig
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios.keys import MODULES, ROOMS, code_hash, ingredients_of


def test_the_terrain_has_no_part_in_what_is_prepared_on_the_plane():
    config = with_own_values(Config())
    hills = replace(config, simulation=SimulationConfig(terrain="slope:5"))
    assert ingredients_of(hills) == ingredients_of(config)
    rough = replace(config, simulation=SimulationConfig(friction=0.7))
    assert ingredients_of(rough) != ingredients_of(config)


@pytest.mark.parametrize("name", ["types.py", "rotations.py", "mpc/planner.py", "sim/new.py"])
def test_the_hash_of_the_code_changes_with_each_module_that_decides(name, tmp_path, monkeypatch):
    for room in ROOMS:
        (tmp_path / room).mkdir()
    for each in ("types.py", "rotations.py", "files.py", "mpc/planner.py"):
        (tmp_path / each).write_text("")
    monkeypatch.setattr(surefoot, "__file__", str(tmp_path / "__init__.py"))
    before = code_hash()
    (tmp_path / "files.py").write_text("# has no part in it")
    assert code_hash() == before
    (tmp_path / name).write_text("# changed")
    assert code_hash() != before


def test_more_folders_may_decide(tmp_path, monkeypatch):
    for name in (*ROOMS, "rollouts"):
        (tmp_path / name).mkdir()
    for name in MODULES:
        (tmp_path / name).write_text("")
    monkeypatch.setattr(surefoot, "__file__", str(tmp_path / "__init__.py"))
    before = code_hash(), code_hash((*ROOMS, "rollouts"))
    (tmp_path / "rollouts" / "engine.py").write_text("# changed")
    assert code_hash() == before[0]
    assert code_hash((*ROOMS, "rollouts")) != before[1]
