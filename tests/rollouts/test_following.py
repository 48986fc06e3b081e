"""The expert follows commands: it neither drifts in turns nor settles at a fraction of a speed."""

from dataclasses import replace

import numpy as np

from surefoot.config import Config, ExpertConfig
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.rollouts.summary import velocities
from surefoot.scenarios.starts import at_rest

ALL_ROUND = Config(expert=ExpertConfig(capture_share=0.25, turn_compensation=0.3))
TURNS = np.array([[0.3, 0.0, 0.5], [0.3, 0.0, -1.0]])
FAST = np.array([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]])


def mean_velocity(config, commands, duration):
    """``(n, 3)`` velocity over the second half of walks that begin at rest."""
    starts = at_rest(standing(solo12()), commands)
    rollouts, _ = play_out(Job(config, Episodes(starts, duration), ExpertOnly()))
    assert not rollouts.failed.any()
    return velocities(rollouts)[:, rollouts.duration // 2 :].mean(axis=1)


def with_gain(config, gain):
    """A planner that reaches too little: its robots are slow by more than the deadband."""
    return replace(config, expert=replace(config.expert, command_gain=(gain, gain, gain)))


def test_a_robot_in_a_turn_does_not_drift_outward():
    velocity = mean_velocity(ALL_ROUND, TURNS, 2.0)
    np.testing.assert_allclose(velocity[:, :2], TURNS[:, :2], atol=0.03)
    np.testing.assert_allclose(velocity[:, 2], TURNS[:, 2], atol=0.1)


def test_the_rules_of_the_first_initial_states_drift_outward():
    velocity = mean_velocity(Config(), TURNS, 2.0)
    np.testing.assert_allclose(velocity[:, 1], -0.29 * TURNS[:, 0] * TURNS[:, 2], atol=0.02)


def test_a_slow_robot_does_not_settle_at_a_fraction_of_its_speed():
    """It reaches 0.37 m/s by footholds that take no notice of the measured velocity."""
    velocity = mean_velocity(with_gain(ALL_ROUND, 0.9), FAST, 4.0)
    assert (velocity[:, 0] * np.sign(FAST[:, 0]) > 0.33).all()


def test_the_rules_of_the_first_initial_states_settle_at_a_fraction():
    velocity = mean_velocity(with_gain(Config(), 0.9), FAST, 4.0)
    assert (np.abs(velocity[:, 0]) < 0.25).all()
