"""The expert's timetable, torque law and fall-back, with plans that are plain functions."""

from typing import Any

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.mpc.expert import DAMPING, Expert, make_expert
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import own_values
from surefoot.types import Command, MotionPlan, State

KP = 3.0
KD = 0.05


class Recorder:
    """A toy MPC: notes which robot asked when, and answers with rows that name their tick."""

    def __init__(self, ticks: int = 100) -> None:
        self.calls = []
        self.ticks = ticks
        self.invalid = set()

    def __call__(self, state: State, tick: int, command: Command) -> MotionPlan:
        self.calls.append((int(state.q[0]), tick, command))
        row = (tick + np.arange(self.ticks))[:, None] + 0.01 * np.arange(12)
        plan = 1e-3 * row + state.q[0]
        return MotionPlan(plan, -2.0 * plan, 0.5 * plan, len(self.calls) not in self.invalid)

    @staticmethod
    def torque(state: State, robot: int, row_tick: int) -> np.ndarray:
        plan = 1e-3 * (row_tick + 0.01 * np.arange(12)) + state.q[robot, 0]
        q = state.q[robot, 7:]
        v = state.v[robot, 6:]
        return 0.5 * plan + KP * (plan - q) + KD * (-2.0 * plan - v)


def states(batch: int, seed: int = 0) -> State:
    """Random states; the first coordinate is the robot's number."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(batch, 19))
    v = rng.normal(size=(batch, 18))
    q[:, 0] = np.arange(batch)
    return State(q, v, q[:, :3], np.zeros((batch, 4, 3)), np.ones((batch, 4), bool))


def drive(expert, state, tick, mask=None, command=None):
    batch = len(state.q)
    tick = np.broadcast_to(tick, batch).astype(np.int64)
    mask = np.ones(batch, bool) if mask is None else np.asarray(mask)
    command = np.zeros((batch, 3)) if command is None else command
    return expert.torque(state, tick, command, mask)


def make(batch: int = 1, ticks: int = 100):
    plan = Recorder(ticks)
    expert = Expert(plan, KP, KD)
    expert.reset(batch)
    return expert, plan


def asked_at(plan: Recorder, robot: int = 0) -> list[int]:
    return [tick for caller, tick, _ in plan.calls if caller == robot]


def test_plans_at_the_takeover_and_on_the_grid_only():
    expert, plan = make()
    for tick in range(37, 260):
        drive(expert, states(1), tick)
    assert asked_at(plan) == [37, 50, 100, 150, 200, 250]
    np.testing.assert_array_equal(expert.plans, [6])
    np.testing.assert_array_equal(expert.invalid_plans, [0])


def test_a_takeover_on_the_grid_plans_once():
    expert, plan = make()
    for tick in range(50, 101):
        drive(expert, states(1), tick)
    assert asked_at(plan) == [50, 100]


def test_torque_law_row_by_row():
    expert, _ = make()
    for tick in range(37, 130):
        state = states(1, seed=tick)
        torque = drive(expert, state, tick)
        np.testing.assert_allclose(torque[0], Recorder.torque(state, 0, tick), atol=1e-12)


def test_command_reaches_the_planner():
    expert, plan = make(2)
    drive(expert, states(2), 0, command=np.array([[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]))
    assert [call[2] for call in plan.calls] == [Command(0.1, 0.2, 0.3), Command(0.4, 0.5, 0.6)]


def test_robots_of_a_batch_keep_their_own_clock_and_plan():
    expert, plan = make(3)
    start = np.array([0, 20, 433])
    for step in range(120):
        state = states(3, seed=step)
        mask = np.array([True, step >= 10, step < 60])
        torque = drive(expert, state, start + step, mask)
        for robot in np.flatnonzero(mask).tolist():
            expected = Recorder.torque(state, robot, start[robot] + step)
            np.testing.assert_allclose(torque[robot], expected, atol=1e-12)
    assert asked_at(plan, 0) == [0, 50, 100]
    assert asked_at(plan, 1) == [30, 50, 100]
    assert asked_at(plan, 2) == [433, 450]
    np.testing.assert_array_equal(expert.plans, [3, 3, 2])


def test_a_batch_gives_what_each_robot_gets_alone():
    together, _ = make(4)
    alone = [make(1)[0] for _ in range(4)]
    start = np.array([0, 13, 49, 77])
    for step in range(60):
        state = states(4, seed=step)
        torque = drive(together, state, start + step)
        for robot, expert in enumerate(alone):
            one = drive(expert, state[robot : robot + 1], start[robot] + step)
            np.testing.assert_array_equal(one[0], torque[robot])


def test_after_an_invalid_replan_the_robot_follows_the_old_plan():
    expert, plan = make()
    plan.invalid = {2}  # the one at tick 50
    for tick in range(151):
        state = states(1, seed=tick)
        torque = drive(expert, state, tick)
        np.testing.assert_allclose(torque[0], Recorder.torque(state, 0, tick), atol=1e-12)
        assert not expert.diverged[0]
    assert asked_at(plan) == [0, 50, 100, 150]
    np.testing.assert_array_equal(expert.invalid_plans, [1])


def test_two_failures_with_a_success_between_are_survived():
    expert, plan = make()
    plan.invalid = {2, 4}
    for tick in range(300):
        drive(expert, states(1), tick)
    assert not expert.diverged[0]
    np.testing.assert_array_equal(expert.invalid_plans, [2])


def test_two_invalid_replans_in_a_row_give_up():
    expert, plan = make()
    plan.invalid = {2, 3}
    for tick in range(100):
        drive(expert, states(1), tick)
        assert not expert.diverged[0]
    for tick in range(100, 260):
        state = states(1, seed=tick)
        torque = drive(expert, state, tick)
        assert expert.diverged[0]
        np.testing.assert_array_equal(torque, -DAMPING * state.v[:, 6:])
    assert asked_at(plan) == [0, 50, 100]  # no further plan is asked for
    np.testing.assert_array_equal(expert.invalid_plans, [2])


def test_an_invalid_takeover_gives_up_on_that_robot_only():
    expert, plan = make(3)
    plan.invalid = {2}
    for tick in range(10, 70):
        state = states(3, seed=tick)
        torque = drive(expert, state, tick)
        np.testing.assert_array_equal(expert.diverged, [False, True, False])
        np.testing.assert_array_equal(torque[1], -DAMPING * state.v[1, 6:])
        for robot in (0, 2):
            expected = Recorder.torque(state, robot, tick)
            np.testing.assert_allclose(torque[robot], expected, atol=1e-12)
    np.testing.assert_array_equal(expert.plans, [2, 1, 2])
    np.testing.assert_array_equal(expert.invalid_plans, [0, 1, 0])


@pytest.mark.parametrize("field", ["joint_position", "joint_velocity", "torque"])
def test_numbers_that_are_not_finite_make_a_plan_invalid(field):
    def plan(state, tick, command):
        arrays = {name: np.zeros((100, 12)) for name in MotionPlan.__annotations__}
        arrays[field][99, 3] = np.nan
        return MotionPlan(**{**arrays, "valid": True})

    expert = Expert(plan, KP, KD)
    expert.reset(1)
    torque = drive(expert, states(1), 0)
    assert expert.diverged[0]
    assert np.isfinite(torque).all()


def test_handing_over_and_back_is_a_takeover_with_a_fresh_plan():
    expert, plan = make()
    mask = {**dict.fromkeys(range(20), True), **dict.fromkeys(range(30, 60), True)}
    for tick in range(60):
        state = states(1, seed=tick)
        torque = drive(expert, state, tick, [mask.get(tick, False)])
        if mask.get(tick):
            np.testing.assert_allclose(torque[0], Recorder.torque(state, 0, tick), atol=1e-12)
    assert asked_at(plan) == [0, 30, 50]


def test_a_failure_before_the_handover_is_forgotten_by_a_valid_takeover():
    expert, plan = make()
    plan.invalid = {2, 4}  # at 50, and at 150 after the takeover at 120
    for tick in range(160):
        drive(expert, states(1), tick, [tick < 80 or tick >= 120])
    assert asked_at(plan) == [0, 50, 120, 150]
    assert not expert.diverged[0]


def test_reset_forgets():
    expert, plan = make(2)
    plan.invalid = {1}
    drive(expert, states(2), 7)
    assert expert.diverged.any()
    expert.reset(3)
    assert not expert.diverged.any()
    np.testing.assert_array_equal(expert.plans, np.zeros(3))
    np.testing.assert_array_equal(expert.invalid_plans, np.zeros(3))
    drive(expert, states(3), 8)  # one tick later, but a takeover: the expert did not drive before
    np.testing.assert_array_equal(expert.plans, np.ones(3))


def test_forgetting_some_robots_leaves_the_others_their_plans():
    expert, plan = make(2)
    plan.invalid = {1}
    drive(expert, states(2), 10)
    np.testing.assert_array_equal(expert.diverged, [True, False])
    expert.forget(np.array([True, False]))
    # The clock of the new episode goes on where the old one was, by chance.
    torque = drive(expert, states(2), 11)
    np.testing.assert_array_equal(expert.diverged, [False, False])
    assert asked_at(plan, 0) == [10, 11]
    assert asked_at(plan, 1) == [10]
    np.testing.assert_allclose(torque[0], plan.torque(states(2), 0, 11))
    np.testing.assert_allclose(torque[1], plan.torque(states(2), 1, 11))


@pytest.mark.parametrize("ticks", [1, 30, 99, 100, 150])
def test_plans_of_any_length(ticks):
    """A user's plan may be shorter (its last row is held) or longer (the rest is not used)."""
    expert, plan = make(ticks=ticks)
    plan.invalid = {2}
    for tick in range(100):
        state = states(1, seed=tick)
        torque = drive(expert, state, tick)
        expected = Recorder.torque(state, 0, min(tick, ticks - 1))
        np.testing.assert_allclose(torque[0], expected, atol=1e-12)


