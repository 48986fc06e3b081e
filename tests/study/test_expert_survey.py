"""The survey of expert variants: what differs between them, and that nothing measured is lost."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import surefoot.study.expert_survey as survey_module
from surefoot.bench.plan import TimedPlan
from surefoot.config import Config
from surefoot.rollouts.outcome import Outcome
from surefoot.study.expert_survey import PUSHES, lost_by_all, survey, table, variant_of
from surefoot.workers import Workers
from tests.fakes.rollouts import summary_of

CONFIG = Config()


class Interrupted(Exception):
    """Stands for Ctrl-C."""


def pretend(monkeypatch, stop_after=1000):
    """Variants that lose start 7 always, and start 8 with the published rules."""
    calls = []

    def count(what, config):
        if len(calls) == stop_after:
            raise Interrupted
        calls.append((what, config.simulation.backend, config.expert.foothold_rule))

    def evaluate(config, policy, split, workers, label, stored):
        count(stored.name, config)
        assert (policy, split, config.evaluation.episodes) == (None, "test", 3)
        published = config.expert.foothold_rule == "published"
        outcome = np.array([Outcome.FELL, Outcome.SUCCESS, Outcome.SUCCESS])
        outcome[1] = Outcome.DIVERGED if published else Outcome.STALLED
        figures = {
            "episodes": 3,
            "stalls": 1,
            "invalid_plans": 0,
            "settled_mse": [0.01, 0.0, 0.0],
            "starts_hash": stored.hash,
        }
        return figures, summary_of(outcome, start=[7, 8, 9])

    def push_recovery(config, policy, workers, label):
        count("push", config)
        return {"fitted_impulse": [1.0, 3.0], "mean_fitted_impulse": 2.0}

    def cold_plans(config):
        count("plan", config)
        names = ("contacts", "centroidal", "kinematics", "inverse_dynamics")
        stages: Any = SimpleNamespace(seconds={name: 1e-3 * n for n, name in enumerate(names, 1)})
        return [TimedPlan(3e-3, stages), TimedPlan(4e-3, stages)]

    for function in (evaluate, push_recovery, cold_plans):
        monkeypatch.setattr(survey_module, function.__name__, function)
    return calls


def test_every_variant_is_measured_on_equal_terms(monkeypatch, tmp_path):
    calls = pretend(monkeypatch)
    record = survey(CONFIG, None, 3, Workers(1), tmp_path / "survey.json")
    assert len(record["cells"]) == 8
    assert len(set(calls)) == 4 * 2 * 2  # four measurements, two simulators, two rules
    assert len(calls) == 32
    for cell in record["cells"]:
        own = cell["rules"] == "own"
        assert cell["survived"] == cell["wide_survived"] == (2 if own else 1)
        assert cell["lost"] == ([7] if own else [7, 8])
    assert set(map(tuple, record["lost_by_all"].values())) == {(7,)}
    assert len(record["lost_by_all"]) == 4
    lines = table(record).splitlines()
    assert len(lines) == 10
    assert lines[2].startswith("| mujoco | 20/10 | published | 1 of 3 (6.1 to 79.2 %) | 1 of 3 (")
    assert lines[2].endswith(
        "| 0.100, 0.000 | 2.00 (1.00, 3.00) | 3.50 (3.99): 1.00, 2.00, 3.00, 4.00 |"
    )


@pytest.mark.parametrize("stop", [0, 1, 6, 13])
def test_an_interrupted_survey_goes_on_where_it_stopped(monkeypatch, tmp_path, stop):
    pretend(monkeypatch)
    whole = survey(CONFIG, "mujoco", 3, Workers(1), tmp_path / "whole.json")
    path = tmp_path / "survey.json"
    pretend(monkeypatch, stop_after=stop)
    with pytest.raises(Interrupted):
        survey(CONFIG, "mujoco", 3, Workers(1), path)
    calls = pretend(monkeypatch)
    assert survey(CONFIG, "mujoco", 3, Workers(1), path) == whole
    assert len(calls) == 16 - stop
    assert json.loads(path.read_text()) == json.loads((tmp_path / "whole.json").read_text())


def test_a_survey_of_another_configuration_is_not_mixed_in(monkeypatch, tmp_path):
    pretend(monkeypatch)
    path = tmp_path / "survey.json"
    survey(CONFIG, "mujoco", 3, Workers(1), path)
    before = path.read_bytes()
    other = replace(CONFIG, expert=replace(CONFIG.expert, kp=4.0))
    with pytest.raises(ValueError, match="other config; name another file"):
        survey(other, "mujoco", 3, Workers(1), path)
    assert path.read_bytes() == before


def test_an_unfinished_survey_has_a_table():
    cell = {"simulator": "mujoco", "nodes": [20, 10], "rules": "own"}
    row = table({"cells": [cell]}).splitlines()[-1]
    assert row == "| mujoco | 20/10 | own | - | - | - | - | - |"


def test_variants_differ_in_simulator_horizon_and_rules_only():
    base = variant_of(CONFIG, "mujoco", (20, 10), "own", 1000)
    evaluation = replace(CONFIG.evaluation, episodes=1000)
    assert base == replace(CONFIG, evaluation=evaluation, push=PUSHES)
    other = variant_of(CONFIG, "bullet", (10, 5), "published", 1000)
    assert (other.expert.centroidal.nodes, other.expert.kinematic.nodes) == (10, 5)
    assert other.simulation == replace(CONFIG.simulation, backend="bullet")
    assert other.expert.foothold_rule == "published"
    assert other.expert.command_gain == (1.0, 1.0, 1.0)
    assert other.safety == CONFIG.safety


def test_lost_by_all_counts_only_what_was_measured():
    cells = [
        {"simulator": "mujoco", "lost": [1, 2, 3]},
        {"simulator": "mujoco", "lost": [2, 3, 4], "wide_lost": [5]},
        {"simulator": "bullet"},
    ]
    assert lost_by_all(cells) == {
        "mujoco solo12-trot-v1": [2, 3],
        "mujoco solo12-trot-v1-wide": [5],
    }
