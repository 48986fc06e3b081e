"""Noise on the torques: its covariance, how long it is held, and which robot has which."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import rollout
from surefoot.scenarios.disturbance import Disturbance, join_disturbances
from surefoot.scenarios.torque_noise import HeldNoise, TorqueNoise, make_torque_noise
from tests.fakes.drivers import FakeController, standing_for
from tests.fakes.robots import ROBOT
from tests.fakes.simulator import FakeSimulator

MIX = np.random.default_rng(0).normal(size=(12, 5)) * 0.1
COVARIANCE = MIX @ MIX.T
"""Of rank 5: a learner's error may be so."""


def noise_of(ids, hold=50, covariance=COVARIANCE, root=3) -> TorqueNoise:
    return make_torque_noise(covariance, hold, root, np.array(ids))


def test_draws_have_the_covariance_asked_for():
    noise = noise_of(range(40))
    each = np.array([[noise.draw(b, n) for n in range(500)] for b in range(40)])
    draws = each.reshape(40 * 500, -1)
    assert np.abs(draws.mean(axis=0)).max() < 0.01
    error = np.cov(draws.T) - COVARIANCE
    assert np.abs(error).max() < 0.05 * np.abs(COVARIANCE).max()
    product = each[:, :-1] * each[:, 1:]
    assert np.abs(product.mean(axis=(0, 1))).max() < 0.003  # one draw says nothing of the next


def test_a_draw_is_held_and_depends_on_root_and_id_alone():
    held = HeldNoise(noise_of([7, 9, 11], hold=20))
    seen = np.array([held.at(t).copy() for t in range(100)])
    assert len(np.unique(seen[:, 1, 0])) == 5
    assert (seen[:20] == seen[0]).all()
    alone = noise_of([9])
    np.testing.assert_array_equal(seen[45, 1], alone.draw(0, 2))
    assert (noise_of([9], root=4).draw(0, 2) != alone.draw(0, 2)).any()
    assert (noise_of([8]).draw(0, 2) != alone.draw(0, 2)).any()


def test_episodes_that_go_on_keep_their_noise():
    noise = noise_of([7, 9], hold=20)
    whole = HeldNoise(noise)
    later = HeldNoise(noise.after(np.array([35, 10])))
    expected = [whole.at(t).copy() for t in range(100)]
    for t in range(40):
        now = later.at(t)
        np.testing.assert_array_equal(now[0], expected[t + 35][0])
        np.testing.assert_array_equal(now[1], expected[t + 10][1])


def test_a_disturbance_carries_it_through_rows_branches_and_joins():
    disturbance = Disturbance(torque_noise=noise_of([7, 9, 11]))
    assert disturbance.batch == 3
    some = disturbance[np.array([2, 0])]
    assert some.torque_noise is not None
    np.testing.assert_array_equal(some.torque_noise.draw(0, 4), noise_of([11]).draw(0, 4))
    later = disturbance.after(np.array([10, 20, 30])).torque_noise
    assert later is not None and later.before.tolist() == [10, 20, 30]
    joined = join_disturbances([disturbance[:1], disturbance[1:]]).torque_noise
    assert joined is not None and len(joined) == 3
    np.testing.assert_array_equal(joined.draw(2, 1), noise_of([11]).draw(0, 1))
    with pytest.raises(ValueError, match="torque noise for 3"):
        Disturbance(torque_noise=noise_of([7, 9, 11]), friction=np.ones(2))


def test_it_acts_on_the_robot_and_not_on_what_is_recorded():
    noise = noise_of([7, 9], hold=5, covariance=4.0 * np.eye(12))
    simulator = FakeSimulator(2)
    disturbance = Disturbance(torque_noise=noise, delay=2)
    episodes = replace(standing_for(0.02, batch=2), disturbance=disturbance)
    rollouts = rollout(simulator, episodes, ExpertOnly(), FakeController(1.0))
    limit = ROBOT.torque_limit
    clipped = 0
    for t, applied in enumerate(simulator.applied):
        commanded = rollouts.torque[:, max(t - 2, 0)]
        held = np.array([noise.draw(b, t // 5) for b in range(2)])
        np.testing.assert_allclose(applied, np.clip(commanded + held, -limit, limit), atol=1e-12)
        clipped += (np.abs(commanded + held) > limit).sum()
    assert len(simulator.applied) == 20 and clipped > 0
    assert (rollouts.expert_torque == rollouts.torque).all()
    np.testing.assert_allclose(rollouts.torque[:, 0], 1.0, atol=0.05)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"root": np.eye(11)}, r"root \(11, 11\) must be \(12, 12\)"),
        ({"root": np.full((12, 12), np.nan)}, "finite"),
        ({"hold": 0}, "held for 0 ms"),
        ({"before": np.zeros(3, int)}, "before must be"),
        ({"before": np.array([-1, 0])}, "before must be"),
    ],
)
def test_noise_that_cannot_be_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(noise_of([7, 9]), **changes)