def test_plans_of_different_lengths_in_one_batch():
    lengths = iter([100, 40, 160])

    def plan(state, tick, command):
        return Recorder(next(lengths))(state, tick, command)

    expert = Expert(plan, KP, KD)
    expert.reset(3)
    for tick in range(49):
        state = states(3, seed=tick)
        torque = drive(expert, state, tick)
        for robot, last in enumerate((99, 39, 159)):
            expected = Recorder.torque(state, robot, min(tick, last))
            np.testing.assert_allclose(torque[robot], expected, atol=1e-12)


def test_wrong_shapes_are_named():
    wide = np.zeros((100, 18))
    expert = Expert(lambda *_: MotionPlan(wide, wide, wide), KP, KD)
    expert.reset(1)
    with pytest.raises(ValueError, match=r"\(100, 18\).*expected \(ticks, 12\)"):
        drive(expert, states(1), 0)
    with pytest.raises(ValueError, match="2 robots, but reset was told 1"):
        drive(expert, states(2), 0)


def test_a_users_own_mpc_is_a_plain_function():
    def stand(state: State, tick: int, command: Command) -> MotionPlan:
        ramp = np.linspace(0, 1, 100)[:, None]
        position = state.q[7:] * (1 - ramp)
        return MotionPlan(position, np.tile(-10.0 * state.q[7:], (100, 1)), np.zeros((100, 12)))

    expert = Expert(stand, kp=5.0, kd=0.2)
    state = states(2)
    expert.reset(2)
    torque = drive(expert, state, 3)
    np.testing.assert_allclose(torque, 0.2 * (-10.0 * state.q[:, 7:] - state.v[:, 6:]))


