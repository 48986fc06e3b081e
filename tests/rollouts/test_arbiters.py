"""Arbiters: who drives, and coins that belong to episodes, not to places in a batch."""

import numpy as np
import pytest

from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly, RandomMix, SafetySwitch
from surefoot.safety.monitor import SafetyMonitor
from tests.fakes.robots import STANDING
from tests.fakes.states import state_of


def choices(arbiter, ids, ticks, first=0):
    """``(B, ticks)`` who drives, from a tick of the gait clock on."""
    batch = len(ids)
    arbiter.reset(np.array(ids))
    clock = np.full(batch, first)
    command = np.zeros((batch, 3))
    state = state_of(np.tile(STANDING, (batch, 1)))
    rows = [arbiter.choose(state, clock + t, command) for t in range(ticks)]
    return np.array(rows).T


@pytest.mark.parametrize(("arbiter", "expert"), [(ExpertOnly(), True), (PolicyOnly(), False)])
def test_one_driver_drives_all_robots_always(arbiter, expert):
    assert (choices(arbiter, [4, 9, 2], 5) == expert).all()


@pytest.mark.parametrize(("probability", "every"), [(0.0, 1), (1.0, 1), (0.0, 50), (1.0, 50)])
def test_a_certain_coin_always_falls_the_same_way(probability, every):
    drove = choices(RandomMix(probability, every, seed=3), range(6), 120)
    assert (drove == (probability == 1.0)).all()


def test_a_coin_is_thrown_in_the_first_tick_and_then_on_its_grid():
    drove = choices(RandomMix(0.5, 50, seed=1), range(200), 160, first=17)
    changes = np.flatnonzero((np.diff(drove.astype(int), axis=1) != 0).any(axis=0)) + 1 + 17
    assert changes.tolist() == [50, 100, 150]
    assert 0.4 < drove[:, 0].mean() < 0.6


def test_a_coin_belongs_to_its_episode_and_begins_anew_at_a_reset():
    coin = RandomMix(0.5, 1, seed=1)
    together = choices(coin, [7, 300, 8], 40)
    np.testing.assert_array_equal(choices(coin, [300], 40)[0], together[1])
    np.testing.assert_array_equal(choices(coin, [8, 7], 40), together[[2, 0]])
    other_seed = choices(RandomMix(0.5, 1, seed=2), [7, 300, 8], 40)
    assert (other_seed != together).any(axis=1).all()


@pytest.mark.parametrize(("probability", "every"), [(-0.1, 1), (1.1, 1), (np.nan, 1), (0.5, 0)])
def test_a_coin_that_cannot_be_thrown_is_an_error(probability, every):
    with pytest.raises(ValueError, match="use a probability of 0 to 1, and at least 1 tick"):
        RandomMix(probability, every, seed=0)


class UnsafeAt:
    """A gate that says unsafe at given calls, of the first robot only."""

    def __init__(self, *calls):
        self.calls = calls

    def reset(self, batch):
        self.batch = batch
        self.asked = 0

    def unsafe(self, state, tick, command):
        unsafe = np.zeros(self.batch, bool)
        unsafe[0] = self.asked in self.calls
        self.asked += 1
        return unsafe


def test_the_expert_drives_while_the_monitor_blocks():
    switch = SafetySwitch(SafetyMonitor(UnsafeAt(2), block=0.004))
    for _ in range(2):  # a reset unblocks
        drove = choices(switch, [0, 1], 10)
        assert np.flatnonzero(drove[0]).tolist() == [2, 3, 4, 5]
        assert not drove[1].any()
