"""The paper's table of bounds, its margins, how it is tightened, and gates together."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import TABLE_I
from surefoot.robots.bounds import fallen
from surefoot.safety.gates import AnyOf, Bounds, margin, outside, tightened, unsafe
from surefoot.types import JOINTS
from tests.fakes.gates import NOT_FLAGS, Careless, ScriptedGate
from tests.fakes.robots import STANDING
from tests.fakes.states import state_of, turned_robot

CONFIG = TABLE_I
CLOCK = np.zeros(1, int)
COMMAND = np.zeros((1, 3))


def with_joint(name, degrees):
    q = STANDING.copy()
    q[7 + JOINTS.index(name)] = np.radians(degrees)
    return q


# --- the paper's table


def bounds_of_the_table():
    for leg in ("FL", "FR", "HL", "HR"):
        front = leg[0] == "F"
        left = leg[1] == "L"
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
        q = np.array([turned_robot(**{axis: x}, yaw=yaw) for x in (-25.1, -24.9, 24.9, 25.1)])
        np.testing.assert_array_equal(unsafe(state_of(q), CONFIG), [True, False, False, True])


def test_height_of_the_center_of_mass_on_both_sides():
    q = np.tile(STANDING, (4, 1))
    heights = np.array([0.149, 0.151, 0.999, 1.001])
    np.testing.assert_array_equal(unsafe(state_of(q, heights), CONFIG), [True, False, False, True])


def test_the_table_tests_the_height_of_the_center_of_mass_and_a_fall_that_of_the_base():
    low_com = state_of(turned_robot(), 0.1)
    low_base = state_of(turned_robot(z=0.05), 0.2)
    assert unsafe(low_com, CONFIG)[0]
    assert not fallen(low_com.q, CONFIG)[0]
    assert not unsafe(low_base, CONFIG)[0]
    assert fallen(low_base.q, CONFIG)[0]


def test_bounds_come_from_the_config():
    tight = replace(CONFIG, knee=(-90.0, 0.0))
    assert not unsafe(state_of(STANDING), CONFIG)[0]
    assert unsafe(state_of(STANDING), tight)[0]


def test_a_state_that_is_not_a_number_is_unsafe():
    q = np.tile(STANDING, (3, 1))
    q[1, 9] = np.nan
    q[2, 3] = np.nan
    np.testing.assert_array_equal(unsafe(state_of(q), CONFIG), [False, True, True])
    np.testing.assert_array_equal(fallen(q, CONFIG), [False, False, True])


def test_outside_tells_which_number_leaves_its_bounds():
    q = np.array([turned_robot(), turned_robot(), turned_robot(roll=70), turned_robot(pitch=-70)])
    q = np.concatenate([q, q[:1], q[:1], q[:1]])
    q[:, 7] = 0.0
    height = np.zeros(7)
    height[1] = 1.1
    height[4] = np.nan
    q[5, 7] = -1.1
    q[6, 7] = np.nan
    low = np.full(4, -1.0)
    high = np.full(4, 1.0)
    result = outside(height, q, low, high)
    np.testing.assert_array_equal(result, [False, True, True, True, True, True, True])
    q[0, 7] = 1.0
    assert not outside(np.ones(1), q[:1], low, high)[0]  # on the bound


def test_outside_judges_as_the_angles_of_the_state_do():
    rng = np.random.default_rng(0)
    q = np.tile(STANDING, (20_000, 1))
    q[:, 3:7] = rng.normal(size=(20_000, 4))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    q[0, 3:7] = np.sqrt(0.5) * np.array([0.0, 1.0, 0.0, 1.0])  # straight up
    state = state_of(q)
    for bound in (0.3, 1.0, 1.5):
        limit = np.full(3, bound)
        expected = (np.abs(state.roll_pitch) > bound).any(axis=1)
        np.testing.assert_array_equal(outside(np.zeros(20_000), q, -limit, limit), expected)


def test_margin_is_the_distance_to_the_nearest_bound_in_its_unit():
    angle = np.radians(5.0)
    height = 0.01
    tilted = state_of(np.array([turned_robot(roll=x) for x in (24, 26, 0)]))
    margins = margin(tilted, CONFIG, angle, height)
    np.testing.assert_allclose(margins[:2], [1 / 5, -1 / 5], atol=1e-9)
    np.testing.assert_array_equal(margins < 0, unsafe(tilted, CONFIG))
    lowered = state_of(np.tile(STANDING, (2, 1)), np.array([0.152, 0.145]))
    np.testing.assert_allclose(margin(lowered, CONFIG, angle, height), [0.2, -0.5], atol=1e-9)


# --- gates


def test_the_gate_of_bounds_applies_the_table():
    states = state_of(np.array([turned_robot(), turned_robot(roll=26)]))
    gate = Bounds(CONFIG)
    gate.reset(2)
    np.testing.assert_array_equal(gate.unsafe(states, CLOCK, COMMAND), [False, True])


def test_any_of_several_gates_makes_a_state_unsafe_and_all_are_asked_every_tick():
    first = np.array([[mark == "X" for mark in "X..X."]])
    second = np.array([[mark == "X" for mark in ".X.X."]])
    gate = AnyOf([ScriptedGate(first), ScriptedGate(second)])
    gate.reset(1)
    answers = [bool(gate.unsafe(state_of(STANDING), CLOCK, COMMAND)[0]) for _ in range(5)]
    assert answers == [True, True, False, True, False]


@pytest.mark.parametrize("mistake", NOT_FLAGS)
def test_each_of_several_gates_has_to_answer_with_flags(mistake):
    signal = np.array([[False], [True], [False]])
    gate = AnyOf([ScriptedGate(signal), Careless(signal, mistake)])
    gate.reset(3)
    state = state_of(np.tile(STANDING, (3, 1)))
    with pytest.raises(ValueError, match=r"Careless answered with .*: give a NumPy array .3,."):
        gate.unsafe(state, np.zeros(3, int), np.zeros((3, 3)))


def test_no_gates_are_refused():
    with pytest.raises(ValueError, match="no gates; give at least one"):
        AnyOf([])


def test_gates_may_come_from_a_generator_and_are_kept():
    signals = [np.array([[False] * 3]), np.array([[True] * 3])]
    gate = AnyOf(ScriptedGate(signal) for signal in signals)
    for _ in range(2):
        gate.reset(1)
        assert gate.unsafe(state_of(STANDING), CLOCK, COMMAND).tolist() == [True]
    with pytest.raises(ValueError, match="no gates"):
        AnyOf(each for each in ())


def test_relaxing_bounds_start_tight_and_end_as_in_the_table():
    level = state_of(turned_robot())
    tilted = state_of(turned_robot(roll=20))
    tight = tightened(CONFIG, 0.6, height=0.2)
    assert tight.roll_pitch == pytest.approx(15.0)
    assert tight.com_height == pytest.approx((0.17, 1.0))
    assert unsafe(tilted, tight)[0]
    assert not unsafe(tilted, CONFIG)[0]
    assert not unsafe(level, tight)[0]
    assert tightened(CONFIG, 1.0, height=0.2) == CONFIG


def test_relaxing_bounds_are_never_tighter_than_the_settled_gait_needs():
    known = replace(CONFIG, settled=(0.16, 22.0))
    tight = tightened(known, 0.6, height=0.2)
    assert (tight.com_height, tight.roll_pitch) == ((0.16, 1.0), 22.0)
    assert tightened(replace(CONFIG, settled=(0.18, 4.0)), 0.6, height=0.2) == replace(
        tightened(CONFIG, 0.6, height=0.2), settled=(0.18, 4.0)
    )
    assert tightened(known, 1.0, height=0.2) == known
    given = replace(CONFIG, settled=(0.12, 27.0))  # bounds that were given, within what is needed
    for share in (0.6, 1.0):
        assert tightened(given, share, height=0.2) == given


def test_the_lower_bound_is_tightened_towards_the_height_of_the_gait():
    assert tightened(CONFIG, 0.5, height=0.35).com_height == pytest.approx((0.25, 1.0))
