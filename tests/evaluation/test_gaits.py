"""Several gaits evaluated: gait by gait, and while robots change them."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.config.gait_table import GAITS
from surefoot.evaluation.gaits import (
    evaluate_switching,
    follows,
    mean_by_gait,
    results_by_gait,
    switching_job,
)
from surefoot.evaluation.statistics import wilson
from surefoot.mpc.gaits import with_gaits
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.gait_switches import GaitSwitches
from surefoot.scenarios.gaits import IDS_OF_A_GAIT
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.workers import Workers
from tests.fakes.rollouts import blank, summary_of

CONFIG = with_gaits(Config(), ["trot", "bound"])


def test_a_speed_within_3_cm_or_a_fifth_follows_its_command():
    command = np.array([[0.1, 0.0, 0.0], [0.1, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    away = np.array([[0.029, 0, 0], [0.031, 0, 0], [0, 0.099, 0], [0, 0.101, 0]])
    assert follows(command + away, command).tolist() == [True, False, True, False]


def test_results_are_split_by_the_gait_of_the_initial_state():
    outcomes = [Outcome.SUCCESS, Outcome.FELL, Outcome.SUCCESS, Outcome.STALLED, Outcome.SUCCESS]
    summary = replace(
        summary_of(outcomes),
        start=np.array([5, 6, 7, 5 + IDS_OF_A_GAIT, 6 + IDS_OF_A_GAIT]),
        command=np.tile([0.2, 0.0, 0.1], (5, 1)),
        mean_velocity=np.array([[0.2, 0, 0.1]] * 2 + [[0.1, 0, 0.3]] + [[0.21, 0, 0.1]] * 2),
    )
    trot, bound = results_by_gait(summary, CONFIG)
    assert (trot.speed.gait, bound.speed.gait) == ("trot", "bound")
    assert (trot.episodes, trot.successes, trot.falls, trot.stalls) == (3, 2, 1, 0)
    assert (bound.episodes, bound.successes, bound.falls, bound.stalls) == (2, 1, 0, 1)
    assert trot.success_interval == wilson(2, 3)
    # Speeds are those of the successes.
    assert (trot.speed.robots, trot.speed.on_speed) == (2, 1)
    assert trot.speed.error == pytest.approx((0.05, 0.0, 0.1))
    assert (bound.speed.robots, bound.speed.on_speed) == (1, 1)


def test_mean_speeds_begin_a_second_after_each_switch_and_end_before_a_fall():
    T = 6000
    speed = np.zeros((1, T, 18))
    speed[0, :, 0] = np.arange(T) / 1000.0
    switches = GaitSwitches(np.array([[3000]]), np.array([[1]]))
    rollouts = blank(1, T, v=speed, switches=switches)
    means = mean_by_gait(rollouts, 3)
    np.testing.assert_allclose(means[0, 0], [np.arange(1.0, 3.0, 1e-3).mean(), 0, 0])
    np.testing.assert_allclose(means[0, 1], [np.arange(4.0, 6.0, 1e-3).mean(), 0, 0])
    assert np.isnan(means[0, 2]).all()
    fell = replace(rollouts, length=np.array([5000]), outcome=np.array([Outcome.FELL]))
    np.testing.assert_allclose(mean_by_gait(fell, 2)[0, 1, 0], np.arange(4.0, 4.5, 1e-3).mean())


@pytest.fixture
def config(tmp_path) -> Config:
    path = tmp_path / "bound.npz"
    save_starts(replace(load_starts(), gait=GAITS["bound"]), path)
    other = replace(CONFIG.other_gaits[0], start_set=str(path))
    few = replace(CONFIG.evaluation, episodes=4)
    return replace(CONFIG, other_gaits=(other,), evaluation=few)


def test_robots_begin_in_all_gaits_alike_and_change_six_times(config):
    job = switching_job(config, None, "test")
    assert job.starts.gait.tolist() == [0, 0, 1, 1]
    assert job.episodes.duration == 20.0
    assert job.episodes.switches is not None
    assert job.episodes.switches.elapsed.shape == (4, 6)
    assert (job.episodes.switches.elapsed < 20_000).all()
    assert not job.privileged  # the expert is judged
    # Every policy is asked for the same changes at the same times, whatever it was trained with.
    again = switching_job(replace(config, seed=9, switches=1), None, "test").episodes.switches
    assert again is not None
    np.testing.assert_array_equal(again.elapsed, job.episodes.switches.elapsed)


def test_one_gait_has_none_to_change_to():
    with pytest.raises(ValueError, match="have none to change to: train a policy of several"):
        evaluate_switching(Config(), None, "test", Workers(1))


def test_figures_of_switching_are_counted(config, toys, monkeypatch):
    monkeypatch.setattr("surefoot.evaluation.gaits.DURATION", 2.0)
    from tests.fakes.toy import plan

    result = evaluate_switching(config, None, "test", Workers(1), plan)
    assert (result.seconds, result.switches, result.episodes) == (2.0, 6, 4)
    assert len(result.outcomes) == 4
    assert result.successes == result.outcomes.count("0")
    assert [speed.gait for speed in result.speeds] == ["trot", "bound"]
