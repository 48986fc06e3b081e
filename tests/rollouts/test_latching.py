"""Which robots would have switched themselves off: rules, ticks, and what counts for nothing."""

from dataclasses import replace

import numpy as np

from surefoot.config.profiles import ODRI
from surefoot.rollouts.latching import NEVER, Latch, first_latches, latched_in_words
from tests.fakes.rollouts import blank


def test_the_first_rule_that_is_broken_counts():
    rollouts = blank(5, 100)
    rollouts.q[1, 30, 9] = -2.9
    rollouts.v[1, 20, 8] = 81.0
    rollouts.v[2, 40, 17] = -90.0
    rollouts.q[3, 0, 7] = 0.91
    rollouts.q[4, 50, 8] = 1.5
    rollouts.v[4, 50, 6] = 90.0
    kind, tick = first_latches(rollouts, ODRI)
    assert [Latch(k) for k in kind] == [
        Latch.NONE,
        Latch.SPEED,
        Latch.SPEED,
        Latch.POSITION,
        Latch.POSITION,
    ]
    assert tick.tolist() == [NEVER, 20, 40, 0, 50]


def test_what_happens_after_the_end_and_in_the_tail_counts_for_nothing():
    rollouts = blank(2, 130, duration=100, length=np.array([60, 130]))
    rollouts.q[0, 60:, 9] = 3.0
    rollouts.q[1, 100:, 9] = 3.0
    kind, _ = first_latches(rollouts, ODRI)
    assert kind.tolist() == [Latch.NONE] * 2


def test_a_torque_that_is_long_at_its_limit_latches_where_a_profile_says_so():
    rollouts = blank(3, 100)
    rollouts.torque[0, 10:30, 4] = -1.8
    rollouts.torque[1, 10:29, 4] = 1.8  # one tick less
    rollouts.torque[2, 10:20, 4] = 1.8  # two joints, one after the other
    rollouts.torque[2, 20:30, 5] = 1.8
    assert first_latches(rollouts, ODRI)[0].tolist() == [Latch.NONE] * 3
    kind, tick = first_latches(rollouts, replace(ODRI, saturation=0.02))
    assert kind.tolist() == [Latch.TORQUE, Latch.NONE, Latch.NONE]
    assert tick.tolist() == [29, NEVER, NEVER]
    longer = replace(ODRI, saturation=1.0)  # than the episode
    assert first_latches(rollouts, longer)[0].tolist() == [Latch.NONE] * 3


def test_words_name_the_rule_and_the_time():
    rollouts = blank(1, 100)
    assert latched_in_words(rollouts, ODRI) == ""
    rollouts.q[0, 42, 9] = 2.81
    assert latched_in_words(rollouts, ODRI) == "position at 0.042 s"
