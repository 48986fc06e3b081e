"""Walks of the expert: what is recorded, their mean velocity, and who fell."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import TABLE_I, Config, SimulationConfig
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.walking import Walks, expert_walks

ROBOT = solo12()
SAFETY = TABLE_I


def still(T=1000, n=2) -> Walks:
    """Robots that stand for T ticks."""
    q = np.tile(standing(ROBOT), (T, n, 1))
    return Walks(np.arange(T), q, np.zeros((T, n, 18)), np.zeros((n, 3)))


def test_a_walk_is_recorded_at_multiples_of_a_tick():
    walks = expert_walks(ROBOT, Config(), np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.3]]), 150, 50)
    np.testing.assert_array_equal(walks.tick, [0, 50, 100])
    assert walks.q.shape == (3, 2, 19)
    np.testing.assert_allclose(walks.q[0], np.tile(standing(ROBOT), (2, 1)), atol=1e-12)
    assert (walks.q[2, 0] != walks.q[2, 1]).any()


def test_a_terrain_has_no_part_in_a_walk_on_the_plane():
    command = np.array([[0.2, 0.0, 0.0]])
    hills = Config(simulation=SimulationConfig(terrain="slope:10"))
    plane, other = (expert_walks(ROBOT, config, command, 120) for config in (Config(), hills))
    np.testing.assert_array_equal(other.q, plane.q)


def test_motors_that_heed_a_speed_limit_do_so_here_too():
    slow = replace(ROBOT, speed_limit=np.full(12, 1.0), enforce_speed_limit=True)
    command = np.array([[0.3, 0.0, 0.0]])
    free, limited = (expert_walks(robot, Config(), command, 200) for robot in (ROBOT, slow))
    assert np.abs(limited.v[..., 6:]).max() < 0.7 * np.abs(free.v[..., 6:]).max()


def test_progress_is_told_of_every_tick():
    ticks = []
    expert_walks(ROBOT, Config(), np.zeros((1, 3)), 7, progress=ticks.append)
    assert ticks == [1] * 7


def test_the_mean_velocity_is_that_in_the_heading_frame():
    walks = still()
    walks.q[:, :, 3:7] = [0.0, 0.0, np.sin(0.6), np.cos(0.6)]  # turned by 1.2 rad
    walks.v[:, 0, :2] = (0.3, -0.1)
    walks.v[:, 1, 5] = 0.4
    expected = [[0.3, -0.1, 0.0], [0.0, 0.0, 0.4]]
    np.testing.assert_allclose(walks.mean_velocity, expected, atol=1e-12)


def test_a_part_of_the_walks_begins_at_a_tick():
    part = still().since(900)
    assert part.tick[0] == 900
    assert part.q.shape == (100, 2, 19)


@pytest.mark.parametrize("value", [0.05, 3.0, np.nan])
def test_a_robot_that_lies_flies_or_has_no_height_has_fallen(value):
    walks = still()
    walks.q[600:, 1, 2] = value
    fallen = walks.fallen(SAFETY)
    assert not fallen[:, 0].any() and not fallen[:600].any()
    assert fallen[600:, 1].all()


def test_a_fall_is_said_with_command_and_time():
    walks = still()
    walks.command[1] = (0.25, -0.1, 0.5)
    walks.check(SAFETY, "pace")
    walks.q[700:, 1, 3:7] = [np.sin(0.4), 0.0, 0.0, np.cos(0.4)]
    text = (
        r"the gait pace does not carry the robot: 1 of 2 fell, at the commands \(vx, vy, yaw rate\)"
        r" \(0\.25, -0\.1, 0\.5\) after 0\.70 s; use a smaller box"
    )
    with pytest.raises(ValueError, match=text):
        walks.check(SAFETY, "pace")


def test_falls_before_the_grace_do_not_count():
    walks = still()
    walks.q[100:400, 0, 2] = 0.05
    walks.check(SAFETY, "trot")


def test_many_falls_are_not_all_named():
    walks = still(n=9)
    walks.q[600:, :, 2] = 0.05
    with pytest.raises(ValueError, match=r"9 of 9 fell.*, \.\.\.; use a smaller box") as error:
        walks.check(SAFETY, "trot")
    assert str(error.value).count("after") == 4
