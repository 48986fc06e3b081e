"""Possible wiring mistakes, tried one by one on a log that does not show them directly.

A log with joint targets, but without the network's input, shows only that something was wrong. Each
hypothesis changes one term of the log, and the one with which the network gives the commanded
targets is named. If the network's input agrees, only the targets can be wrong. Factors are fitted.
Read `rates` next, for what a log without targets shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from surefoot.deploy.policy import OnnxPolicy
from surefoot.interop.logs.differences import Numbers, largest, scale_in_words
from surefoot.interop.logs.replay import (
    Finding,
    Network,
    Window,
    clipped,
    commanded,
    reference_inputs,
)
from surefoot.interop.logs.sensor_log import SensorLog, component_names
from surefoot.learning.observation import Float32Array
from surefoot.rotations import rotation
from surefoot.types import JOINTS, LEGS, Array, BoolArray

LIKELY = 0.02
"""A hypothesis explains a log if it leaves at most this fraction of the difference, and of the
variation of the numbers in the log."""
LEAST = 1e-4
"""Differences smaller than this, in the unit of what is compared, need no explanation."""
FREE = 0.2
"""Targets at the torque limit are left out only if at least this fraction of a joint's remains."""
FACTORS = np.arange(-3.5, 3.6, 0.5)
"""Exponents of ten to search for a factor before it is fitted: up to millimeters and back."""

Terms = tuple[str, ...]
"""Fields of a log that a hypothesis changes together."""
BOTH_JOINT_TERMS: Terms = ("joint_position", "joint_velocity")
"""Joints that a driver takes for others, or counts the other way, differ in both."""
JOINT_TERMS: tuple[Terms, ...] = (
    ("joint_position",),
    ("joint_velocity",),
    BOTH_JOINT_TERMS,
    ("joint_target",),
)
TERMS: tuple[Terms, ...] = (
    *JOINT_TERMS,
    ("base_height",),
    ("angular_velocity",),
    ("linear_velocity",),
    ("command",),
)
"""All terms that may have another sign or scale."""


class Hypothesis(NamedTuple):
    """One thing that may be wrong.

    Attributes:
        terms: The fields of the log that would be wrong; `phase` for its gait clock.
        kind: As in `differences.Explanation`.
        text: What would be wrong, in words.
        change: Changes a log as the hypothesis says.
    """

    terms: Terms
    kind: str
    text: str
    change: Callable[[SensorLog], SensorLog]

    @property
    def term(self) -> str:
        """The fields, in words."""
        return " and ".join(self.terms)


def hypotheses(log: SensorLog) -> Iterator[Hypothesis]:
    """What may be wrong about a log, except scales, the simplest first.

    Args:
        log: The log; terms that it lacks cannot be wrong.
    """
    yield from _signs_and_orders(log)
    yield from _delays(log)
    yield from _frames(log)
    yield from orientations(log)
    yield from _clocks(log)


def _signs_and_orders(log: SensorLog) -> Iterator[Hypothesis]:
    """Other signs of each term, and other orders of the joints."""
    for terms in _present(log):
        columns = np.reshape(getattr(log, terms[0]), (len(log), -1)).shape[1]
        for which, places in _places(terms, columns):
            text = f"the sign of {which} differs"
            yield Hypothesis(terms, "sign", text, _times(terms, places, -1.0))
        if terms in JOINT_TERMS:
            for text, order in _orders():
                text = f"its order differs: {text}"
                yield Hypothesis(terms, "order", text, _reordered(terms, order))


def _delays(log: SensorLog) -> Iterator[Hypothesis]:
    """Joint targets that come some rows later."""
    if log.joint_target is None:
        return
    for rows in (1, 2, 3):
        early = log.joint_target[np.minimum(np.arange(len(log)) + rows, len(log) - 1)]
        text = f"it comes {rows} rows later"
        yield Hypothesis(("joint_target",), "time", text, _with("joint_target", early))


def _frames(log: SensorLog) -> Iterator[Hypothesis]:
    """Velocities of the base in another frame."""
    turn = rotation(log.orientation)
    for term in ("angular_velocity", "linear_velocity"):
        values = getattr(log, term)
        if values is None:
            continue
        for matrix, text in (
            (turn, "it is in the world frame instead of the base frame"),
            (np.swapaxes(turn, -1, -2), "it is turned to the base frame twice"),
        ):
            turned = (matrix @ values[..., None])[..., 0]
            yield Hypothesis((term,), "frame", text, _with(term, turned))