def test_later_changes_to_a_users_arrays_do_not_reach_the_expert():
    position, rate, torque = (np.ones((100, 12)) for _ in range(3))
    expert = Expert(lambda *_: MotionPlan(position, rate, torque), KP, KD)
    expert.reset(1)
    state = states(1)
    before = drive(expert, state, 0)
    torque[:] = 1e6
    np.testing.assert_array_equal(drive(expert, state, 1), before)


# --- plans that are not there yet


def shuffle(state: State) -> None:
    state.q[7:] = state.q[7:][::-1]


def slow_down(state: State) -> None:
    state.v *= 0.5


def forget_contacts(state: State) -> None:
    state.contacts[:] = False


@pytest.mark.parametrize("change", [shuffle, slow_down, forget_contacts])
def test_a_plan_that_changes_its_state_is_told_to_copy(change):
    hold = np.zeros((100, 12))

    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        change(state)
        return MotionPlan(hold, hold, hold)

    expert = Expert(plan, KP, KD)
    expert.reset(2)
    state = states(2)
    before = state.q.copy()
    with pytest.raises(ValueError, match=r"plan function changed.*read-only.*q = state\.q\.copy"):
        drive(expert, state, 0)
    np.testing.assert_array_equal(state.q, before)
    state.q[0, 0] = 7.0  # the engine's own arrays stay writable


