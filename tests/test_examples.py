"""The programs in `examples/` run, are short, and are the programs that the README shows."""

import re
import runpy
from ast import literal_eval
from pathlib import Path

import pytest

from surefoot import Outcome

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
IN_README = ("own_expert.py", "clone_expert.py")
"""The examples that the README shows, in its order."""


def run_example(name, tmp_path, monkeypatch, capsys):
    """Run an example in an empty folder; the outcomes that its last line lists."""
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(ROOT / "examples" / name), run_name="__main__")
    return literal_eval(capsys.readouterr().out.strip().splitlines()[-1])


def test_a_plan_that_holds_a_pose_stands_still(tmp_path, monkeypatch, capsys):
    outcomes = run_example("own_expert.py", tmp_path, monkeypatch, capsys)
    assert outcomes == ["STALLED"] * 20


def test_a_policy_is_cloned_and_drives(tmp_path, monkeypatch, capsys):
    outcomes = run_example("clone_expert.py", tmp_path, monkeypatch, capsys)
    assert len(outcomes) == 20
    assert set(outcomes) <= {outcome.name for outcome in Outcome}
    assert (tmp_path / "policy.safetensors").is_file()


def test_every_example_is_run_here():
    assert {example.name for example in EXAMPLES} == {"own_expert.py", "clone_expert.py"}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_an_example_is_shorter_than_100_lines(example):
    assert len(example.read_text().splitlines()) < 100


def test_the_readme_shows_the_examples_as_they_are():
    readme = (ROOT / "README.md").read_text()
    programs = re.findall(r"```python\n(.*?)```", readme, flags=re.DOTALL)
    assert programs == [(ROOT / "examples" / name).read_text() for name in IN_README]
