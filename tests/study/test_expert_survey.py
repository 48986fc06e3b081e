"""The survey of expert variants: what differs between them, and that nothing measured is lost."""

import logging
from dataclasses import replace

import numpy as np
import pytest

import surefoot.study.expert_survey as module
from surefoot.bench.plan import StageTimes, Times
from surefoot.config import Config
from surefoot.config.json_io import read_record
from surefoot.rollouts.outcome import Outcome
from surefoot.study.expert_cells import Survey, SurveyCell, Survival, survey_table
from surefoot.study.expert_survey import PUSHES, lost_by_all, survey_expert, variant_of
from surefoot.workers import Workers
from tests.fakes.comparisons import Interrupted
from tests.fakes.results import push_result, robustness
from tests.fakes.rollouts import summary_of

CONFIG = Config()


def pretend_measurements(monkeypatch, stop_after=1000):
    """Variants that lose start 7 always, and start 8 with the published rules."""
    calls = []

    def count(what, config):
        if len(calls) == stop_after:
            raise Interrupted
        calls.append((what, config.simulation.backend, config.expert.foothold_rule))

    def evaluate(config, policy, split, workers, stored):
        count(stored.name, config)
        assert (policy, split, config.evaluation.episodes) == (None, "test", 3)
        published = config.expert.foothold_rule == "published"
        outcome = np.array([Outcome.FELL, Outcome.SUCCESS, Outcome.SUCCESS])
        outcome[1] = Outcome.DIVERGED if published else Outcome.STALLED
        figures = robustness(1, 3, stalls=1, settled_mse=(0.01, 0.0, 0.0), starts_hash=stored.hash)
        return figures, summary_of(outcome, start=[7, 8, 9])

    def push_recovery(config, policy, workers):
        count("push", config)
        return push_result((1.0, 3.0))

    def cold_plans(config):
        count("plan", config)
        return []

    def times_of(timed):
        return Times(3.5, 3.99, StageTimes(1.0, 0.5, 2.0, 0.25))

    for function in (evaluate, push_recovery, cold_plans, times_of):
        monkeypatch.setattr(module, function.__name__, function)
    return calls


def survival(lost):
    return Survival(9, 9 - len(lost), (0.0, 1.0), 0, lost, 0, (None, None, None), "")


def test_every_variant_is_measured_on_equal_terms(monkeypatch, tmp_path):
    calls = pretend_measurements(monkeypatch)
    path = tmp_path / "survey.json"
    survey = survey_expert(CONFIG, None, 3, Workers(1), path)
    assert read_record(path, Survey) == survey
    assert len(survey.cells) == 8
    assert len(set(calls)) == 4 * 2 * 2  # four measurements, two simulators, two rules
    assert len(calls) == 32
    for cell in survey.cells:
        lost = (7,) if cell.rules == "own" else (7, 8)
        for measured in (cell.paper, cell.wide):
            assert measured is not None
            assert (measured.lost, measured.survived) == (lost, 3 - len(lost))
    assert set(survey.lost_by_all.values()) == {(7,)}
    assert len(survey.lost_by_all) == 4
    lines = survey_table(survey).splitlines()
    assert len(lines) == 10
    assert lines[2].startswith("| mujoco | 20/10 | published | 1 of 3 (6.1 to 79.2 %) | 1 of 3 (")
    assert lines[2].endswith(
        "| 0.100, 0.000 | 2.00 (1.00, 3.00) | 3.50 (3.99): 1.00, 0.50, 2.00, 0.25 |"
    )


@pytest.mark.parametrize("stop", [0, 1, 6, 13])
def test_an_interrupted_survey_resumes_where_it_stopped(monkeypatch, tmp_path, stop):
    pretend_measurements(monkeypatch)
    whole = survey_expert(CONFIG, "mujoco", 3, Workers(1), None)
    path = tmp_path / "survey.json"
    pretend_measurements(monkeypatch, stop_after=stop)
    with pytest.raises(Interrupted):
        survey_expert(CONFIG, "mujoco", 3, Workers(1), path)
    assert path.exists() == (stop > 0)
    calls = pretend_measurements(monkeypatch)
    assert survey_expert(CONFIG, "mujoco", 3, Workers(1), path) == whole
    assert len(calls) == 16 - stop
    assert read_record(path, Survey) == whole


def test_measurements_of_a_survey_are_logged(monkeypatch, caplog):
    pretend_measurements(monkeypatch)
    with caplog.at_level(logging.INFO, "surefoot"):
        survey_expert(CONFIG, "mujoco", 3, Workers(1), None)
    assert caplog.messages[:3] == [
        "mujoco, 20/10 nodes, published rules: 1 of 3, solo12-trot-v1",
        "mujoco, 20/10 nodes, published rules: 1 of 3, solo12-trot-v1-wide",
        "mujoco, 20/10 nodes, published rules: 2.00 N s",
    ]
    assert len(caplog.messages) == 3 * 4


def test_a_survey_of_another_configuration_is_not_mixed_in(monkeypatch, tmp_path):
    pretend_measurements(monkeypatch)
    path = tmp_path / "survey.json"
    survey_expert(CONFIG, "mujoco", 3, Workers(1), path)
    before = path.read_bytes()
    other = replace(CONFIG, expert=replace(CONFIG.expert, kp=4.0))
    with pytest.raises(ValueError, match="other config; name another file"):
        survey_expert(other, "mujoco", 3, Workers(1), path)
    assert path.read_bytes() == before


def test_an_unfinished_survey_has_a_table():
    cell = SurveyCell("mujoco", (20, 10), "own")
    survey = Survey(CONFIG, 3, {}, {}, (cell,), {})
    row = survey_table(survey).splitlines()[-1]
    assert row == "| mujoco | 20/10 | own | - | - | - | - | - |"


def test_variants_differ_in_simulator_horizon_and_rules_only():
    base = variant_of(CONFIG, SurveyCell("mujoco", (20, 10), "own"), 1000)
    evaluation = replace(CONFIG.evaluation, episodes=1000)
    assert base == replace(CONFIG, evaluation=evaluation, push=PUSHES)
    other = variant_of(CONFIG, SurveyCell("bullet", (10, 5), "published"), 1000)
    assert (other.expert.centroidal.nodes, other.expert.kinematic.nodes) == (10, 5)
    assert other.simulation == replace(CONFIG.simulation, backend="bullet")
    assert other.expert.foothold_rule == "published"
    assert other.expert.command_gain == (1.0, 1.0, 1.0)
    assert other.safety == CONFIG.safety


def test_lost_by_all_counts_only_what_was_measured():
    cells = [
        SurveyCell("mujoco", (20, 10), "published", paper=survival((1, 2, 3))),
        SurveyCell("mujoco", (20, 10), "own", paper=survival((2, 3, 4)), wide=survival((5,))),
        SurveyCell("bullet", (20, 10), "own"),
    ]
    assert lost_by_all(cells) == {
        "mujoco solo12-trot-v1": (2, 3),
        "mujoco solo12-trot-v1-wide": (5,),
    }


def test_the_file_of_another_process_is_left_alone(monkeypatch, tmp_path):
    calls = pretend_measurements(monkeypatch)
    monkeypatch.setattr("surefoot.files.lock_file", lambda path: False)
    with pytest.raises(ValueError, match=r"another process is adding results to .*survey.json"):
        survey_expert(CONFIG, "mujoco", 3, Workers(1), tmp_path / "survey.json")
    assert not calls
