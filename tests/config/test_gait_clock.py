"""The gait clock: phases, stance, and when a gait that is asked for begins."""

import numpy as np
import pytest

from surefoot.config import Gait
from surefoot.config.gait_clock import GaitChange, grid_cycle, in_stance, phase, switch_tick
from surefoot.config.gait_table import GAITS
from surefoot.types import GRID, Command

TROT = GAITS["trot"]
WALK = GAITS["walk"]
BOUND = GAITS["bound"]
CLOCK = np.arange(0, 1000)


def test_the_two_pairs_of_a_trot_are_half_a_period_apart():
    legs = phase(TROT, CLOCK)
    np.testing.assert_allclose((legs[:, 0] - legs[:, 1]) % 1.0, 0.5)
    np.testing.assert_array_equal(in_stance(TROT, CLOCK), in_stance(TROT, CLOCK + 500))


def test_gait_and_grid_meet_again():
    assert grid_cycle(TROT) == 500
    assert grid_cycle(Gait(period=0.33)) == 1650
    stance = in_stance(Gait(period=0.33), np.arange(0, 3300, GRID))
    np.testing.assert_array_equal(stance[:33], stance[33:])


def walked(change, ticks):
    return [change.at(tick) for tick in ticks]


def test_a_gait_that_is_asked_for_begins_at_its_switch_tick():
    change = GaitChange([TROT, WALK])
    change.ask(1, 230)
    assert change.asked == 1
    begins = switch_tick(TROT, WALK, 230)
    assert begins == 1000
    assert walked(change, [230, begins - 1, begins, begins + 1]) == [0, 0, 1, 1]


def test_asking_again_does_not_put_a_gait_off():
    change = GaitChange([TROT, WALK])
    for tick in range(230, 1500):
        change.ask(1, tick)
        assert change.at(tick) == int(tick >= 1000)


def test_of_two_wishes_before_a_switch_the_later_one_counts():
    change = GaitChange([TROT, WALK, BOUND])
    change.ask(1, 230)
    change.ask(2, 240)
    begins = switch_tick(TROT, BOUND, 240)
    assert begins < 1000
    assert walked(change, [begins - 1, begins, 1000]) == [0, 2, 2]
    change.ask(1, 1001)
    change.ask(2, 1100)
    assert walked(change, range(1001, 2500, 7)) == [2] * len(range(1001, 2500, 7))


def test_an_episode_begins_in_its_gait_at_once():
    change = GaitChange([TROT, WALK])
    change.ask(1, 230)
    change.begin(1)
    assert change.at(0) == 1


def test_a_command_has_the_gait_that_is_walked():
    change = GaitChange([TROT, WALK])
    velocity = Command(0.1, 0.0, 0.2)
    assert change.command(velocity, 0) is velocity
    change.ask(1, 1)
    assert change.command(velocity, 999).gait == 0
    told = change.command(velocity, 1000)
    assert (tuple(told), told.gait) == ((0.1, 0.0, 0.2), 1)


@pytest.mark.parametrize("number", [-1, 2])
def test_a_gait_that_is_not_there_is_refused(number):
    change = GaitChange([TROT, WALK])
    with pytest.raises(ValueError, match="use 0 to 1"):
        change.ask(number, 0)
    with pytest.raises(ValueError, match="use 0 to 1"):
        change.begin(number)
    assert change.asked == 0