def test_a_plan_that_makes_its_state_writable_on_purpose_changes_a_copy():
    hold = np.zeros((100, 12))

    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        state.q.flags.writeable = True
        state.q[...] = 7.0
        return MotionPlan(hold, hold, hold)

    expert = Expert(plan, KP, KD)
    expert.reset(2)
    state = states(2)
    before = state.q.copy()
    drive(expert, state, 0)
    np.testing.assert_array_equal(state.q, before)


@pytest.mark.parametrize(("kp", "kd", "name"), [(np.nan, 0.1, "kp"), (3.0, -1.0, "kd")])
def test_gains_out_of_range_are_refused(kp, kd, name):
    with pytest.raises(ValueError, match=rf"expert\.{name} is .*; use 0.0 to"):
        Expert(Recorder(), kp, kd)


def test_a_plan_may_change_a_copy_and_its_own_errors_stay():
    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        q = state.q.copy()
        q[7:] = 0.0
        if tick:
            raise ValueError("no solution")
        rows = np.tile(q[7:], (100, 1))
        return MotionPlan(rows, rows, rows)

    expert = Expert(plan, KP, KD)
    expert.reset(1)
    drive(expert, states(1), 0)
    with pytest.raises(ValueError, match=r"^no solution$"):
        drive(expert, states(1), 50)


ROWS = np.zeros((100, 12))


@pytest.mark.parametrize("answer", [None, (ROWS, ROWS, ROWS), 1.0, ROWS, {"torque": ROWS}])
def test_an_answer_that_is_no_plan_is_named(answer):
    expert = Expert(lambda *_: answer, KP, KD)  # type: ignore[arg-type, return-value]
    expert.reset(1)
    kind = type(answer).__name__
    with pytest.raises(TypeError, match=rf"plan function returned {kind}, expected a surefoot.Mot"):
        drive(expert, states(1), 0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (1.0, r"plan's arrays are \[\(\), .*expected \(ticks, 12\) each"),
        (np.zeros(12), r"plan's arrays are \[\(12,\), .*expected \(ticks, 12\)"),
        (ROWS[:50], r"plan's arrays are \[\(50, 12\), \(100, 12\)"),
        (ROWS.T, r"plan's arrays are \[\(12, 100\), "),
        (ROWS[:0], "with at least one tick"),
        (None, r"plan's joint_position is object \(\), expected \(ticks, 12\) real numbers"),
        (ROWS + 1j, "plan's joint_position is complex128"),
        (ROWS.astype(str), "plan's joint_position is <U"),
        ([[0.0] * 12, [0.0]], "plan's joint_position is no array"),
    ],
)
def test_an_array_of_a_plan_that_fits_no_robot_is_named(wrong, message):
    expert = Expert(lambda *_: MotionPlan(wrong, ROWS, ROWS), KP, KD)
    expert.reset(1)
    with pytest.raises(ValueError, match=message):
        drive(expert, states(1), 0)


def test_a_plan_is_valid_or_not():
    expert = Expert(lambda *_: MotionPlan(ROWS, ROWS, ROWS, valid=None), KP, KD)  # type: ignore[arg-type]
    expert.reset(1)
    with pytest.raises(TypeError, match="plan's valid is None, expected True or False"):
        drive(expert, states(1), 0)


def test_plans_of_lists_and_of_single_precision_are_plans():
    kinds: list[Any] = [ROWS.tolist(), ROWS.astype(np.float32), ROWS.astype(int)]
    for rows in kinds:
        expert = Expert(lambda *_, rows=rows: MotionPlan(rows, rows, rows), KP, KD)
        expert.reset(1)
        assert np.isfinite(drive(expert, states(1), 0)).all()
        assert not expert.invalid_plans.any()


def test_a_larger_robot_without_a_plan_is_damped_by_its_own_gain():
    robot = load_robot("go2")
    nothing = MotionPlan(*np.zeros((3, 100, 12)), valid=False)
    expert = make_expert(robot, Config(), plan=lambda state, tick, command: nothing)
    expert.reset(1)
    state = states(1)
    torque = drive(expert, state, 0)
    assert expert.diverged[0]
    np.testing.assert_allclose(torque, -own_values(robot).policy_kd * state.v[:, 6:])
    assert own_values(robot).policy_kd > 5 * DAMPING
