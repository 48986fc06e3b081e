"""Command gains: measured on the robot, and on walks whose answer is known."""

import numpy as np
import pytest

from surefoot.config import CommandBox, Config, ExpertConfig, Gait
from surefoot.config.expert_rules import TROT_GAIN
from surefoot.config.gait_table import GAITS
from surefoot.mpc.gaits import with_gait
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.scenarios import calibration
from surefoot.scenarios.calibration import (
    LEAST_TRIED,
    TRIED,
    calibrate_command_gain,
    told_commands,
)
from surefoot.scenarios.walking import Walks

ROBOT = solo12()


def walks_at(share, monkeypatch) -> list:
    """Let the expert reach these shares of what is planned; what was asked of it."""
    asked = []

    def fake(robot, config, command, ticks) -> Walks:
        asked.append((config, command, ticks))
        n = len(command)
        v = np.zeros((ticks, n, 18))
        gain = config.expert.command_gain
        v[:, :, [0, 1, 5]] = share * gain * command + (0.01, -0.02, 0.03)  # and a bias
        v[: ticks // 3] = 0.0  # speeding up does not count
        return Walks(np.arange(ticks), np.tile(standing(ROBOT), (ticks, n, 1)), v, command)

    monkeypatch.setattr(calibration, "expert_walks", fake)
    return asked


def test_the_gains_undo_what_a_gait_loses_whatever_its_bias(monkeypatch):
    asked = walks_at(np.array([0.8, 1.25, 0.7]), monkeypatch)
    config = Config(expert=ExpertConfig(command_gain=(3.0, 3.0, 3.0)))
    measured = calibrate_command_gain(ROBOT, Gait(period=0.3), config)
    assert measured.gain == pytest.approx((1.25, 0.8, 1 / 0.7), abs=1e-4)
    assert measured.told == (0.2, 0.15, 0.5)
    assert measured.forward == pytest.approx((0.17, 0.1675, 0.38))
    assert measured.backward == pytest.approx((-0.15, -0.2075, -0.32))
    [(used, command, ticks)] = asked
    assert used.expert.command_gain == (1.0, 1.0, 1.0)
    assert used.gait.period == 0.3
    assert (command.shape, ticks) == ((6, 3), 3000)
    np.testing.assert_array_equal(command[3:], -command[:3])


def test_a_large_gain_is_measured_again_with_itself(monkeypatch):
    asked = walks_at(np.array([0.5, 1.0, 1.0]), monkeypatch)
    measured = calibrate_command_gain(ROBOT, Gait(), Config())
    assert measured.gain == pytest.approx((2.0, 1.0, 1.0))
    assert measured.forward[0] == pytest.approx(0.21)
    assert [config.expert.command_gain[0] for config, _, _ in asked] == pytest.approx([1.0, 2.0])


def test_a_gait_that_falls_with_its_large_gain_keeps_it(monkeypatch):
    """What falls then is a command of the measurement, and a box may have smaller ones alone."""
    walks_at(np.array([0.5, 0.5, 1.0]), monkeypatch)
    upright = calibration.expert_walks

    def overdone(robot, config, command, ticks) -> Walks:
        walks = upright(robot, config, command, ticks)
        if config.expert.command_gain[1] > 1.5:
            walks.q[600:, [1, 4], 2] = 0.01  # those that go sideways
            walks.v[600:, [1, 4]] = 0.0
        return walks

    monkeypatch.setattr(calibration, "expert_walks", overdone)
    config = Config(commands=CommandBox(vy=(-0.2, 0.2)))
    measured = calibrate_command_gain(ROBOT, Gait(), config)
    assert measured.gain == pytest.approx((2.0, 2.0, 1.0))
    # With the gain along vx, and without it along vy.
    assert measured.forward[:2] == pytest.approx((0.21, 0.055))


def test_larger_robots_are_tried_at_higher_speeds(monkeypatch):
    walks_at(np.ones(3), monkeypatch)
    config = Config(commands=CommandBox((0.0, 1.0), (-1.0, 0.5)))
    measured = calibrate_command_gain(ROBOT, Gait(), config, scale=4.0)
    assert measured.told == pytest.approx((0.4, 0.3, 0.5))


def test_robots_are_told_no_more_than_the_box_has():
    box = CommandBox((-0.1, 0.05), (0.0, 0.001), (0.0, 0.0))
    assert told_commands(box, 1.0) == pytest.approx((0.1, LEAST_TRIED * TRIED[1], TRIED[2]))


def test_a_gait_that_hops_on_the_spot_is_refused_with_numbers(monkeypatch):
    walks_at(np.array([0.9, 0.1, 0.9]), monkeypatch)
    text = "the gait bound does not move the robot: of vy 0.1 m/s it reached -0.010"
    config = Config(commands=CommandBox(vy=(-0.1, 0.1)))
    with pytest.raises(ValueError, match=text):
        calibrate_command_gain(ROBOT, GAITS["bound"], config)


def test_an_axis_without_commands_needs_no_gain(monkeypatch):
    walks_at(np.array([0.8, 0.1, -0.5]), monkeypatch)
    measured = calibrate_command_gain(ROBOT, GAITS["bound"], Config())
    assert measured.gain == pytest.approx((1.25, 1.0, 1.0))


def test_a_robot_that_has_fallen_and_stands_at_the_end_has_no_share_in_the_gains(monkeypatch):
    walks_at(np.array([0.8, 0.8, 0.8]), monkeypatch)
    upright = calibration.expert_walks

    def stumble(*arguments) -> Walks:
        walks = upright(*arguments)
        walks.q[1500:2000, 4, 2] = 0.01  # told to walk to the right
        return walks

    monkeypatch.setattr(calibration, "expert_walks", stumble)
    box = CommandBox(vy=(0.0, 0.0), yaw_rate=(0.0, 0.0))
    measured = calibrate_command_gain(ROBOT, Gait(), Config(commands=box))
    assert measured.gain == pytest.approx((1.25, 1.0, 1.25))


def test_a_gait_that_falls_is_refused_with_numbers():
    gallop = Gait(period=0.5, duty=0.35, offsets=(0.0, 0.2, 0.55, 0.75))
    with pytest.raises(ValueError, match=r"the gait custom does not carry the robot: \d of 2 fell"):
        calibrate_command_gain(ROBOT, gallop, Config())


def test_the_gains_of_the_trot_come_out_as_those_of_the_first_initial_states():
    measured = calibrate_command_gain(ROBOT, Gait(), Config())
    assert measured.gain == pytest.approx(TROT_GAIN, abs=0.015)


def test_a_walk_reaches_what_it_is_told_with_its_gains():
    """Measured before, by other means: 0.99, 0.99 and 1.33."""
    config = with_gait(Config(), "walk")
    measured = calibrate_command_gain(ROBOT, config.gait, with_own_values(config))
    assert measured.gain == pytest.approx((0.99, 0.99, 1.33), abs=0.03)
