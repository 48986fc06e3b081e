"""What a job measures of a policy: how far it imitates the expert."""

from dataclasses import replace

import pytest

import surefoot.study.results as results
import surefoot.study.work as work
from surefoot.config import Config
from surefoot.config.json_io import from_json, to_json
from surefoot.config.study import Measurement
from surefoot.evaluation.imitation import ImitationError
from surefoot.study.results import PolicyTest

ERROR = ImitationError("starts", "28d8", 60, 4800, 61.5, 210.0)


def test_the_imitation_error_of_a_policy_is_kept_beside_its_hash(tmp_path, monkeypatch):
    path = tmp_path / "007.safetensors"
    path.write_bytes(b"a policy")
    asked = []

    def measured(config, policy, workers):
        asked.append((config, policy, workers.count))
        return ERROR

    monkeypatch.setattr(work, "imitation_error", measured)
    policy = work.MeasuredPolicy(7, 12_000, path)
    test = work._measure(Config(), policy, Measurement("imitation", "i", "imitation"))
    assert asked == [(Config(), path, 1)]
    assert test.imitation == ERROR
    assert (test.iteration, test.frames, test.robustness, test.pushes) == (7, 12_000, None, None)
    assert test.sha256 is not None and len(test.sha256) == 64
    tests = results.Tests("imitation", (test, replace(test, iteration=8)), True)
    assert from_json(results.Tests, to_json(tests)) == tests


def test_results_from_before_the_imitation_error_are_read():
    values = to_json(PolicyTest(0, None, None))
    del values["imitation"]
    assert from_json(PolicyTest, values) == PolicyTest(0, None, None)


def test_the_expert_does_not_deviate_from_itself():
    with pytest.raises(AssertionError):
        work._measure(Config(), work.MeasuredPolicy(), Measurement("i", "i", "imitation"))
