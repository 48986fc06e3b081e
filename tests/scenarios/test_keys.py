"""Keys change with what decides the bits, and with nothing else."""

import ast
import os
from dataclasses import replace
from pathlib import Path

import pytest

import surefoot
from surefoot.config import Config, SimulationConfig
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios.keys import FOLDERS, MODULES, code_hash, ingredients_of


def test_the_terrain_has_no_part_in_what_is_prepared_on_the_plane():
    config = with_own_values(Config())
    hills = replace(config, simulation=SimulationConfig(terrain="slope:5"))
    assert ingredients_of(hills) == ingredients_of(config)
    rough = replace(config, simulation=SimulationConfig(friction=0.7))
    assert ingredients_of(rough) != ingredients_of(config)


@pytest.mark.parametrize("name", [*MODULES, "mpc/planner.py", "sim/new.py"])
def test_the_hash_of_the_code_changes_with_each_module_that_decides(name, tmp_path, monkeypatch):
    for folder in (*FOLDERS, "config"):
        (tmp_path / folder).mkdir()
    for each in (*MODULES, "files.py", "mpc/planner.py"):
        (tmp_path / each).write_text("")
    monkeypatch.setattr(surefoot, "__file__", str(tmp_path / "__init__.py"))
    before = code_hash()
    (tmp_path / "files.py").write_text("x = 1")
    assert code_hash() == before
    (tmp_path / name).write_text("x = 1")
    assert code_hash() != before


WITHOUT_PART = {
    "": "the package's own folder",
    "caches": "says where files are kept",
    "errors": "texts of errors",
    "files": "writes files",
    "config.array_io": "reads files",
    "config.json_io": "reads files",
    "config.json_text": "reads files",
    "config": "its records are in the key, by their values",
    "config.checked": "checks records",
    "config.expert_rules": "its rules are in the key, by their values",
    "config.gait_table": "values",
    "config.learning": "values",
    "config.mpc": "values",
    "config.profiles": "values",
    "config.robot_table": "values",
    "config.robots": "values",
    "config.safety": "values",
    "config.scenarios": "values",
    "config.sim": "values",
    "config.single_gaits": "values",
}
"""What the deciding code imports, and why a change of it has no part in what is prepared."""


def test_the_hash_covers_all_code_that_the_deciding_code_imports():
    package = Path(surefoot.__file__).parent
    paths = [path for folder in FOLDERS for path in (package / folder).glob("*.py")]
    paths += [package / name for name in MODULES]
    imported = set()
    for path in paths:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom):
                names = [f"{node.module}.{alias.name}" for alias in node.names]
                modules = [name for name in names if is_module(package, name)]
                imported |= {*modules, node.module}
            elif isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
    own = {name.removeprefix("surefoot").strip(".") for name in imported if is_ours(name)}
    outside = {name for name in own if name.split(".")[0] not in FOLDERS}
    hashed = {name.removesuffix(".py").replace("/", ".") for name in MODULES}
    assert outside - hashed <= set(WITHOUT_PART)
    assert "config.gait_clock" in outside


def is_ours(name: str) -> bool:
    return name.split(".")[0] == "surefoot"


def is_module(package: Path, name: str) -> bool:
    return is_ours(name) and (package.parent / f"{name.replace('.', '/')}.py").is_file()


def test_more_folders_may_decide(tmp_path, monkeypatch):
    for name in (*FOLDERS, "config", "rollouts"):
        (tmp_path / name).mkdir()
    for name in MODULES:
        (tmp_path / name).write_text("")
    monkeypatch.setattr(surefoot, "__file__", str(tmp_path / "__init__.py"))
    before = code_hash(), code_hash((*FOLDERS, "rollouts"))
    (tmp_path / "rollouts" / "engine.py").write_text("x = 1")
    assert code_hash() == before[0]
    assert code_hash((*FOLDERS, "rollouts")) != before[1]


MODULE = '''"""A module."""

N = 3
"""A number."""


def twice(x):
    """Twice x."""
    # It is a sum.
    return x + x


SIGN = "#3"  # a text
'''
PROSE = '''"""A module that says

more."""

N = 3
"""A number: three."""

def twice(x):
    """Return x twice."""


    # A product would do.
    # It is a sum.
    return x + x  # which is even


SIGN = "#3"  # the third
'''


def test_comments_and_docstrings_are_no_code(tmp_path, monkeypatch):
    for name in (*FOLDERS, "config"):
        (tmp_path / name).mkdir()
    for name in MODULES:
        (tmp_path / name).write_text("")
    monkeypatch.setattr(surefoot, "__file__", str(tmp_path / "__init__.py"))
    hashes = []
    others = [MODULE.replace("x + x", "2 * x"), MODULE.replace("#3", "#4")]
    for number, text in enumerate([MODULE, PROSE, *others]):
        path = tmp_path / FOLDERS[0] / "module.py"
        path.write_text(text)
        os.utime(path, ns=(number, number))
        hashes.append(code_hash())
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 3
