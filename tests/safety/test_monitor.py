"""The three hand-back rules, tick by tick."""

from typing import get_args

import numpy as np
import pytest

from surefoot.config import TABLE_I, HandBack
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from tests.fakes.gates import NOT_FLAGS, Careless, ScriptedGate
from tests.fakes.robots import STANDING
from tests.fakes.states import state_of, turned_robot

CONFIG = TABLE_I
EVERY: HandBack = "every_violation_restarts"
OR: HandBack = "safe_or_blocked"
AND: HandBack = "safe_and_blocked"


def ask(monitor, tick, robots=1, state=None):
    """What the monitor says at a tick of robots that stand still."""
    now = state_of(STANDING) if state is None else state
    return monitor.blocking(now, np.full(robots, tick), np.zeros((robots, 3)))


def driven(violations, hand_back, block=0.005):
    """Who drives on a scripted signal; X: violation or expert, dot: safe or policy."""
    signal = np.array([[mark == "X" for mark in row] for row in violations])
    monitor = SafetyMonitor(ScriptedGate(signal), block, hand_back)
    monitor.reset(len(signal))
    ticks = [ask(monitor, tick, len(signal)) for tick in range(signal.shape[1])]
    return ["".join(".X"[int(x)] for x in row) for row in np.array(ticks).T]


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


@pytest.mark.parametrize("rule", get_args(HandBack))
def test_robots_of_a_batch_are_blocked_on_their_own(rule):
    rows = ["..X.....X....", ".............", "XXXXXXXXX....", "..X..X......."]
    together = driven(rows, rule)
    assert together == [driven([row], rule)[0] for row in rows]
    assert len(set(together)) == 4


@pytest.mark.parametrize("rule", get_args(HandBack))
def test_reset_forgets_every_block(rule):
    signal = np.array([[True, False], [False, False]])
    monitor = SafetyMonitor(ScriptedGate(signal), 0.005, rule)
    monitor.reset(2)
    np.testing.assert_array_equal(ask(monitor, 0, 2), [True, False])
    monitor.reset(2)
    signal[:] = False
    assert not ask(monitor, 0, 2).any()


@pytest.mark.parametrize("rule", [EVERY, AND])
def test_ticks_that_nobody_saw_are_part_of_a_block(rule):
    signal = np.array([[False, True, False, False, False, False]])
    monitor = SafetyMonitor(ScriptedGate(signal), 0.005, rule)
    monitor.reset(1)
    drives = [bool(ask(monitor, tick)[0]) for tick in (10, 11, 12, 15, 16, 17)]
    assert drives == [False, True, True, True, False, False]


@pytest.mark.parametrize("rule", get_args(HandBack))
def test_without_blocking_the_expert_drives_while_it_is_unsafe(rule):
    assert driven(["..XXX..X."], rule, block=0.0) == ["..XXX..X."]


def test_an_unknown_rule_is_an_error_that_names_the_known_ones():
    with pytest.raises(ValueError, match=r"no hand-back rule 'sometimes'.* safe_or_blocked"):
        SafetyMonitor(Bounds(CONFIG), 2.0, "sometimes")  # pyright: ignore[reportArgumentType]


def test_the_monitor_asks_its_gate_about_the_state():
    monitor = SafetyMonitor(Bounds(CONFIG), 0.003, AND)
    monitor.reset(2)
    good = turned_robot()
    bad = turned_robot(roll=26)
    poses = (good, bad, good, good, good)
    drives = [ask(monitor, tick, 2, state_of(np.array([good, q]))) for tick, q in enumerate(poses)]
    np.testing.assert_array_equal(np.array(drives).T, [[0, 0, 0, 0, 0], [0, 1, 1, 1, 0]])


@pytest.mark.parametrize("block", [-1.0, -1e-9, np.nan, np.inf])
def test_a_time_that_no_block_can_last_is_refused(block):
    with pytest.raises(ValueError, match=r"block is .* s; use 0 or more"):
        SafetyMonitor(Bounds(CONFIG), block)


@pytest.mark.parametrize("mistake", NOT_FLAGS)
def test_answers_of_a_gate_that_are_no_flags_are_refused(mistake):
    gate = Careless(np.array([[False], [True], [False]]), mistake)
    monitor = SafetyMonitor(gate, 0.005)
    monitor.reset(3)
    with pytest.raises(ValueError, match=r"Careless answered with .*: give a NumPy array .3,."):
        ask(monitor, 0, 3)
