"""The command gate-warnings: which gates it asks, its table and its JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from surefoot.cli.gate_warnings import ALARMS, MeasureWarnings, last_gate, warnings_table
from surefoot.config import Config, LocoSafeDaggerConfig, PolicyConfig, RobotConfig
from surefoot.config.json_io import from_json
from surefoot.evaluation.gate_warnings import FallWarnings, RunWarnings, warnings_of
from surefoot.learning.classifier import Classifier, ClassifierQuality, save_classifier
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.robots.load import load_robot
from surefoot.runs.layout import RunError
from surefoot.runs.run import Run, create, open_run
from tests.fakes.learning import FLOAT32, spec_of

SMALL = PolicyConfig(hidden=(4,))


def constant_network(logit: float) -> Classifier:
    """A history network that answers the same for every state."""
    weight = np.zeros((470, 1), np.float32)
    return Classifier(
        ((weight, np.array([logit], np.float32)),), ClassifierQuality(rows=1, share_yes=0.5, seed=0)
    )


@pytest.fixture
def run(tmp_path) -> Run:
    """Three untrained policies; the first two have a history network."""
    run = create(
        tmp_path / "run", Config(method=LocoSafeDaggerConfig(), policy=SMALL, training=FLOAT32)
    )
    for i in range(3):
        policy = Policy(PolicyNetwork(SMALL, i), spec_of(SMALL), np.zeros((2, 3)), "solo12")
        save(policy, run.policy_path(i))
    for i, logit in ((0, 9.0), (1, -1.0)):  # probabilities of 0.9999 and 0.27
        save_classifier(constant_network(logit), run.gate_path("history", i))
    return run


def test_the_gates_of_the_last_history_network_are_asked(run, capsys, tmp_path):
    file = tmp_path / "warnings.json"
    before = {path: path.stat().st_mtime_ns for path in run.folder.rglob("*")}
    assert MeasureWarnings(run.folder, episodes=3, json=file, workers=1)() == 0
    warnings = from_json(RunWarnings, json.loads(file.read_text()))
    assert (warnings.run, warnings.iteration, warnings.episodes) == ("run", 1, 3)
    assert warnings.split == "test"
    assert warnings.falls == 3  # untrained policies fall
    names = ["bounds", "bounds tightened to 0.6", *(f"history, alarm {a}" for a in ALARMS)]
    assert list(warnings.gates) == names
    leads = [warnings.gates[f"history, alarm {alarm}"].leads for alarm in ALARMS]
    assert min(leads[0]) > 0  # a probability of 0.27 is beyond 0.1 and 0.2, not 0.3 and 0.5
    assert leads[1] == leads[0]
    assert leads[2] == leads[3] == (0.0, 0.0, 0.0)
    printed = capsys.readouterr().out
    assert printed.startswith("run, policy 1: 3 of 3 fell\n")
    assert printed.count("\n| ") == 2 + len(names)
    assert {path: path.stat().st_mtime_ns for path in run.folder.rglob("*")} == before


def test_pushes_are_the_same_for_solo12_and_in_proportion_to_the_mass_of_other_robots(run):
    command = MeasureWarnings(run.folder)
    pushes = command.as_asked(run.config).evaluation.disturbance
    assert (pushes.pushes, pushes.impulse) == (3, (0.5, 2.0))
    heavy = replace(run.config, robot=RobotConfig("go2"))
    mass = load_robot("go2").mass / load_robot("solo12").mass
    impulse = command.as_asked(heavy).evaluation.disturbance.impulse
    assert impulse == pytest.approx((0.5 * mass, 2.0 * mass), rel=0.01)


def test_an_output_that_cannot_be_written_is_refused_before_any_work(run, tmp_path):
    with pytest.raises(ValueError, match=r"--json: .* is a folder, and cannot be written"):
        MeasureWarnings(run.folder, json=tmp_path, workers=1)()


def test_the_last_gate_is_that_of_the_last_policy_with_one(run):
    assert last_gate(run) == 1
    save_classifier(constant_network(0.0), run.gate_path("history", 7))  # without its policy
    assert last_gate(open_run(run.folder)) == 1
    for i in (0, 1):
        run.gate_path("history", i).unlink()
    with pytest.raises(RunError, match="no policy with a history network; train one"):
        last_gate(run)


def test_the_table_has_dashes_where_nothing_fell():
    alarm = np.zeros((2, 4000), bool)
    alarm[0, 100] = True
    quiet = warnings_of(alarm, np.array([4000, 4000]), np.zeros(2, bool), 2000)
    fell = warnings_of(alarm, np.array([1000, 4000]), np.array([True, False]), 2000)
    whole = FallWarnings("set", "0", "test", 2, 2.0, 0, (), {"bounds": quiet})
    text = warnings_table(RunWarnings(**vars(whole), run="demo", iteration=3))
    assert text.startswith("demo, policy 3: 0 of 2 fell\n\n| gate | ")
    row = "| bounds | 0 of 0: - | 2 % | - | 12.00 (0.00 to 24.00) | 1 |"
    assert text.splitlines()[-1] == row
    whole = replace(whole, falls=1, fallen=(5,), gates={"bounds": fell})
    text = warnings_table(RunWarnings(**vars(whole), run="demo", iteration=3))
    row = "| bounds | 1 of 1: 100 % (21 to 100) | 0 % | 900 | 0.00 (0.00 to 63.24) | 1 |"
    assert text.splitlines()[-1] == row
