"""The paper's table, and the three hand-back rules tick by tick."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import SafetyConfig
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.outcome import fallen
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
