"""The identity of an MPC: its names, its plans at fixed states, and in what two of them differ."""

from dataclasses import replace
from functools import cache, partial, wraps

import numpy as np
import pytest

from surefoot.config.json_io import from_json, to_json
from surefoot.mpc.identity import ExpertIdentity, difference, identity_of, plan_names
from surefoot.types import MotionPlan
from tests.fakes.plans import PLANNER
from tests.fakes.robots import ROBOT

ZEROS = np.zeros((100, 12))


def hold(state, tick, command, gain=1.0):
    """Stand, with a feed-forward torque."""
    return MotionPlan(np.tile(ROBOT.nominal[7:], (100, 1)), ZEROS, gain * np.ones((100, 12)))


def with_gain(gain):
    def plan(state, tick, command):
        return hold(state, tick, command, gain)

    return plan


def answering(answer):
    """A plan function, whose name is always the same."""
    return lambda state, tick, command: answer(state, tick, command)


class Standing:
    """A callable object, and an object with a method that plans."""

    def __init__(self, gain):
        self.gain = gain

    def __call__(self, state, tick, command):
        return hold(state, tick, command, self.gain)

    def plan(self, state, tick, command):
        return self(state, tick, command)


def decorated(function):
    @wraps(function)
    def inner(*args):
        return function(*args)

    return inner


HERE = __name__


@pytest.mark.parametrize(
    ("plan", "name"),
    [
        (hold, "hold"),
        (partial(hold, gain=2.0), "hold"),
        (partial(partial(hold), gain=2.0), "hold"),
        (with_gain(1.0), "with_gain.<locals>.plan"),
        (answering(hold), "answering.<locals>.<lambda>"),
        (Standing(1.0), "Standing"),
        (Standing(1.0).plan, "Standing.plan"),
        (partial(Standing(1.0).plan), "Standing.plan"),
        (decorated(hold), "hold"),
        (cache(hold), "hold"),
    ],
)
def test_any_callable_has_the_names_of_what_plans(plan, name):
    assert plan_names(plan) == (HERE, name)


def test_the_packages_planner_has_an_identity_too_and_it_is_repeatable():
    identity = identity_of(PLANNER.plan, ROBOT)
    assert identity.title == "surefoot.mpc.planner.Planner.plan"
    assert identity.repeatable
    assert [plan.valid for plan in identity.plans] == [True, True]
    assert np.shape(identity.plans[1].torque) == (100, 12)


@pytest.mark.parametrize(
    "make",
    [
        with_gain,
        Standing,
        lambda gain: Standing(gain).plan,
        lambda gain: partial(hold, gain=gain),
        lambda gain: answering(partial(hold, gain=gain)),
    ],
)
def test_two_of_one_name_are_told_apart_by_their_plans(make):
    before = identity_of(make(1.0), ROBOT)
    assert difference(before, identity_of(make(1.0), ROBOT)) == ""
    text = difference(before, identity_of(make(0.9), ROBOT))
    assert text == (
        "which has changed since: at fixed state 1 of 2 its torque is up to 0.1 N m apart "
        "(tolerance 1e-06)"
    )


def test_another_name_is_another_expert_even_with_the_same_plans():
    before = identity_of(with_gain(1.0), ROBOT)
    assert difference(before, identity_of(hold, ROBOT)) == f"not with {HERE}.hold"
    moved = replace(before, module="elsewhere")
    assert difference(before, moved) == "not with elsewhere.with_gain.<locals>.plan"


@pytest.mark.parametrize(("change", "same"), [(1e-9, True), (9e-7, True), (1.1e-6, False)])
def test_what_another_processor_may_change_is_accepted(change, same):
    before = identity_of(with_gain(1.0), ROBOT)
    assert (difference(before, identity_of(with_gain(1.0 + change), ROBOT)) == "") == same


def feedback(on_position, on_velocity, on_tick=0.0):
    def plan(state, tick, command):
        torque = on_position * state.q[3:15] + on_velocity * state.v[6:] + on_tick * tick
        return MotionPlan(ZEROS, ZEROS, np.tile(torque, (100, 1)))

    return plan


