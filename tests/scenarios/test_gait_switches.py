"""When robots change their gait: known answers for clocks and phases, and draws by episode."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.config.gait_clock import in_stance, switch_tick
from surefoot.config.gait_table import GAITS
from surefoot.learning.observation import goal, observation_spec
from surefoot.mpc.gaits import with_gaits
from surefoot.scenarios.gait_switches import (
    NEVER,
    GaitSwitches,
    draw_switches,
    gaits_by_tick,
    in_turn,
    join_switches,
    switches_at,
)
from tests.fakes.drivers import starts_of

NAMES = ("trot", "walk", "bound", "pronk")
CONFIG = with_gaits(Config(), NAMES)


@pytest.mark.parametrize(
    ("old", "new", "asked", "begun"),
    [
        ("trot", "walk", 0, 0),
        ("trot", "walk", 1, 1000),
        ("walk", "trot", 501, 1000),
        ("trot", "bound", 610, 900),
        ("bound", "pronk", 1001, 1500),
        # At 300 and 600 ms a pronk stands and has stood; at 900 it flies, at 1500 it lands.
        ("pronk", "bound", 250, 300),
        ("pronk", "bound", 601, 1200),
        ("pronk", "bound", 1201, 1800),
        # A trot begins where a pronk lands, whenever it is asked for.
        ("pronk", "trot", 1, 500),
    ],
)
def test_a_gait_begins_with_its_cycle_while_a_foot_of_the_old_one_stands(old, new, asked, begun):
    assert switch_tick(GAITS[old], GAITS[new], asked) == begun


@pytest.mark.parametrize("old", NAMES)
@pytest.mark.parametrize("new", NAMES)
def test_a_gait_begins_on_the_grid_of_plans_and_soon(old, new):
    for asked in range(0, 3000, 37):
        begun = switch_tick(GAITS[old], GAITS[new], asked)
        assert begun % 50 == 0
        assert asked <= begun <= asked + 1500
        assert in_stance(GAITS[new], begun).any()


def test_switches_count_from_the_beginning_of_each_episode_and_stay_in_order():
    starts = starts_of([0, 130])
    asked = np.array([[610, 620], [610, 1400]])
    chosen = np.array([[1, 2], [2, 0]])
    switches = switches_at(CONFIG.gaits, starts, asked, chosen)
    # Asked for at 610 and 620: the walk begins at 1000, and so the bound only after it.
    assert switches.elapsed[0].tolist() == [1000, 1200]
    assert (switches.elapsed[1] + 130).tolist() == [900, 2000]
    table = gaits_by_tick(starts.gait, switches, 1300)
    assert table[0, [0, 999, 1000, 1199, 1200]].tolist() == [0, 0, 1, 1, 2]
    assert table[1, [0, 769, 770]].tolist() == [0, 0, 2]
    for tick in (0, 770, 1000, 1250):
        np.testing.assert_array_equal(switches.at(starts.gait, tick), table[:, tick])


def test_the_phase_across_a_switch_is_that_of_each_gaits_own_period():
    spec = observation_spec(CONFIG)
    tick = np.array([899, 900, 975])
    gait = np.array([0, 2, 2])
    rows = goal(tick, np.zeros((3, 3)), spec, gait=gait)
    # 899 ms are 0.798 of the trot's second cycle; at 900 ms a bound of 300 ms begins.
    angle = 2 * np.pi * np.array([399 / 500, 0.0, 75 / 300])
    np.testing.assert_allclose(rows[:, 0], np.sin(angle), atol=1e-6)
    np.testing.assert_allclose(rows[:, 1], np.cos(angle), atol=1e-6)
    np.testing.assert_array_equal(rows[:, 5:], np.eye(4)[gait])


def test_an_episode_that_goes_on_keeps_the_switches_to_come():
    switches = GaitSwitches(np.array([[100, NEVER]]), np.array([[3, 0]]))
    first = np.array([1])
    later = switches.after(np.array([60]))
    assert later.at(first, 39).tolist() == [1]
    assert later.at(first, 40).tolist() == [3]
    assert later.elapsed[0, 1] == NEVER
    # After it, the robot begins in the gait that it had then.
    over = switches.after(np.array([500]))
    assert over.at(np.array([3]), 0).tolist() == [3]
    assert gaits_by_tick(np.array([3]), over, 4).tolist() == [[3, 3, 3, 3]]


def test_joined_switches_are_those_of_each_part():
    one = GaitSwitches(np.array([[10, 20]]), np.array([[1, 2]]))
    other = GaitSwitches(np.array([[5]]), np.array([[3]]))
    both = join_switches([one, other])
    first = np.array([0, 0])
    for tick in (0, 5, 10, 25):
        expected = [one.at(first[:1], tick)[0], other.at(first[:1], tick)[0]]
        assert both.at(first, tick).tolist() == expected


def test_what_is_drawn_depends_on_the_episode_alone():
    starts = starts_of([0, 100, 250, 400])
    ids = np.array([7, 8, 9, 10])
    drawn = draw_switches(CONFIG, starts, 8.0, ids)
    assert drawn is not None
    part = draw_switches(CONFIG, starts[1:3], 8.0, ids[1:3])
    assert part is not None
    np.testing.assert_array_equal(part.elapsed, drawn.elapsed[1:3])
    np.testing.assert_array_equal(part.gait, drawn.gait[1:3])
    other = draw_switches(replace(CONFIG, seed=1), starts, 8.0, ids)
    assert other is not None
    assert (other.elapsed != drawn.elapsed).any()


def test_every_switch_is_to_another_gait_and_all_come():
    starts = starts_of([0] * 200)
    drawn = draw_switches(replace(CONFIG, switches=3), starts, 8.0, np.arange(200))
    assert drawn is not None
    before = np.column_stack([starts.gait, drawn.gait[:, :-1]])
    assert (drawn.gait != before).all()
    assert set(drawn.gait[:, 0].tolist()) == {1, 2, 3}
    assert (drawn.elapsed[:, 0] >= 1000).all()


def test_robots_of_one_gait_have_no_switches():
    starts = starts_of([0])
    assert draw_switches(Config(), starts, 8.0, starts.id) is None
    assert draw_switches(replace(CONFIG, switches=0), starts, 8.0, starts.id) is None


def test_gaits_in_turn_have_an_equal_part_of_the_time():
    starts, switches = in_turn(CONFIG, starts_of([0]), [2, 0, 1], 9.0)
    assert starts.gait.tolist() == [2]
    assert switches.elapsed.tolist() == [[3000, 6000]]
    assert switches.gait.tolist() == [[0, 1]]
    alone, none = in_turn(CONFIG, starts_of([0]), [1], 9.0)
    assert none.at(alone.gait, 5000).tolist() == [1]


@pytest.mark.parametrize(
    ("elapsed", "gait", "words"),
    [
        (np.zeros((2, 1), int), np.zeros((2, 2), int), "give both for each robot"),
        (np.array([[20, 10]]), np.array([[1, 2]]), "not in the order of time"),
    ],
)
def test_switches_that_contradict_themselves_are_refused(elapsed, gait, words):
    with pytest.raises(ValueError, match=words):
        GaitSwitches(elapsed, gait)


def test_a_switch_to_no_gait_is_refused():
    with pytest.raises(ValueError, match="a switch to gait number -1; use 0 or more"):
        GaitSwitches(np.array([[10, 20]]), np.array([[1, -1]]))


def test_switches_may_be_lists_of_whole_numbers():
    switches = GaitSwitches([[5, 9]], [[1, 0]])  # pyright: ignore
    assert switches.elapsed.dtype == switches.gait.dtype == np.int64
    assert len(GaitSwitches([[], []], [[], []])) == 2  # pyright: ignore
    with pytest.raises(ValueError, match="sort each row"):
        GaitSwitches(np.array([[9, 5]], np.uint8), np.zeros((1, 2), np.uint8))  # pyright: ignore
    with pytest.raises(ValueError, match="elapsed is float64; use whole numbers"):
        GaitSwitches([[5.5]], [[1]])  # pyright: ignore
