"""What every plan function promises, so that `surefoot.mpc.expert.Expert` can drive robots with it.

A plan is a pure function of (state, tick, command): the same input gives the same bits, whatever
was planned before, because an episode must not depend on the worker that computes it.
Read `testing.gate` next.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from surefoot.mpc.expert import ask_for_plan, read_only
from surefoot.mpc.identity import difference, identity_of
from surefoot.robots.geometry import state_of
from surefoot.robots.model import RobotModel
from surefoot.testing.states import assert_same_states, copy_of, falling_moments
from surefoot.types import Command, GaitCommand, MotionPlan, PlanFunction, State


class PlanContract:
    """Tests that a plan function must pass; inherit it and make your plan function.

    Attributes:
        command: A command in the range that your planner is made for.
        ticks: Gait clocks to plan at [ms]; takeovers happen at any tick, so not all of these are on
            a grid.
        gaits: The number of gaits that your planner supports; `Command.gait` selects one.
    """

    command: Command = Command(0.2, 0.0, 0.1)
    ticks: tuple[int, ...] = (0, 50, 133, 249)
    gaits: int = 1

    @property
    def commands(self) -> list[Command]:
        """The command in each of the gaits."""
        others = [GaitCommand(*self.command, gait=gait) for gait in range(1, self.gaits)]
        return [self.command, *others]

    def make_plan(self) -> PlanFunction:
        """Return your plan function, newly made."""
        raise NotImplementedError("return plan(state, tick, command) -> MotionPlan")

    def make_robot(self) -> RobotModel:
        """Return the robot that your plan function plans for."""
        raise NotImplementedError("return the RobotModel that you plan for")

    def make_states(self) -> list[State]:
        """Return states, each of one robot, from which your plan function must find a plan.

        By default these are nearly standing robots.
        """
        robot = self.make_robot()
        state = falling_moments(robot, 6, 1)[0].state
        state.q[1::2, 3:7] = [0.0, 0.0, 0.0, 1.0]
        upright = state_of(robot, state.q, state.v)
        return [upright[row] for row in range(6)]

    def test_plans_have_their_shapes_and_numbers(self) -> None:
        """A plan is three arrays ``(ticks, 12)`` of finite numbers, and it is valid."""
        plan = self.make_plan()
        for state in self.make_states():
            for tick, command in product(self.ticks, self.commands):
                try:
                    arrays, valid = ask_for_plan(plan, copy_of(state), tick, command)
                except (TypeError, ValueError) as error:
                    raise AssertionError(f"no plan that an expert accepts: {error}") from error
                assert np.isfinite(arrays).all(), "a plan is not finite"
                assert valid, "a plan from a state that must have one is not valid"

    def test_same_input_same_bits(self) -> None:
        """A plan depends on its arguments alone, and not on the object that makes it."""
        plan = self.make_plan()
        another = self.make_plan()
        for state in self.make_states():
            for tick, command in product(self.ticks, self.commands):
                first = plan(state, tick, command)
                copies = [array.copy() for array in _arrays(first)]
                _assert_same_plans(plan(state, tick, command), copies)
                _assert_same_plans(another(state, tick, command), copies)

    def test_same_bits_whatever_was_planned_before(self) -> None:
        """Other states, other commands and states of NaN leave no trace."""
        plan = self.make_plan()
        states = self.make_states()
        expected = [
            [array.copy() for array in _arrays(self.make_plan()(state, 133, self.command))]
            for state in states
        ]
        with np.errstate(all="ignore"):
            plan(_lost_robot(), 17, self.command)
        for order in (range(len(states)), reversed(range(len(states)))):
            for row in order:
                plan(states[row - 1], 300, Command(-0.1, 0.1, -0.2))
                _assert_same_plans(plan(states[row], 133, self.command), expected[row])

    def test_a_resumed_run_knows_the_plan_again(self) -> None:
        """A run accepts only the MPC that it began with, which it recognizes by names and plans."""
        before = identity_of(self.make_plan(), self.make_robot(), self.gaits)
        now = identity_of(self.make_plan(), self.make_robot(), self.gaits)
        assert now.repeatable, "a plan that is asked again for the same state is another one"
        text = difference(before, now)
        assert not text, f"a run begun with {before.title}, {text}, could not be resumed"

    def test_state_and_command_matter(self) -> None:
        """Different states give different plans; so do different commands."""
        plan = self.make_plan()
        states = self.make_states()
        tick = self.ticks[0]
        first = plan(states[0], tick, self.command)
        stopped = plan(states[0], tick, Command(0.0, 0.0, 0.0))
        elsewhere = plan(states[1], tick, self.command)
        assert _differ(first, elsewhere), "two states have the same plan"
        assert _differ(first, stopped), "two commands have the same plan"

    def test_arguments_are_not_changed(self) -> None:
        """An expert passes read-only arrays; planning does not change a state."""
        plan = self.make_plan()
        for state in self.make_states():
            before = copy_of(state)
            try:
                plan(read_only(state), self.ticks[0], self.command)
            except ValueError as error:
                raise AssertionError(f"a read-only state has no plan: {error}") from error
            assert_same_states(state, before, "a plan has changed its state")

    def test_later_plans_do_not_change_earlier_ones(self) -> None:
        """The arrays of a plan belong to the caller."""
        plan = self.make_plan()
        states = self.make_states()
        first = plan(states[0], self.ticks[0], self.command)
        copies = [array.copy() for array in _arrays(first)]
        for state in states[1:]:
            plan(state, self.ticks[-1], self.command)
        _assert_same_plans(first, copies)

    def test_a_state_of_nan_has_no_valid_plan(self) -> None:
        """A state of NaN gives a plan that is not valid or not finite, and no exception."""
        plan = self.make_plan()
        with np.errstate(all="ignore"):
            motion = plan(_lost_robot(), self.ticks[0], self.command)
        finite = all(np.isfinite(array).all() for array in _arrays(motion))
        assert not (motion.valid and finite), "a state of NaN has a valid plan"


def _arrays(plan: MotionPlan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the three arrays of a plan."""
    return plan.joint_position, plan.joint_velocity, plan.torque


def _lost_robot() -> State:
    """Return the state of a robot that has blown up."""
    feet = np.full((4, 3), np.nan)
    return State(
        np.full(19, np.nan), np.full(18, np.nan), feet[0], feet, np.zeros(4, dtype=np.bool_)
    )


def _assert_same_plans(plan: MotionPlan, expected: list[np.ndarray]) -> None:
    """Assert that the arrays of a plan equal the expected ones bit for bit."""
    for array, other in zip(_arrays(plan), expected, strict=True):
        np.testing.assert_array_equal(array, other, "the same input gave another plan")


def _differ(plan: MotionPlan, other: MotionPlan) -> bool:
    """Return True if two plans differ in any array."""
    pairs = zip(_arrays(plan), _arrays(other), strict=True)
    return any(not np.array_equal(a, b) for a, b in pairs)
