"""How an episode ends: falls, touchdowns to the tick, and what counts as stepping."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import TABLE_I, Gait, SafetyConfig
from surefoot.config.gait_table import GAITS
from surefoot.rollouts.outcome import (
    Falls,
    Outcome,
    airborne,
    failed,
    heights_of_swings,
    judged_from,
    never_standing,
    stepping,
    strictly_stepping,
    touchdowns,
)
from tests.fakes.robots import ROBOT
from tests.fakes.states import state_of, turned_robot

CONFIG = TABLE_I
RADIUS = ROBOT.foot_radius
T = 3000


# --- falls


def test_falls_and_divergence_are_failures_and_stalls_are_not():
    outcome = np.array([Outcome.SUCCESS, Outcome.FELL, Outcome.STALLED, Outcome.DIVERGED])
    assert failed(outcome).tolist() == [False, True, False, True]


def test_falls_are_judged_from_each_robots_grace_on():
    falls = Falls(replace(CONFIG, grace=0.01), 3)
    lying = state_of(np.array([turned_robot(z=0.05)] * 3))
    nobody = np.zeros(3, bool)
    assert falls.judge(lying, nobody, 9).tolist() == [False, False, False]
    assert falls.judge(lying, nobody, 10).tolist() == [True, True, True]
    assert falls.judge(lying, nobody, np.array([9, 10, 11])).tolist() == [False, True, True]


@pytest.mark.parametrize(
    ("body_contact", "ticks"), [(0.003, 3), (0.001, 1), (0.0005, 1), (0.0001, 1)]
)
def test_contact_that_lasts_is_a_fall_and_a_break_or_a_reset_begins_anew(body_contact, ticks):
    falls = Falls(replace(CONFIG, grace=0.0, body_contact=body_contact), 3)
    standing = state_of(np.array([turned_robot()] * 3))
    touching = np.array([True, True, False])
    for _ in range(ticks - 1):
        assert not falls.judge(standing, touching, 0).any()
    assert falls.judge(standing, touching, 0).tolist() == [True, True, False]
    assert not falls.judge(standing, np.zeros(3, bool), 0).any()
    for _ in range(ticks - 1):
        falls.judge(standing, touching, 0)
    falls.reset(np.array([True, False, False]))
    assert falls.judge(standing, touching, 0).tolist() == [ticks == 1, True, False]


def test_contact_is_no_fall_where_the_bounds_allow_it():
    falls = Falls(replace(CONFIG, grace=0.0, body_contact=0.0), 1)
    standing = state_of(turned_robot())
    assert not any(falls.judge(standing, np.ones(1, bool), tick)[0] for tick in range(1000))


# --- touchdowns and stepping


def foot(*spells, high=0.02):
    """Clearance and contact of one foot from spells in ms: positive on the ground, negative off."""
    contact = np.concatenate([np.full(abs(n), n > 0) for n in spells])
    return np.where(contact, 0.0, high), contact


@pytest.mark.parametrize(
    ("spells", "expected"),
    [
        ((100, -40, 20), [140]),
        ((100, -39, 20), []),
        ((100, -40, 19), []),
        ((-40, 20), [40]),  # in the air at the beginning
        ((100,), []),  # on the ground at the beginning is no touchdown
        ((-100,), []),
        ((100, -40, 30, -60, 20), [140, 230]),
        ((100, -200, 300, -200, 300), [300, 800]),
        # A bounce before the contact that holds: one touchdown, when it holds.
        ((100, -60, 5, -3, 30), [168]),
        # A bounce inside a swing leaves two swings that are too short, or one that is long enough.
        ((100, -30, 5, -30, 30), []),
        ((100, -60, 5, -30, 30), [195]),
        # Trembling after a good touchdown is no second one.
        ((100, -60, 30, *(-10, 30) * 9), [160]),
        # Trembling: off and on again, never long enough.
        ((100, *(-10, 10) * 50), []),
        ((100, *(-39, 60) * 10), []),
    ],
)
def test_touchdowns_tick_by_tick(spells, expected):
    assert touchdowns(*foot(*spells)).tolist() == expected


def test_a_touchdown_needs_clearance_at_some_time_of_the_swing():
    clearance, contact = foot(100, -50, 30, high=0.0049)
    assert touchdowns(clearance, contact).tolist() == []
    clearance[120] = 0.005
    assert touchdowns(clearance, contact).tolist() == [150]
    clearance[120] = 0.0
    clearance[99] = 0.01  # high, but in contact
    assert touchdowns(clearance, contact).tolist() == []


def gait(stride=500, stance=300, until=(T, T, T, T), high=0.03):
    """Heights of the foot centers and contacts of a trot whose feet stop at the given ticks."""
    t = np.arange(T)
    height = np.zeros((1, T, 4))
    contact = np.zeros((1, T, 4), bool)
    for leg, shift in enumerate((0, stride // 2, stride // 2, 0)):
        phase = (t + shift) % stride
        down = (phase < stance) | (t >= until[leg])
        swing = np.sin(np.pi * np.clip((phase - stance) / (stride - stance), 0, 1))
        contact[0, :, leg] = down
        height[0, :, leg] = RADIUS + np.where(down, 0.0, high * swing)
    return height, contact


def jitter(seed=0, high=0.004, switching=0.2):
    """A standing robot whose feet tremble: contacts flicker, feet lift a little."""
    rng = np.random.default_rng(seed)
    contact = rng.random((1, T, 4)) > switching
    height = RADIUS + np.where(contact, 0.0, high * rng.random((1, T, 4)))
    return height, contact


def test_a_trotting_robot_steps():
    assert stepping(*gait(), RADIUS).tolist() == [True]
    assert strictly_stepping(*gait(), RADIUS, 500).tolist() == [True]


@pytest.mark.parametrize("switching", [0.0, 0.05, 0.5, 0.95])
@pytest.mark.parametrize("high", [0.004, 0.2])
def test_a_standing_jittering_robot_does_not_step(high, switching):
    for seed in range(3):
        signal = jitter(seed, high, switching)
        if high > 0.005 and switching > 0.9:
            continue  # long in the air and high: that is hopping
        assert stepping(*signal, RADIUS).tolist() == [False]
        assert strictly_stepping(*signal, RADIUS, 500).tolist() == [False]


def test_feet_that_shuffle_below_five_millimeters_do_not_step():
    assert stepping(*gait(high=0.0045), RADIUS).tolist() == [False]
    assert stepping(*gait(high=0.0055), RADIUS).tolist() == [True]


@pytest.mark.parametrize("leg", range(4))
def test_every_foot_has_to_step_until_two_thirds_of_the_episode(leg):
    down = touchdowns(gait()[0][0, :, leg] - RADIUS, gait()[1][0, :, leg])
    np.testing.assert_array_equal(down, np.arange(250 if leg in (1, 2) else 500, T, 500))

    def stops_after(tick):
        until = (tick if i == leg else T for i in range(4))
        return stepping(*gait(until=tuple(until)), RADIUS).tolist()

    assert stops_after(down[down >= 2000][0] + 100) == [True]
    assert stops_after(down[down < 2000][-1] + 100) == [False]


def test_two_thirds_are_tick_exact():
    def with_last_touchdown(tick):
        _, contact = foot(100, -(tick - 100), T - tick)
        contact = np.repeat(contact[None, :, None], 4, axis=2)
        return stepping(np.where(contact, RADIUS, 0.05), contact, RADIUS).tolist()

    assert with_last_touchdown(2000) == [True]
    assert with_last_touchdown(1999) == [False]


def test_robots_of_a_batch_step_on_their_own():
    pairs = [gait(), jitter(), gait(until=(900, T, T, T)), gait(until=(2600, T, T, T))]
    height, contact = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    assert stepping(height, contact, RADIUS).tolist() == [True, False, False, True]
    assert strictly_stepping(height, contact, RADIUS, 500).tolist() == [True, False, False, True]


def test_strict_is_about_the_whole_episode_and_stepping_about_its_end():
    height, contact = gait()
    # No steps until the last third, then a trot: constant stepping by the letter, not strictly.
    height[:, :1400] = RADIUS
    contact[:, :1400] = True
    assert stepping(height, contact, RADIUS).tolist() == [True]
    assert strictly_stepping(height, contact, RADIUS, 500).tolist() == [False]


def test_strict_allows_a_third_of_the_episode_without_a_foot():
    def one_foot_rests(until):
        height, contact = gait()
        height[:, 1000:until, 3] = RADIUS
        contact[:, 1000:until, 3] = True
        return strictly_stepping(height, contact, RADIUS, 500).tolist()

    assert one_foot_rests(1300) == [True]  # no touchdown missed
    assert one_foot_rests(1500) == [True]  # one missed: nothing for 1000 of 3000 ticks
    assert one_foot_rests(2000) == [False]  # two missed: nothing for 1500


def test_strict_window_is_one_and_a_half_periods():
    height, contact = gait(stride=700, stance=400)
    assert strictly_stepping(height, contact, RADIUS, 500).tolist() == [True]
    height, contact = gait(stride=800, stance=400)
    assert strictly_stepping(height, contact, RADIUS, 500).tolist() == [False]
    assert strictly_stepping(height, contact, RADIUS, 600).tolist() == [True]


def test_a_robot_in_the_air_does_not_step():
    height = np.full((1, T, 4), 0.5)
    contact = np.zeros((1, T, 4), bool)
    assert stepping(height, contact, RADIUS).tolist() == [False]
    assert strictly_stepping(height, contact, RADIUS, 500).tolist() == [False]


# --- which episodes are judged for stepping


def test_a_trot_is_judged_from_three_periods_and_touchdowns_on():
    assert judged_from(CONFIG, Gait()) == CONFIG.stepping_from == 1.56
    assert judged_from(SafetyConfig(stepping_from=0.0), Gait()) == 1.56


@pytest.mark.parametrize(("name", "seconds"), [("walk", 3.06), ("crawl", 4.86)])
def test_slow_gaits_are_judged_later(name, seconds):
    assert judged_from(CONFIG, GAITS[name]) == pytest.approx(seconds)
    # In the last third of a perfect episode of that length every foot has touched down.
    gait = GAITS[name]
    third = seconds / 3
    assert third >= gait.period + 0.02


def test_fast_gaits_are_judged_no_earlier_than_configured():
    assert judged_from(CONFIG, GAITS["bound"]) == 1.56
    assert judged_from(SafetyConfig(stepping_from=4.0), Gait()) == 4.0


def test_standing_has_no_say_beside_other_gaits():
    assert judged_from(CONFIG, GAITS["stand"], GAITS["walk"]) == judged_from(CONFIG, GAITS["walk"])


def test_robots_that_are_to_stand_at_any_time_are_told_from_the_others():
    gaits = (GAITS["trot"], GAITS["stand"])
    walked = np.array([[0, 0, 0], [1, 1, 1], [0, 1, 0]])
    assert never_standing(gaits, walked).tolist() == [True, False, False]
    assert never_standing((), walked).all()


def test_standing_is_not_judged_and_neither_is_anyone_without_a_duration():
    assert judged_from(CONFIG, GAITS["stand"]) is None
    assert judged_from(SafetyConfig(stepping_from=None), Gait()) is None


# --- uneven ground


def test_intervals_in_the_air_are_found_at_both_ends_too():
    contact = np.array([False, False, True, True, False, True, False])
    assert airborne(contact) == [(0, 2), (4, 5), (6, 7)]
    assert airborne(np.ones(3, bool)) == []
    assert airborne(np.zeros(3, bool)) == [(0, 3)]


def one_foot(x, z, contact):
    """The clearance of one foot with these x and z, tick by tick."""
    feet = np.stack([np.array(x, float), np.zeros(len(x)), np.array(z, float)], axis=1)
    return heights_of_swings(feet[None, :, None], np.array(contact)[None, :, None], RADIUS)[0, :, 0]


def test_a_swing_is_as_high_as_it_is_above_the_line_between_its_footholds():
    contact = [True, False, False, False, True]
    clearance = one_foot([0.0, 0.1, 0.2, 0.3, 0.4], [0.10, 0.12, 0.16, 0.15, 0.14], contact)
    np.testing.assert_allclose(clearance - RADIUS, [0.0, 0.01, 0.04, 0.02, 0.0], atol=1e-12)
    # Along a slope that it does not leave, whatever its pace, it is not high.
    x = np.array([0.0, 0.3, 0.35, 0.39, 0.4])
    np.testing.assert_allclose(one_foot(x, 0.2 * x, contact), RADIUS, atol=1e-12)
    # On the spot, the ground is where it left it.
    clearance = one_foot([0.1] * 5, [0.10, 0.12, 0.16, 0.15, 0.10], contact)
    np.testing.assert_allclose(clearance - RADIUS, [0.0, 0.02, 0.06, 0.05, 0.0], atol=1e-12)


def test_a_swing_at_the_end_of_an_episode_has_the_foothold_that_it_left():
    clearance = one_foot([0.0, 0.1, 0.2], [0.10, 0.13, 0.14], [True, False, False])
    np.testing.assert_allclose(clearance - RADIUS, [0.0, 0.03, 0.04], atol=1e-12)
    clearance = one_foot([0.0, 0.1, 0.2], [0.14, 0.13, 0.10], [False, False, True])
    np.testing.assert_allclose(clearance - RADIUS, [0.04, 0.03, 0.0], atol=1e-12)
    np.testing.assert_array_equal(one_foot([0.0, 0.1], [0.2, 0.3], [False, False]), RADIUS)


def test_on_level_ground_stepping_is_judged_as_with_the_heights_themselves():
    height, contact = gait()
    feet = np.zeros((*height.shape, 3))
    for offset in (0.0, 0.4):
        feet[..., 2] = height + offset
        raised = heights_of_swings(feet, contact, RADIUS)
        assert stepping(raised, contact, RADIUS).tolist() == [True]
    feet[..., 2] = RADIUS + 0.4
    still = heights_of_swings(feet, contact, RADIUS)
    assert stepping(still, contact, RADIUS).tolist() == [False]
