"""The plans' contract: the toy's plan keeps it, and every kind of broken plan is caught."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.testing import PlanContract
from surefoot.types import MotionPlan
from tests.fakes import toy
from tests.fakes.robots import ROBOT


class TestToyPlan(PlanContract):
    def make_plan(self):
        return toy.plan

    def make_robot(self):
        return ROBOT


def counting():
    """Each plan differs a little from the one before."""
    calls = []

    def plan(state, tick, command):
        calls.append(tick)
        made = toy.plan(state, tick, command)
        return replace(made, torque=made.torque + 1e-15 * len(calls))

    return plan


def starting_warm():
    """A trace of the last state is in every plan."""
    last = np.zeros(12)

    def plan(state, tick, command):
        made = toy.plan(state, tick, command)
        trace = np.nan_to_num(last)
        last[:] = 1e-12 * state.q[7:]
        return replace(made, torque=made.torque + trace)

    return plan


def poisoned_by_bad_numbers():
    """After a state that is no number, all plans are off."""
    poison = np.zeros(1)

    def plan(state, tick, command):
        poison[:] += 0.0 * state.q[0]
        made = toy.plan(state, tick, command)
        return replace(made, torque=made.torque + poison)

    return plan


def of_its_own_kind():
    """No two planners agree."""
    offset = 1e-12 * np.random.default_rng().random()

    def plan(state, tick, command):
        made = toy.plan(state, tick, command)
        return replace(made, torque=made.torque + offset)

    return plan


def with_other_noise_each_time():
    offset = 1e-3 * np.random.default_rng().random()
    return lambda *arguments: replace(toy.plan(*arguments), torque=np.full((100, 12), offset))


def drifting():
    """What it plans grows with every plan."""
    calls = []

    def plan(state, tick, command):
        calls.append(tick)
        return replace(toy.plan(state, tick, command), torque=np.full((100, 12), len(calls)))

    return plan


def normalizing_in_place():
    def plan(state, tick, command):
        state.q[3:7] /= 2 * np.linalg.norm(state.q[3:7])
        return toy.plan(state, tick, command)

    return plan


def reusing_its_arrays():
    position = np.zeros((100, 12))

    def plan(state, tick, command):
        made = toy.plan(state, tick, command)
        position[:] = made.joint_position
        return replace(made, joint_position=position)

    return plan


def blind():
    def plan(state, tick, command):
        standing = State(ROBOT.nominal, np.zeros(18))
        return toy.plan(standing, tick, command)

    class State:
        def __init__(self, q, v):
            self.q = q
            self.v = v

    return plan


def deaf():
    def plan(state, tick, command):
        return toy.plan(state, tick, (0.0, 0.0, 0.0))

    return plan


def sure_of_everything():
    def plan(state, tick, command):
        if np.isfinite(state.q).all():
            return toy.plan(state, tick, command)
        nothing = np.zeros((100, 12))
        return MotionPlan(nothing, nothing, nothing)

    return plan


def transposed():
    def plan(state, tick, command):
        made = toy.plan(state, tick, command)
        return MotionPlan(made.joint_position.T, made.joint_velocity.T, made.torque.T)

    return plan


def never_valid():
    return lambda *arguments: replace(toy.plan(*arguments), valid=False)


def not_finite():
    def plan(*arguments):
        made = toy.plan(*arguments)
        made.torque[-1, 3] = np.inf
        return made

    return plan


FAULTS = [
    (counting, "test_same_input_same_bits"),
    (of_its_own_kind, "test_same_input_same_bits"),
    (starting_warm, "test_same_bits_whatever_was_planned_before"),
    (poisoned_by_bad_numbers, "test_same_bits_whatever_was_planned_before"),
    (with_other_noise_each_time, "test_a_resumed_run_knows_the_plan_again"),
    (drifting, "test_a_resumed_run_knows_the_plan_again"),
    (normalizing_in_place, "test_arguments_are_not_changed"),
    (reusing_its_arrays, "test_later_plans_do_not_change_earlier_ones"),
    (blind, "test_state_and_command_matter"),
    (deaf, "test_state_and_command_matter"),
    (sure_of_everything, "test_a_state_of_nan_has_no_valid_plan"),
    (transposed, "test_plans_have_their_shapes_and_numbers"),
    (never_valid, "test_plans_have_their_shapes_and_numbers"),
    (not_finite, "test_plans_have_their_shapes_and_numbers"),
]


@pytest.mark.parametrize(("fault", "name"), FAULTS)
def test_a_broken_plan_is_caught(fault, name):
    contract = TestToyPlan()
    contract.make_plan = fault
    with pytest.raises((AssertionError, ValueError)):
        getattr(contract, name)()


def test_every_test_of_the_contract_catches_a_fault():
    names = {name for name in dir(PlanContract) if name.startswith("test_")}
    assert names == {name for _, name in FAULTS}


def forgetful_in_the_second_gait():
    calls = []

    def plan(state, tick, command):
        calls.append(tick)
        made = toy.plan(state, tick, command)
        return replace(made, torque=made.torque + 1e-15 * len(calls) * command.gait)

    return plan


def test_a_plan_that_is_broken_in_another_gait_is_caught_where_it_walks_it():
    contract = TestToyPlan()
    contract.make_plan = forgetful_in_the_second_gait
    contract.test_same_input_same_bits()
    contract.gaits = 2
    with pytest.raises(AssertionError):
        contract.test_same_input_same_bits()