def orientations(log: SensorLog) -> Iterator[Hypothesis]:
    """Quaternions in another order, of the inverse rotation, or with other signs.

    Args:
        log: The log.
    """
    quat = log.orientation
    for kind, text, changed in (
        ("order", "w comes first instead of last", quat[:, [3, 0, 1, 2]]),
        ("order", "w is taken to come first", quat[:, [1, 2, 3, 0]]),
        ("order", "x and y are exchanged", quat[:, [1, 0, 2, 3]]),
        ("frame", "it is that of the world in the base frame", quat * (-1.0, -1.0, -1.0, 1.0)),
    ):
        yield Hypothesis(("orientation",), kind, text, _with("orientation", changed))
    for axes in ("x", "y", "z", "xy", "xz", "yz"):
        text = f"the sign of {' and '.join(axes)} differs"
        signs = [-1.0 if axis in axes else 1.0 for axis in "xyzw"]
        yield Hypothesis(("orientation",), "sign", text, _with("orientation", quat * signs))


def _clocks(log: SensorLog) -> Iterator[Hypothesis]:
    """Gait clocks at another rate."""
    first = int(log.tick[0])
    for factor in (2, 4, 5, 10):
        for text, tick in (
            ("too fast", first + (log.tick - first) * factor),
            ("too slowly", first + (log.tick - first) // factor),
        ):
            text = f"the gait clock runs {factor} times {text}"
            yield Hypothesis(("phase",), "rate", text, _with("tick", tick))


def scaled(terms: Terms, factor: float) -> Hypothesis:
    """The hypothesis that some terms of a log must be multiplied by a factor.

    Args:
        terms: The terms.
        factor: The factor.
    """
    # Targets came out of the policy; everything else went into it.
    told = 1.0 / factor if terms == ("joint_target",) else factor
    text = f"its scale differs: {scale_in_words(told)}"
    return Hypothesis(terms, "scale", text, _times(terms, slice(None), factor))


def _present(log: SensorLog) -> list[Terms]:
    """The terms that a log has."""
    return [terms for terms in TERMS if all(getattr(log, term) is not None for term in terms)]


def _places(terms: Terms, columns: int) -> Iterator[tuple[str, Sequence[int] | slice]]:
    """The columns of some terms that may be wrong together, and their names."""
    if columns > 1:
        for place, name in enumerate(component_names(terms[0], columns)):
            yield name, [place]
    if terms in JOINT_TERMS:
        yield from _joint_places()
    yield "all of it", slice(None)


@cache
def _joint_places() -> list[tuple[str, list[int]]]:
    """Joints that drivers handle together: all of one kind, of a leg, or of two legs."""
    by_leg = np.arange(len(JOINTS)).reshape(len(LEGS), 3)
    kinds = ("HAA", "HFE", "KFE")
    sides = {"left": [0, 2], "right": [1, 3], "front": [0, 1], "hind": [2, 3]}
    found = [(f"all {kind}", by_leg[:, place].tolist()) for place, kind in enumerate(kinds)]
    found += [(f"all joints of {leg}", by_leg[place].tolist()) for place, leg in enumerate(LEGS)]
    for side, legs in sides.items():
        found.append((f"all joints of the {side} legs", by_leg[legs].ravel().tolist()))
        for place, kind in enumerate(kinds):
            found.append((f"{kind} of the {side} legs", by_leg[legs, place].tolist()))
    return found


@cache
def _orders() -> list[tuple[str, list[int]]]:
    """Orders that other programs use: two joints exchanged, by joint, and other orders of legs."""
    places = np.arange(len(JOINTS))
    by_leg = places.reshape(len(LEGS), 3)
    by_joint = by_leg.T.ravel()
    orders = []
    for one, other in combinations(places.tolist(), 2):
        if one // 3 == other // 3 or one % 3 == other % 3:
            order = places.copy()
            order[[one, other]] = [other, one]
            orders.append((f"{JOINTS[one]} and {JOINTS[other]} are exchanged", order))
    orders.append(("by joint instead of by leg", by_joint))
    orders.append(("by leg instead of by joint", np.argsort(by_joint)))
    for legs in [*permutations(range(len(LEGS)))][1:]:
        names = ", ".join(LEGS[leg] for leg in legs)
        orders.append((f"legs {names}", by_leg[[*legs]].ravel()))
    orders.append(("hip flexion and knee are exchanged", by_leg[:, [0, 2, 1]].ravel()))
    orders.append(("knee first in each leg", by_leg[:, ::-1].ravel()))
    return [(text, order.tolist()) for text, order in orders]


def _with(term: str, values: NDArray) -> Callable[[SensorLog], SensorLog]:
    """A change of a term to these values."""
    return lambda log: replace(log, **{term: values})


def _times(
    terms: Terms, places: Sequence[int] | slice, factor: float
) -> Callable[[SensorLog], SensorLog]:
    """A change of some columns of some terms by a factor."""

    def multiplied(values: Array) -> Array:
        values = np.array(values, float)
        values[..., places] *= factor
        return values

    return lambda log: replace(log, **{term: multiplied(getattr(log, term)) for term in terms})


def _reordered(terms: Terms, order: list[int]) -> Callable[[SensorLog], SensorLog]:
    """A change of the order of the columns of some terms."""
    return lambda log: replace(log, **{term: getattr(log, term)[:, order] for term in terms})


def explain_targets(window: Window, policy: OnnxPolicy, network: Network) -> Finding:
    """The hypothesis with which the network gives the commanded targets, as a finding.

    Args:
        window: Rows of a log with joint targets, including some that differ.
        policy: Gives the layout, the gains and the limits.
        network: The network.
    """
    log = window.log
    known = slice(window.known, None)

    def differences(changed: SensorLog) -> Array:
        targets = commanded(changed)
        inputs = reference_inputs(changed, policy.description, targets)
        return np.abs(network(inputs[known]) - targets[known])

    def error(changed: SensorLog) -> float:
        found = differences(changed)
        # Motors clip by their own measurements: those of the log, or the log as it should be.
        free = [_free(policy, each, commanded(changed))[known] for each in (log, changed)]
        return min(float(found[these].mean()) for these in free)

    what = (
        "the robot was commanded other joint targets than the policy gives for these sensors, by "
        f"up to {differences(log).max():.3g} rad"
    )
    only = None if log.network_input is None else ("joint_target",)
    found = _most_likely(log, error, _spread(commanded(log)[known]), only)
    if found is not None:
        text = f"{found.term}: {what}, and the same if {found.text}"
        return Finding(found.term, found.kind, text)
    advice = "log the network's input (network_input), which names the term"
    if log.network_input is not None:
        advice = "the network's input agrees, so look at what becomes of its answers"
    text = f"joint_target: {what}, and no change of one term explains it; {advice}"
    return Finding("joint_target", "unknown", text)


def _free(policy: OnnxPolicy, log: SensorLog, targets: Array) -> BoolArray:
    """``(T, 12)`` True where the torque limit left a joint target unchanged, by the sensors."""
    torque = policy.kp * (targets - log.joint_position) - policy.kd * log.joint_velocity
    free = np.abs(torque) < np.array(policy.description.torque_limit) - LEAST
    # A joint that is nearly always at its limit more likely has wrong numbers.
    free[:, free.mean(axis=0) < FREE] = True
    return free


def explain_term(
    window: Window, policy: OnnxPolicy, term: slice, given: Float32Array, kept: Array
) -> Hypothesis | None:
    """The hypothesis that reproduces a part of the network's input; None if none does.

    Args:
        window: Rows of a log, including some in which the part differs.
        policy: Gives the layout, the gains and the limits.
        term: Where the part is in the input.
        given: ``(T, inputs)`` what the network was given.
        kept: ``(T, 12)`` the joint targets that were applied, if the log has none [rad].
    """
    known = slice(window.known, None)
    given = given[window.rows]
    kept = kept[window.rows]

    def error(changed: SensorLog) -> float:
        targets = changed.joint_target
        applied = kept if targets is None else clipped(policy, changed, targets)
        inputs = reference_inputs(changed, policy.description, applied)
        return largest(inputs[known, term], given[known, term])[0]

    return _most_likely(window.log, error, _spread(given[known, term]))


def _spread(values: Numbers) -> float:
    """How much numbers ``(T, n)`` vary over time."""
    return float(np.std(values, axis=0, dtype=float).mean())


def _most_likely(
    log: SensorLog,
    error: Callable[[SensorLog], float],
    size: float,
    only: Terms | None = None,
) -> Hypothesis | None:
    """The hypothesis that leaves the smallest error, if that is small; None otherwise.

    Args:
        log: The log.
        error: Gives the error of a log that a hypothesis has changed.
        size: How much the compared numbers vary.
        only: The only terms that may be wrong; None for any.
    """
    most = error(log)
    if most <= LEAST:
        return None
    wrong = [terms for terms in _present(log) if only in (None, terms)]
    tried = [each for each in hypotheses(log) if only in (None, each.terms)]
    tried += [scaled(terms, _factor(log, terms, error)) for terms in wrong]
    errors = [(error(each.change(log)), each) for each in tried]
    least, best = min(errors, key=lambda pair: pair[0])
    return best if least <= min(LIKELY * most, max(LIKELY * size, LEAST)) else None


def _factor(log: SensorLog, terms: Terms, error: Callable[[SensorLog], float]) -> float:
    """The factor on some terms that leaves the smallest error."""

    def left(power: float) -> float:
        return error(scaled(terms, 10.0**power).change(log))

    best = FACTORS[np.argmin([left(power) for power in FACTORS])]
    step = FACTORS[1] - FACTORS[0]
    fitted = minimize_scalar(
        left, bounds=(best - step, best + step), method="bounded", options={"xatol": 1e-5}
    )
    return float(10.0**fitted.x)