@pytest.mark.parametrize("changed", [feedback(1.1, 1), feedback(1, 1.1), feedback(1, 1, 1e-3)])
def test_a_changed_feedback_shows(changed):
    before = identity_of(feedback(1.0, 1.0), ROBOT)
    assert "its torque is up to" in difference(before, identity_of(changed, ROBOT))


def shorter(state, tick, command):
    return MotionPlan(ZEROS[:50], ZEROS[:50], ZEROS[:50])


def broken(state, tick, command):
    return MotionPlan(np.nan * ZEROS, ZEROS, ZEROS)


def invalid(state, tick, command):
    return replace(hold(state, tick, command), valid=False)


def raising(state, tick, command):
    raise KeyError("the solver is not there")


def nothing(state, tick, command):
    return None


def crooked(state, tick, command):
    return MotionPlan(ZEROS[:, :3], ZEROS, ZEROS)


def words(state, tick, command):
    return MotionPlan(["left", "right"], ZEROS, ZEROS)  # type: ignore


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (shorter, "its plan has 100 ticks; before, it had 50"),
        (broken, "its joint position is not finite where it was before, or the other way round"),
        (invalid, "its plan is valid; before, it was not valid"),
        (raising, "it gave a plan; before, it gave no plan (KeyError)"),
        (nothing, "it gave a plan; before, it gave no plan (TypeError)"),
        (crooked, "it gave a plan; before, it gave no plan (ValueError)"),
        (words, "it gave a plan; before, it gave no plan (ValueError)"),
    ],
)
def test_a_plan_that_is_mended_is_another_one(answer, text):
    before = identity_of(answering(answer), ROBOT)
    assert difference(before, identity_of(answering(answer), ROBOT)) == ""
    assert text in difference(before, identity_of(answering(hold), ROBOT))


def test_an_interrupt_that_a_plan_hides_is_no_plan_that_failed():
    def interrupted(state, tick, command):
        raise SystemError("a result with an exception set") from KeyboardInterrupt()

    with pytest.raises(SystemError):
        identity_of(answering(interrupted), ROBOT)


@pytest.mark.parametrize("plan", [hold, broken, raising])
def test_an_identity_survives_json(plan):
    identity = identity_of(plan, ROBOT)
    again = from_json(ExpertIdentity, to_json(identity))
    assert difference(identity, again) == difference(again, identity) == ""


def test_a_plan_that_is_not_repeatable_is_known_by_its_name():
    asked = []

    def plan(state, tick, command):
        asked.append(tick)
        return hold(state, tick, command, gain=len(asked))

    before = identity_of(plan, ROBOT)
    assert not before.repeatable
    assert difference(before, identity_of(plan, ROBOT)) == ""
    assert difference(before, identity_of(hold, ROBOT)) == f"not with {HERE}.hold"


def test_a_plan_that_changes_its_arguments_is_none_that_an_expert_accepts():
    def plan(state, tick, command):
        motion = MotionPlan(np.tile(state.q[7:], (100, 1)), ZEROS, ZEROS)
        state.q[...] = 7.0
        return motion

    identity = identity_of(plan, ROBOT)
    assert identity.repeatable
    assert [each.failure for each in identity.plans] == ["gave no plan (ValueError)"] * 2


def bounding(gain):
    """A plan function whose plans of the second gait alone have a gain."""

    def plan(state, tick, command):
        return hold(state, tick, command, gain if command.gait == 1 else 1.0)

    return plan


def test_a_change_in_another_gait_is_noticed_where_robots_walk_it():
    before = identity_of(bounding(1.0), ROBOT, gaits=3)
    assert len(before.plans) == 4
    assert difference(before, identity_of(bounding(1.0), ROBOT, gaits=3)) == ""
    text = difference(before, identity_of(bounding(0.9), ROBOT, gaits=3))
    assert text.startswith("which has changed since: at fixed state 3 of 4 its torque is up to 0.1")
    alone = identity_of(bounding(1.0), ROBOT)
    assert alone.plans == before.plans[:2]
    assert difference(alone, identity_of(bounding(0.9), ROBOT)) == ""
