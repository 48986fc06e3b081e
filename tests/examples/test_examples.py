"""The programs in `examples/` run, are short, and are the programs that the pages show."""

import re
import runpy
from ast import literal_eval
from pathlib import Path

import nbformat
import numpy as np
import pytest
from make_notebook import notebook_of
from nbclient import NotebookClient

from surefoot import Outcome
from surefoot.learning import precision
from tests.cases import first_often

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))
SHOWN = {"README.md": "own_expert.py", "docs/python.md": "clone_expert.py"}
"""The examples that pages show as they are."""
OTHERS = ("first_hour.py", "known_answers.py", "own_world.py", "socket_server.py", "train_ppo.py")
"""The examples of which a test of their own looks at other lines than the last."""
OUTCOMES = {
    "own_expert.py": ["STALLED"] * 20,
    "own_expert_socket.py": ["STALLED"] * 4,
    "own_gait.py": ["SUCCESS"] * 3,
    "own_gate.py": ["SUCCESS"] * 10,
    "own_robot.py": ["SUCCESS"] * 2,
}
"""What examples end with whose robots the expert drives; policies of little data may fall."""


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run an example in an empty folder; the lines that it prints."""

    # `auto` would measure for seconds which precision is faster.
    monkeypatch.setattr(precision, "SECONDS", 0.0)

    def run_it(name):
        monkeypatch.chdir(tmp_path)
        runpy.run_path(str(FOLDER / name), run_name="__main__")
        return capsys.readouterr().out.strip().splitlines()

    return run_it


@pytest.mark.parametrize("name", OUTCOMES)
def test_the_expert_carries_the_robots_of_an_example(run, name):
    assert literal_eval(run(name)[-1]) == OUTCOMES[name]


def test_the_expert_carries_robots_through_worlds_of_which_one_is_uneven(run):
    *worlds, outcomes = run("own_world.py")
    assert literal_eval(outcomes) == ["SUCCESS"] * 5
    rises = [int(re.findall(r"(\d+) mm", line)[0]) for line in worlds]
    assert max(rises[:-1]) <= 2
    assert 5 <= rises[-1] <= 30


@pytest.mark.parametrize("name", first_often(1, ["own_data.py", "clone_expert.py"]))
def test_a_policy_is_trained_and_drives(run, name, tmp_path):
    outcomes = literal_eval(run(name)[-1])
    assert len(outcomes) == 20
    assert set(outcomes) <= {outcome.name for outcome in Outcome}
    assert (tmp_path / "policy.safetensors").is_file()


def test_ppo_trains_and_drives(run):
    (line,) = (line for line in run("train_ppo.py") if line.startswith("return"))
    assert 0.0 < float(re.findall(r"[\d.]+", line)[1]) < 2.0


def test_the_notebook_is_made_of_its_program():
    notebook = (FOLDER / "first_hour.ipynb").read_text()
    # If not: python checks/make_notebook.py examples/first_hour.py
    assert notebook == notebook_of((FOLDER / "first_hour.py").read_text())


@pytest.mark.thorough
def test_the_notebook_runs(tmp_path):
    notebook = nbformat.read(FOLDER / "first_hour.ipynb", as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": tmp_path}}).execute()
    texts = [
        output.text
        for cell in notebook.cells
        for output in cell.get("outputs", [])
        if output.output_type == "stream"
    ]
    assert any("expert SUCCESS" in text for text in texts)
    pictures = sum("image/png" in str(cell.get("outputs", "")) for cell in notebook.cells)
    assert pictures == 2


def test_every_example_is_run_here():
    named = {*OUTCOMES, *OTHERS, "clone_expert.py", "own_data.py"}
    assert {example.name for example in EXAMPLES} == named


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_an_example_is_shorter_than_100_lines(example):
    assert len(example.read_text().splitlines()) < 100


@pytest.mark.parametrize("page", SHOWN)
def test_a_page_shows_the_example_as_it_is(page):
    programs = re.findall(r"```python\n(.*?)```", (ROOT / page).read_text(), flags=re.DOTALL)
    assert (FOLDER / SHOWN[page]).read_text() in programs


def test_the_known_answers_are_those_of_the_documentation(run):
    printed = "\n".join(run("known_answers.py"))
    page = (ROOT / "docs" / "known-answers.md").read_text()
    assert printed.splitlines()[0].split()[-1] in page
    for name in ("torque", "joint angles"):
        answers = [
            np.array(re.findall(r"-?\d+\.\d*", text[text.index(name) :])[:12], float)
            for text in (printed, page[page.index("```") :])
        ]
        np.testing.assert_allclose(answers[0], answers[1], rtol=0, atol=2e-4)
