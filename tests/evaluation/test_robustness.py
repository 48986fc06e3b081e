"""Evaluation: intervals, counts and errors with known answers; valid JSON whatever happens."""

import json
from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config, EvaluationConfig, PolicyConfig
from surefoot.evaluation.robustness import evaluate, figures_of, mean_rows
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.starts import load_starts
from surefoot.workers import Workers
from tests.fakes.learning import spec_of
from tests.fakes.rollouts import summary_of

SUCCESS, FELL, STALLED, DIVERGED = Outcome


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        # Wilson's interval by its formula, z = 1.959964.
        (90, 100, 0.825634, 0.944771),
        (100, 100, 0.963005, 1.0),
        (0, 100, 0.0, 0.036995),
        (5, 10, 0.236593, 0.763407),
        (1, 1, 0.206549, 1.0),
    ],
)
def test_wilson_interval(successes, n, low, high):
    figures = figures_of(summary_of([SUCCESS] * successes + [FELL] * (n - successes)))
    assert figures["success_interval"] == pytest.approx([low, high], abs=1e-5)
    z, p = 1.959964, successes / n
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert figures["success_interval"] == pytest.approx([centre - half, centre + half], abs=1e-6)
    assert figures["success_rate"] == p


def test_counts():
    outcome = [SUCCESS, FELL, SUCCESS, STALLED, FELL, DIVERGED, FELL]
    figures = figures_of(
        summary_of(
            outcome,
            strict=[True, True, False, True, False, True, False],
            max_torque=[1.0, 2.5, 0.1, 0.2, 0.3, 0.4, 0.5],
            ticks=[5000, 700, 5000, 5000, 800, 900, 600],
            plans=[1, 2, 3, 4, 5, 6, 7],
            invalid_plans=[0, 1, 0, 0, 2, 0, 0],
        )
    )
    assert figures["episodes"] == 7
    assert figures["successes"] == 2
    assert figures["falls"] == 3
    assert figures["stalls"] == 1
    assert figures["diverged"] == 1
    assert figures["strict_successes"] == 1  # a robot that fell is none, however it stepped
    assert figures["max_torque"] == 2.5
    assert figures["robot_seconds"] == 18.0
    assert figures["plans"] == 28
    assert figures["invalid_plans"] == 3


def test_errors_are_over_successes_and_settled_ones_over_all():
    figures = figures_of(
        summary_of(
            [SUCCESS, FELL, SUCCESS, FELL],
            mse=[[1, 2, 3], [100, 100, 100], [3, 4, 5], [np.nan] * 3],
            settled_mse=[[1, 1, 1], [4, 5, 6], [1, 3, 5], [np.nan] * 3],
        )
    )
    assert figures["mse"] == [2.0, 3.0, 4.0]
    assert figures["settled_mse"] == [2.0, 3.0, 4.0]


def strict_json(record):
    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(json.dumps(record), parse_constant=refuse)


def test_without_successes_or_settled_ticks_the_figures_are_none():
    figures = figures_of(
        summary_of(
            [FELL, FELL],
            mse=[[1, 2, 3], [np.nan] * 3],
            settled_mse=np.full((2, 3), np.nan),
        )
    )
    assert figures["mse"] == [None, None, None]
    assert figures["settled_mse"] == [None, None, None]
    assert figures["success_rate"] == 0.0
    assert strict_json(figures) == figures


def test_mean_of_rows_leaves_out_what_is_no_number():
    rows = np.array([[1.0, np.nan, np.inf], [3.0, np.nan, 2.0]])
    assert mean_rows(rows) == [2.0, None, 2.0]
    assert mean_rows(np.zeros((0, 3))) == [None, None, None]


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    config = PolicyConfig(hidden=(16, 16))
    path = tmp_path_factory.mktemp("policies") / "random.safetensors"
    save(Policy(PolicyNetwork(config, seed=2), spec_of(config), np.zeros((2, 3))), path)
    return path


def test_a_random_policy_falls_and_is_written_down(policy):
    config = replace(Config(), chunk=4, evaluation=EvaluationConfig(duration=1.2, episodes=8))
    figures, summary = evaluate(config, policy, "select", Workers(1), "random")
    stored = load_starts()
    assert figures["episodes"] == 8
    assert figures["split"] == "select"
    assert figures["starts_hash"] == stored.hash
    np.testing.assert_array_equal(summary.start, stored["select"].id[:8])
    assert figures["falls"] > 0
    assert figures["successes"] == 0
    assert figures["plans"] == 0
    assert not summary.kept.any()
    assert strict_json(figures) == figures
    # The same twice, and on another split other starts.
    again, _ = evaluate(config, policy, "select", Workers(2), "again")
    assert again == figures
    _, other = evaluate(config, policy, "test", Workers(1), "test")
    assert not set(other.start) & set(summary.start)


def test_without_a_policy_the_expert_is_evaluated():
    config = replace(Config(), chunk=2, evaluation=EvaluationConfig(duration=0.1, episodes=2))
    figures, summary = evaluate(config, None, "select", Workers(1), "expert")
    assert summary.expert_ticks.tolist() == summary.proper_ticks.tolist() == [100, 100]
    assert figures["plans"] == 4
    assert figures["falls"] == 0
    assert figures["settled_mse"] == [None] * 3
    assert strict_json(figures) == figures


@pytest.mark.parametrize("episodes", [201])
def test_more_episodes_than_there_are_starts_is_an_error(policy, episodes):
    config = replace(Config(), evaluation=EvaluationConfig(episodes=episodes))
    with pytest.raises(ValueError, match=f"{episodes} episodes asked.*hold 200 in 'select'"):
        evaluate(config, policy, "select", Workers(1), "too many")


def test_an_unknown_split_is_an_error(policy):
    with pytest.raises(KeyError, match="no split 'exam'"):
        evaluate(Config(), policy, "exam", Workers(1), "exam")


def test_another_set_of_starts_and_one_that_does_not_exist(tmp_path):
    config = replace(Config(), evaluation=EvaluationConfig(duration=0.02, episodes=2))
    wide = load_starts("solo12-trot-v1-wide")
    figures, summary = evaluate(config, None, "test", Workers(1), "", stored=wide)
    assert (figures["starts"], figures["starts_hash"]) == (wide.name, wide.hash)
    assert figures["starts_hash"] != load_starts().hash
    np.testing.assert_array_equal(summary.start, wide["test"].id[:2])
    message = r"no set of starts.*'solo12-trot-v2'; did you mean 'solo12-trot-v1'\? Known: .*wide"
    with pytest.raises(FileNotFoundError, match=message):
        load_starts("solo12-trot-v2")
    (tmp_path / "mine.npz").write_bytes(b"no starts")
    with pytest.raises(ValueError, match=r"mine\.npz is not a set of starts"):
        load_starts(tmp_path / "mine.npz")
