"""Evaluation: intervals, counts and errors with known answers; valid JSON whatever happens."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from surefoot.config import (
    Config,
    DisturbanceConfig,
    EvaluationConfig,
    ExpertData,
    PolicyConfig,
    StateNoiseConfig,
)
from surefoot.config.json_io import from_json, to_json
from surefoot.evaluation.robustness import (
    Robustness,
    evaluate,
    evaluation_job,
    mean_error,
    robustness_of,
    success_difference,
)
from surefoot.evaluation.statistics import paired_difference
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.robots.load import load_robot
from surefoot.rollouts.jobs import play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.sampling import expert_rollouts
from surefoot.scenarios.starts import load_starts
from surefoot.types import MotionPlan
from surefoot.workers import Workers
from tests.fakes.learning import spec_of
from tests.fakes.rollouts import summary_of

SUCCESS, FELL, STALLED, DIVERGED = Outcome
STORED = load_starts()


def robustness_from(outcome, **arrays):
    """The robustness of episodes with these outcomes."""
    return robustness_of(summary_of(outcome, **arrays), STORED, "test")


def through_json(robustness):
    """What is written and read back; the text has no NaN."""
    text = json.dumps(to_json(robustness), allow_nan=False)
    return from_json(Robustness, json.loads(text))


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
def test_the_interval_of_the_success_rate_is_wilsons(successes, n, low, high):
    robustness = robustness_from([SUCCESS] * successes + [FELL] * (n - successes))
    assert robustness.success_interval == pytest.approx([low, high], abs=1e-5)
    z = 1.959964
    p = successes / n
    center = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert robustness.success_interval == pytest.approx([center - half, center + half], abs=1e-6)
    assert robustness.success_rate == p


def test_outcomes_are_counted():
    outcome = [SUCCESS, FELL, SUCCESS, STALLED, FELL, DIVERGED, FELL]
    robustness = robustness_from(
        outcome,
        strict=[True, True, False, True, False, True, False],
        max_torque=[1.0, 2.5, 0.1, 0.2, 0.3, 0.4, 0.5],
        ticks=[5000, 700, 5000, 5000, 800, 900, 600],
        plans=[1, 2, 3, 4, 5, 6, 7],
        invalid_plans=[0, 1, 0, 0, 2, 0, 0],
    )
    assert robustness.episodes == 7
    assert robustness.successes == 2
    assert robustness.falls == 3
    assert robustness.stalls == 1
    assert robustness.diverged == 1
    assert robustness.strict_successes == 1  # a robot that fell is none, however it stepped
    assert robustness.max_torque == 2.5
    assert robustness.robot_seconds == 18.0
    assert robustness.plans == 28
    assert robustness.invalid_plans == 3


def test_the_outcome_of_each_initial_state_is_kept():
    robustness = robustness_from(
        [SUCCESS, FELL, STALLED, DIVERGED, SUCCESS],
        start=[700, 701, 702, 790, 710],
        strict=[True, False, True, False, False],
        ticks=[5000, 700, 5000, 1234, 5000],
        contact_ticks=[3, 50, 0, 0, 0],
    )
    assert robustness.initial_states == "700-702,790,710"
    assert robustness.ids.tolist() == [700, 701, 702, 790, 710]
    assert robustness.outcomes == "01230"
    assert robustness.strict == "10100"
    assert robustness.lost_at == (0.7, 1.234)
    assert robustness.touched == "11000"
    assert (robustness.body_contacts, robustness.body_contact_successes) == (2, 1)
    assert robustness.succeeded.tolist() == [True, False, False, False, True]
    assert through_json(robustness) == robustness


def test_a_robot_that_fell_has_not_covered_its_way_however_far_it_came():
    forward = np.array([0.2, 0.0, 0.0])
    robustness = robustness_from(
        [SUCCESS, FELL, SUCCESS],
        command=np.tile(forward, (3, 1)),
        mean_velocity=np.outer([0.9, 0.9, 0.5], forward),
    )
    assert robustness.covered == 1


def test_body_contact_that_was_not_recorded_is_none_and_not_zero():
    robustness = robustness_from([SUCCESS, FELL], contact_ticks=[-1, -1])
    assert robustness.body_contacts is None
    assert robustness.body_contact_successes is None
    assert robustness.touched == ""


@pytest.mark.parametrize(
    ("text", "count"), [("3", 1), ("3-5", 3), ("3,4,4", 3), ("0-999999999999999999", 10**18)]
)
def test_initial_states_that_are_not_one_for_each_episode_are_an_error(text, count):
    """They are counted before they are made: the last of these would fill any memory."""
    robustness = robustness_from([SUCCESS, FELL], start=[3, 4])
    with pytest.raises(ValueError, match=f"'{text}' names {count}, and there are 2 digits"):
        replace(robustness, initial_states=text)
    with pytest.raises(ValueError, match=f"names {count}, and there are 0 digits"):
        replace(robustness, initial_states=text, outcomes="", strict="", touched="", episodes=count)


def test_outcomes_that_are_not_one_for_each_episode_are_an_error():
    robustness = robustness_from([SUCCESS, FELL], start=[3, 4])
    for name, value in (("outcomes", "0"), ("outcomes", "04"), ("strict", "02"), ("touched", "1")):
        with pytest.raises(ValueError, match=f"{name} must be 2 digits"):
            replace(robustness, **{name: value})
    with pytest.raises(ValueError, match="'3-5' names 3"):
        replace(robustness, initial_states="3-5")


def test_differences_are_paired_by_initial_state():
    a = robustness_from([SUCCESS, SUCCESS, FELL, SUCCESS], start=[3, 4, 5, 6])
    b = robustness_from([FELL, SUCCESS, SUCCESS, STALLED], start=[3, 4, 5, 6])
    expected = paired_difference([1, 1, 0, 1], [0, 1, 1, 0])
    assert success_difference(a, b) == expected
    earlier = replace(b, initial_states="", outcomes="", strict="", touched="", lost_at=())
    assert success_difference(a, earlier) is success_difference(earlier, a) is None
    other = robustness_from([FELL, SUCCESS, SUCCESS, STALLED], start=[3, 4, 5, 7])
    with pytest.raises(ValueError, match="different initial_states, '3-6' and '3-5,7'"):
        success_difference(a, other)
    with pytest.raises(ValueError, match="different starts_hash"):
        success_difference(a, replace(b, starts_hash="0"))


def test_errors_are_over_successes_and_settled_ones_over_all():
    robustness = robustness_from(
        [SUCCESS, FELL, SUCCESS, FELL],
        mse=[[1, 2, 3], [100, 100, 100], [3, 4, 5], [np.nan] * 3],
        settled_mse=[[1, 1, 1], [4, 5, 6], [1, 3, 5], [np.nan] * 3],
    )
    assert robustness.mse == (2.0, 3.0, 4.0)
    assert robustness.settled_mse == (2.0, 3.0, 4.0)


def test_errors_without_successes_or_settled_ticks_are_none():
    robustness = robustness_from(
        [FELL, FELL],
        mse=[[1, 2, 3], [np.nan] * 3],
        settled_mse=np.full((2, 3), np.nan),
    )
    assert robustness.mse == (None, None, None)
    assert robustness.settled_mse == (None, None, None)
    assert robustness.success_rate == 0.0
    assert through_json(robustness) == robustness


def test_the_mean_error_leaves_out_what_is_not_finite():
    rows = np.array([[1.0, np.nan, np.inf], [3.0, np.nan, 2.0]])
    assert mean_error(rows) == (2.0, None, 2.0)
    assert mean_error(np.zeros((0, 3))) == (None, None, None)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    config = PolicyConfig(hidden=(16, 16))
    path = tmp_path_factory.mktemp("policies") / "random.safetensors"
    save(Policy(PolicyNetwork(config, seed=2), spec_of(config), np.zeros((2, 3)), "solo12"), path)
    return path


def test_a_random_policy_falls(policy):
    config = replace(Config(), chunk=4, evaluation=EvaluationConfig(duration=1.2, episodes=8))
    robustness, summary = evaluate(config, policy, "select", Workers(1))
    assert robustness.episodes == 8
    assert robustness.split == "select"
    assert robustness.starts_hash == STORED.hash
    np.testing.assert_array_equal(summary.start, STORED.first("select", 8).id)
    assert robustness.falls > 0
    assert robustness.successes == 0
    assert robustness.plans == 0
    assert not summary.kept.any()
    np.testing.assert_array_equal(robustness.ids, summary.start)
    assert len(robustness.lost_at) == robustness.falls
    assert robustness.body_contacts is not None
    assert through_json(robustness) == robustness
    # The same twice, and on another split other starts.
    again, _ = evaluate(config, policy, "select", Workers(2))
    assert again == robustness
    _, other = evaluate(config, policy, "test", Workers(1))
    assert not set(other.start) & set(summary.start)


def test_without_a_policy_the_expert_is_evaluated():
    config = replace(Config(), chunk=2, evaluation=EvaluationConfig(duration=0.1, episodes=2))
    robustness, summary = evaluate(config, None, "select", Workers(1))
    assert summary.expert_ticks.tolist() == summary.proper_ticks.tolist() == [100, 100]
    assert robustness.plans == 4
    assert robustness.falls == 0
    assert robustness.settled_mse == (None, None, None)
    assert through_json(robustness) == robustness


@pytest.mark.parametrize("evaluated", [True, False])
def test_an_expert_sees_the_noise_where_it_is_evaluated_and_not_where_it_teaches(evaluated):
    noise = StateNoiseConfig(base_height=1e-3, joint_position=1e-3)
    disturbance = DisturbanceConfig(noise=noise)
    evaluation = EvaluationConfig(duration=0.06, episodes=1, disturbance=disturbance)
    seen = []

    def plan(state, tick, command):
        seen.append(state.q)
        still = np.zeros((100, 12))
        return MotionPlan(np.tile(state.q[7:], (100, 1)), still, still)

    config = replace(Config(), evaluation=evaluation)
    if evaluated:
        job = evaluation_job(config, None, "test", STORED, plan)
    else:
        job = expert_rollouts(config, ExpertData(1, 1, False, 0.06), plan, disturbance)[:1]
    rollouts, expert = play_out(job)
    assert len(seen) == expert.plans.sum() > 0
    first = rollouts.seen.q[0, 0] if evaluated else rollouts.q[0, 0]
    np.testing.assert_array_equal(seen[0][2:], first[2:])
    assert (rollouts.seen.q[0, 0, 7:] != rollouts.q[0, 0, 7:]).all()


def test_more_episodes_than_there_are_starts_is_an_error(policy):
    config = replace(Config(), evaluation=EvaluationConfig(episodes=201))
    with pytest.raises(ValueError, match=r"201 episodes asked.*hold 200 in 'select'"):
        evaluate(config, policy, "select", Workers(1))


def test_an_unknown_split_is_an_error(policy):
    with pytest.raises(KeyError, match="no split 'exam'"):
        evaluate(Config(), policy, "exam", Workers(1))


def test_another_set_of_starts_and_one_that_does_not_exist(tmp_path):
    config = replace(Config(), evaluation=EvaluationConfig(duration=0.02, episodes=2))
    wide = load_starts("solo12-trot-v1-wide")
    robustness, summary = evaluate(config, None, "test", Workers(1), stored=wide)
    assert (robustness.starts, robustness.starts_hash) == (wide.name, wide.hash)
    assert robustness.starts_hash != STORED.hash
    np.testing.assert_array_equal(summary.start, wide.first("test", 2).id)
    message = r"no set of starts.*'solo12-trot-v2'; did you mean 'solo12-trot-v1'\? Known: .*wide"
    with pytest.raises(FileNotFoundError, match=message):
        load_starts("solo12-trot-v2")
    (tmp_path / "own.npz").write_bytes(b"no starts")
    with pytest.raises(ValueError, match=r"own\.npz is not a set of starts"):
        load_starts(tmp_path / "own.npz")


def test_what_disturbs_an_evaluation_does_not_depend_on_the_trainings_seed():
    """The same initial states have the same friction and pushes, also in a part of the set."""
    disturbance = DisturbanceConfig(pushes=1, impulse=(0.1, 0.5), friction=(0.3, 1.5))
    evaluation = EvaluationConfig(duration=0.3, episodes=3, disturbance=disturbance)
    summaries = []
    for seed in (0, 1):
        config = replace(Config(), seed=seed, evaluation=evaluation)
        _, summary = evaluate(config, None, "test", Workers(1))
        summaries.append(summary)
    for field in fields(summaries[0]):
        first = getattr(summaries[0], field.name)
        np.testing.assert_array_equal(first, getattr(summaries[1], field.name))
    undisturbed = EvaluationConfig(duration=0.3, episodes=3)
    _, plain = evaluate(replace(Config(), evaluation=undisturbed), None, "test", Workers(1))
    assert (plain.mean_velocity != summaries[0].mean_velocity).any(axis=1).all()


def test_an_evaluation_under_another_robots_pushes_is_warned_of(caplog, monkeypatch):
    go2 = load_robot("go2")
    monkeypatch.setattr("surefoot.evaluation.robustness.load_robot", lambda _: go2)
    monkeypatch.setattr("surefoot.evaluation.robustness.run_episodes", stop)
    pushed = EvaluationConfig(disturbance=DisturbanceConfig(pushes=1))
    with pytest.raises(InterruptedError):
        evaluate(Config(evaluation=pushed), None, "test", Workers(1))
    assert "disturbance.impulse: pushes of 0.5 to 1.5 N s" in caplog.text


def stop(*_):
    raise InterruptedError
