"""Identifies an expert's MPC by the name of its plan function and its plans at fixed states.

A run must be continued with the expert that it began with, or one dataset mixes the labels of two.
A name alone is not enough: all lambdas have the same one, and a function may have been edited. So a
run keeps an `ExpertIdentity` of a user's MPC, and `difference` says how another one differs from
it. A change that shows at none of the states goes unnoticed. The package's own planner needs no
identity, because the run's configuration determines it. `runs.own_expert` uses this to decide
whether a run may continue.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import partial

import numpy as np

from surefoot.errors import interrupt_behind
from surefoot.mpc.expert import ask_for_plan
from surefoot.robots.geometry import state_of
from surefoot.robots.model import RobotModel, standing
from surefoot.robots.rigid import integrate
from surefoot.types import Array, Command, GaitCommand, PlanFunction, State

TOLERANCE = 1e-6
"""[rad, rad/s, N m] Plans at most this far apart count as the same: another processor rounds
differently."""
REPEATABLE = 0.01 * TOLERANCE
"""[rad, rad/s, N m] A pure function that is asked again gives a closer plan, even on several
threads."""
DECIMALS = 9
"""Numbers of a plan are kept to this many decimals, far below the tolerance."""
UNITS = {"joint_position": "rad", "joint_velocity": "rad/s", "torque": "N m"}
"""The arrays of a plan, with their units."""

Rows = tuple[tuple[float, ...], ...]
"""``(ticks, 12)`` numbers, as JSON keeps them."""


@dataclass(frozen=True)
class FixedPlan:
    """The answer of a plan function at one fixed state.

    Attributes:
        joint_position: ``(ticks, 12)`` reference joint angles [rad].
        joint_velocity: ``(ticks, 12)`` reference joint rates [rad/s].
        torque: ``(ticks, 12)`` feed-forward joint torques [N m].
        valid: Whether the plan may be executed.
        failure: What the function did instead of giving a plan that an expert accepts; empty if it
            gave one.
    """

    joint_position: Rows = ()
    joint_velocity: Rows = ()
    torque: Rows = ()
    valid: bool = False
    failure: str = ""


@dataclass(frozen=True)
class ExpertIdentity:
    """Everything that tells one MPC from another.

    Attributes:
        module: Name of the module that defines the plan function, or its class.
        name: Qualified name of the function, or of its class.
        repeatable: Whether the function gave the same plan when it was asked again. If it did not,
            it is identified by its names alone.
        plans: The plans at the fixed states.
    """

    module: str
    name: str
    repeatable: bool
    plans: tuple[FixedPlan, ...]

    @property
    def title(self) -> str:
        """The name with its module."""
        return f"{self.module}.{self.name}"


def plan_names(plan: PlanFunction) -> tuple[str, str]:
    """Return the module and the qualified name of a plan function.

    For a `functools.partial` or a decorated function, they are those of the wrapped function; for a
    callable object, those of its class.

    Args:
        plan: The plan function.
    """
    inner = inspect.unwrap(plan)
    if isinstance(inner, partial):
        return plan_names(inner.func)
    named = inner if inspect.isroutine(inner) or inspect.isclass(inner) else type(inner)
    return str(named.__module__), named.__qualname__


def identity_of(plan: PlanFunction, robot: RobotModel, gaits: int = 1) -> ExpertIdentity:
    """Return the identity of a plan function; it is asked for three plans, and one per other gait.

    A function that raises, or gives no plan that an expert accepts, has an identity too: the kind
    of its error is kept as the failure.

    Args:
        plan: The plan function.
        robot: The robot that it plans for.
        gaits: The number of gaits that it is asked for.
    """
    module, name = plan_names(plan)
    states = _fixed_states(robot, gaits)
    plans = tuple(_ask(plan, *state) for state in states)
    again = _ask(plan, *states[0])  # after the others, which must leave no trace
    repeatable = not _plan_difference(plans[0], again, REPEATABLE)
    return ExpertIdentity(module, name, repeatable, plans)


def difference(before: ExpertIdentity, now: ExpertIdentity) -> str:
    """Describe how an expert differs from an earlier one; empty if it does not.

    Args:
        before: The earlier expert.
        now: The expert to compare with it.

    Returns:
        The end of a sentence that begins with the name of the earlier expert and a comma, or an
        empty text.
    """
    if (before.module, before.name) != (now.module, now.name):
        return f"not with {now.title}"
    if not (before.repeatable and now.repeatable):
        return ""
    if len(before.plans) != len(now.plans):  # from a version with other states
        return ""
    for number, (one, other) in enumerate(zip(before.plans, now.plans, strict=True), 1):
        text = _plan_difference(one, other, TOLERANCE)
        if text:
            return f"which has changed since: at fixed state {number} of {len(now.plans)} {text}"
    return ""


def _fixed_states(robot: RobotModel, gaits: int) -> list[tuple[State, int, Command]]:
    """Return the arguments for which plans are kept.

    The first robot stands still; the second moves in every degree of freedom, between two ticks of
    the planning grid, so that feedback on a position or a velocity shows. The second does so in
    each further gait too.
    """
    upright = standing(robot)
    count = np.arange(1.0, 19.0)
    q = np.stack([upright, integrate(upright, 0.02 * np.sin(count))])
    v = np.stack([np.zeros(18), 0.1 * np.cos(count)])
    states = state_of(robot, q, v)
    others = [GaitCommand(0.2, 0.05, 0.1, gait) for gait in range(1, gaits)]
    return [
        (states[0], 0, Command(0.3, 0.0, 0.0)),
        (states[1], 133, Command(0.2, 0.05, 0.1)),
        *((states[1], 133, command) for command in others),
    ]


def _ask(plan: PlanFunction, state: State, tick: int, command: Command) -> FixedPlan:
    """Return the plan of a function, or how it failed."""
    try:
        arrays, valid = ask_for_plan(plan, state, tick, command)
    except Exception as error:  # whatever a user's code raises, or an expert refuses
        if interrupt_behind(error) is not None:
            raise
        return FixedPlan(failure=f"gave no plan ({type(error).__name__})")
    position, velocity, torque = np.split(arrays, 3, axis=1)
    return FixedPlan(_rows(position), _rows(velocity), _rows(torque), valid)


def _rows(array: Array) -> Rows:
    """Return an array of a plan as tuples; what is not finite becomes NaN, as in JSON."""
    array = np.where(np.isfinite(array), np.round(array, DECIMALS), np.nan)
    return tuple(map(tuple, array.tolist()))


def _plan_difference(before: FixedPlan, now: FixedPlan, tolerance: float) -> str:
    """Describe how a plan differs from an earlier one; empty if it does not."""
    if before.failure != now.failure:
        return f"it {now.failure or 'gave a plan'}; before, it {before.failure or 'gave a plan'}"
    for name, unit in UNITS.items():
        one = np.array(getattr(before, name))
        other = np.array(getattr(now, name))
        what = name.replace("_", " ")
        if one.shape != other.shape:
            return f"its plan has {len(other)} ticks; before, it had {len(one)}"
        if not np.array_equal(np.isfinite(one), np.isfinite(other)):
            return f"its {what} is not finite where it was before, or the other way round"
        apart = float(np.abs(other - one)[np.isfinite(one)].max(initial=0.0))
        if apart > tolerance:
            return f"its {what} is up to {apart:.3g} {unit} apart (tolerance {tolerance:g})"
    if before.valid != now.valid:
        words = {True: "valid", False: "not valid"}
        return f"its plan is {words[now.valid]}; before, it was {words[before.valid]}"
    return ""
