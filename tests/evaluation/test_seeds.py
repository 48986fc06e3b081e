"""What disturbs robots that are watched follows from the seed of their initial states."""

import pytest

import surefoot.evaluation.gate_warnings as module
from surefoot.config import Config, EvaluationConfig
from surefoot.scenarios.starts import load_starts
from surefoot.workers import Workers
from tests.fakes.exports import policy_of


def test_gates_are_watched_under_disturbances_that_do_not_depend_on_the_trainings_seed(monkeypatch):
    seen = []

    def note(function, chunks, workers, title):
        seen.extend(chunk.config.seed for chunk, _ in chunks)
        raise InterruptedError

    monkeypatch.setattr(module, "map_chunks", note)
    config = Config(seed=9, evaluation=EvaluationConfig(episodes=3))
    with pytest.raises(InterruptedError):
        module.measure_warnings(config, policy_of(), {}, "select", Workers(1))
    assert set(seen) == {load_starts().seed} != {9}
