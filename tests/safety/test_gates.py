"""The paper's table, the three hand-back rules tick by tick, falls, and what counts as stepping."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import SafetyConfig
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.outcome import fallen, stepping, strictly_stepping, touchdowns
from surefoot.safety.gates import AnyOf, Bounds, margin, tightened, unsafe
from surefoot.safety.monitor import HandBack, SafetyMonitor
from surefoot.types import JOINTS, State

CONFIG = SafetyConfig()
STANDING = standing(solo12())
RADIUS = 0.018


def state_of(q, com_height: float | np.ndarray = 0.2):
    q = np.atleast_2d(q)
    B = len(q)
    com = np.zeros((B, 3))
    com[:, 2] = com_height
    return State(q, np.zeros((B, 18)), com, np.zeros((B, 4, 3)), np.ones((B, 4), bool))


def turned(roll=0.0, pitch=0.0, yaw=0.0, z=0.25):
    q = STANDING.copy()
    R = pin.rpy.rpyToMatrix(*np.radians([roll, pitch, yaw]))
    q[2], q[3:7] = z, pin.Quaternion(R).coeffs()
    return q


def with_joint(name, degrees):
    q = STANDING.copy()
    q[7 + JOINTS.index(name)] = np.radians(degrees)
    return q


# --- the paper's table


def bounds_of_the_table():
    for leg in ("FL", "FR", "HL", "HR"):
        front, left = leg[0] == "F", leg[1] == "L"
        yield f"{leg}_HAA", *((-30, 60) if left else (-60, 30))
        yield f"{leg}_HFE", *((0, 90) if front else (-90, 0))
        yield f"{leg}_KFE", *((-160, 0) if front else (0, 160))


@pytest.mark.parametrize(("joint", "low", "high"), list(bounds_of_the_table()))
def test_each_joint_on_both_sides_of_both_bounds(joint, low, high):
    q = np.array([with_joint(joint, x) for x in (low - 0.1, low + 0.1, high - 0.1, high + 0.1)])
    np.testing.assert_array_equal(unsafe(state_of(q), CONFIG), [True, False, False, True])


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_roll_and_pitch_on_both_sides_in_any_heading(axis):
    for yaw in (0, 90, 200):
        q = np.array([turned(**{axis: x}, yaw=yaw) for x in (-25.1, -24.9, 24.9, 25.1)])
        np.testing.assert_array_equal(unsafe(state_of(q), CONFIG), [True, False, False, True])


def test_height_of_the_centre_of_mass_on_both_sides():
    q = np.tile(STANDING, (4, 1))
    heights = np.array([0.149, 0.151, 0.999, 1.001])
    np.testing.assert_array_equal(unsafe(state_of(q, heights), CONFIG), [True, False, False, True])


def test_the_table_looks_at_the_centre_of_mass_and_a_fall_at_the_base():
    low_com, low_base = state_of(turned(), 0.1), state_of(turned(z=0.05), 0.2)
    assert unsafe(low_com, CONFIG)[0]
    assert not fallen(low_com, CONFIG)[0]
    assert not unsafe(low_base, CONFIG)[0]
    assert fallen(low_base, CONFIG)[0]


def test_bounds_come_from_the_config():
    tight = replace(CONFIG, knee=(-90.0, 0.0))
    assert not unsafe(state_of(STANDING), CONFIG)[0]
    assert unsafe(state_of(STANDING), tight)[0]


def test_a_state_that_is_not_a_number_is_unsafe():
    q = np.tile(STANDING, (3, 1))
    q[1, 9] = np.nan
    q[2, 3] = np.nan
    np.testing.assert_array_equal(unsafe(state_of(q), CONFIG), [False, True, True])
    np.testing.assert_array_equal(fallen(state_of(q), CONFIG), [False, False, True])


# --- falls


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_falls_by_angle(axis):
    for yaw in (0, 130):
        q = np.array([turned(**{axis: x}, yaw=yaw) for x in (-30.1, -29.9, 29.9, 30.1, 180)])
        np.testing.assert_array_equal(fallen(state_of(q), CONFIG), [True, False, False, True, True])


def test_falls_by_height():
    q = np.array([turned(z=z) for z in (0.099, 0.101, 1.999, 2.001)])
    np.testing.assert_array_equal(fallen(state_of(q), CONFIG), [True, False, False, True])


# --- the hand-back rules


NOW = state_of(np.tile(STANDING, (1, 1))), np.zeros(1, int), np.zeros((1, 3))


class Signal:
    """A gate that says what it was told, tick by tick."""

    def __init__(self, signal):
        self.signal = signal

    def reset(self, batch):
        self.tick = -1

    def unsafe(self, state, tick, command):
        self.tick += 1
        return self.signal[:, self.tick]


def driven(violations, hand_back, block=0.005):
    """Who drives on a scripted signal; X: violation or expert, dot: safe or policy."""
    signal = np.array([[mark == "X" for mark in row] for row in violations])
    monitor = SafetyMonitor(Signal(signal), block, hand_back)
    monitor.reset(len(signal))
    ticks = [monitor.blocking(*NOW) for _ in range(signal.shape[1])]
    return ["".join(".X"[int(x)] for x in row) for row in np.array(ticks).T]


EVERY = HandBack.EVERY_VIOLATION_RESTARTS
OR = HandBack.SAFE_OR_BLOCKED
AND = HandBack.SAFE_AND_BLOCKED


@pytest.mark.parametrize(
    ("violations", "rule", "expert"),
    [
        # One violation: T_block is five ticks, the one of the violation among them.
        ("..X..........", EVERY, "..XXXXX......"),
        ("..X..........", AND, "..XXXXX......"),
        ("..X..........", OR, "..X.........."),
        # A second one inside the block: (a) counts anew from it, (c) from the takeover.
        ("..X..X.......", EVERY, "..XXXXXXXX..."),
        ("..X..X.......", AND, "..XXXXX......"),
        ("..X..X.......", OR, "..X..X......."),
        # Unsafe until just after T_block is over.
        ("..XXXXXX.....", EVERY, "..XXXXXXXXXX."),
        ("..XXXXXX.....", AND, "..XXXXXX....."),
        ("..XXXXXXXX...", OR, "..XXXXX.XX..."),
        # Safe exactly when it is over.
        ("..XXXXX......", AND, "..XXXXX......"),
        ("..XXXXX......", OR, "..XXXXX......"),
        # From the first tick on; a new violation right after the hand-back.
        ("X....X.......", EVERY, "XXXXXXXXXX..."),
        ("X....X.......", AND, "XXXXXX......."),
        ("X.....X......", EVERY, "XXXXX.XXXXX.."),
        ("X.....X......", AND, "XXXXX.XXXXX.."),
        ("X.....X......", OR, "X.....X......"),
        (".............", EVERY, "............."),
        (".............", AND, "............."),
        (".............", OR, "............."),
    ],
)
def test_hand_back_tick_by_tick(violations, rule, expert):
    assert driven([violations], rule) == [expert]


@pytest.mark.parametrize("rule", HandBack)
def test_robots_of_a_batch_are_blocked_on_their_own(rule):
    rows = ["..X.....X....", ".............", "XXXXXXXXX....", "..X..X......."]
    together = driven(rows, rule)
    assert together == [driven([row], rule)[0] for row in rows]
    assert len(set(together)) == 4


@pytest.mark.parametrize("rule", HandBack)
def test_reset_forgets_every_block(rule):
    signal = np.array([[True, False], [False, False]])
    monitor = SafetyMonitor(Signal(signal), 0.005, rule)
    monitor.reset(2)
    np.testing.assert_array_equal(monitor.blocking(*NOW), [True, False])
    monitor.reset(2)
    signal[:] = False
    assert not monitor.blocking(*NOW).any()


@pytest.mark.parametrize("rule", [EVERY, AND])
def test_without_blocking_the_expert_drives_while_it_is_unsafe(rule):
    assert driven(["..XXX..X."], rule, block=0.0) == ["..XXX..X."]


def test_a_rule_goes_by_its_name():
    assert HandBack("safe_and_blocked") is AND
    with pytest.raises(ValueError, match="sometimes"):
        SafetyMonitor(Bounds(CONFIG), 2.0, "sometimes")  # pyright: ignore[reportArgumentType]


def test_monitor_looks_at_the_state():
    monitor = SafetyMonitor(Bounds(CONFIG), 0.003, AND)
    monitor.reset(2)
    good, bad = turned(), turned(roll=26)
    drives = [
        monitor.blocking(state_of(np.array([good, q])), *NOW[1:])
        for q in (good, bad, good, good, good)
    ]
    np.testing.assert_array_equal(np.array(drives).T, [[0, 0, 0, 0, 0], [0, 1, 1, 1, 0]])


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
    clearance[120], clearance[99] = 0.0, 0.01  # high, but in contact
    assert touchdowns(clearance, contact).tolist() == []


T = 3000


def gait(stride=500, stance=300, until=(T, T, T, T), high=0.03):
    """Heights of the foot centres and contacts of a trot whose feet stop at the given ticks."""
    t = np.arange(T)
    height, contact = np.zeros((1, T, 4)), np.zeros((1, T, 4), bool)
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


def test_feet_that_shuffle_below_five_millimetres_do_not_step():
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
    height[:, :1400], contact[:, :1400] = RADIUS, True
    assert stepping(height, contact, RADIUS).tolist() == [True]
    assert strictly_stepping(height, contact, RADIUS, 500).tolist() == [False]


def test_strict_allows_a_third_of_the_episode_without_a_foot():
    def one_foot_rests(until):
        height, contact = gait()
        height[:, 1000:until, 3], contact[:, 1000:until, 3] = RADIUS, True
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
    height, contact = np.full((1, T, 4), 0.5), np.zeros((1, T, 4), bool)
    assert stepping(height, contact, RADIUS).tolist() == [False]
    assert strictly_stepping(height, contact, RADIUS, 500).tolist() == [False]


def test_any_of_several_gates_takes_over_and_all_are_asked_always():
    one, other = (np.array([[mark == "X" for mark in row]]) for row in ("X..X.", ".X.X."))
    gate = AnyOf([Signal(one), Signal(other)])
    gate.reset(1)
    assert [bool(gate.unsafe(*NOW)[0]) for _ in range(5)] == [True, True, False, True, False]


def test_relaxing_bounds_start_tight_and_end_as_in_the_table():
    level, tilted = state_of(turned()), state_of(turned(roll=20))
    tight = tightened(CONFIG, 0.6)
    assert tight.roll_pitch == pytest.approx(15.0)
    assert tight.com_height == pytest.approx((0.17, 1.0))
    assert unsafe(tilted, tight)[0]
    assert not unsafe(tilted, CONFIG)[0]
    assert not unsafe(level, tight)[0]
    assert tightened(CONFIG, 1.0) == CONFIG


def test_margin_is_the_distance_to_the_nearest_bound():
    angle, height = np.radians(5.0), 0.01
    states = state_of(np.array([turned(roll=x) for x in (24, 26, 0)]))
    margins = margin(states, CONFIG, angle, height)
    np.testing.assert_allclose(margins[:2], [1 / 5, -1 / 5], atol=1e-9)
    outside = unsafe(states, CONFIG)
    np.testing.assert_array_equal(margins < 0, outside)
