"""How a robot stands up and stands: from its own pose, smoothly, with gains of its own."""

import numpy as np
import pytest

from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.loop import Mode
from tests.fakes.bridge_world import World

LYING = [0.3, 1.2, -1.0] * 4


@pytest.fixture
def lying() -> World:
    world = World(config=RuntimeConfig(stand=0.2))
    world.driver.q = LYING
    return world


def test_standing_up_begins_where_the_robot_is_and_ends_in_its_posture(lying):
    lying.run(300)
    written = np.array(lying.driver.written)
    policy = lying.policy
    standing = written[written[:, 24] == lying.runtime.config.stand_kp * policy.kp[0]]
    np.testing.assert_array_equal(standing[:, 36:48], lying.runtime.config.stand_kd * policy.kd[0])
    target = standing[:, :12]
    np.testing.assert_allclose(target[0], LYING, atol=0.01)
    np.testing.assert_allclose(target[-1], policy.nominal, atol=0.01)
    # The middle of half a cosine is its steepest part.
    steepest = np.pi / 2 * np.abs(policy.nominal - LYING).max() / 200
    assert np.abs(np.diff(target, axis=0)).max() < 1.05 * steepest


def test_a_robot_that_rests_keeps_its_posture(lying):
    lying.operator.wanted = lying.operator.wanted._replace(rest=True)
    lying.run(300)
    before = len(lying.driver.written)
    lying.run(300)
    target = np.array(lying.driver.written[before:])[:, :12]
    assert len(target) >= 300
    np.testing.assert_allclose(target - lying.policy.nominal, 0.0, atol=1e-6)


def test_a_robot_of_which_every_second_state_is_lost_does_not_stand_up():
    world = World()
    world.run(1)
    assert world.policy.rehearsed
    for _ in range(20):
        world.runtime_runs = not world.runtime_runs
        world.run(1)
        assert world.runtime.mode == Mode.DAMP
    assert not world.driver.commanded
    world.runtime_runs = True
    world.run(2)
    assert world.runtime.mode == Mode.STAND
