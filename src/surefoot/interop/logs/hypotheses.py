"""What may have been wired wrongly, tried one by one on a log that does not say it directly.

A log with joint targets, but without the network's input, shows only that something was wrong: each
hypothesis changes one term of its sensors, and the one with which the network answers as the robot
did is named. A log without targets has only its sensors: joint rates have to be the derivatives of
the angles, and the rate of turn that of the orientation. Read `replay` next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.deploy.policy import OnnxPolicy
from surefoot.interop.logs.differences import DEGREES, explain, largest
from surefoot.interop.logs.replay import Finding, Network, reference_inputs
from surefoot.interop.logs.sensor_log import SensorLog
from surefoot.learning.observation import Float32Array
from surefoot.rotations import rotation
from surefoot.types import JOINTS, LEGS, Array

LIKELY = 0.02
"""A hypothesis explains a log if it leaves at most this share of the difference."""
CONSISTENT = 0.3
"""A measured rate is the derivative of what it belongs to if its difference from that, root mean
square, is at most this share of it; impacts of the feet make some."""
LEAST_RATE = 0.05
"""[rad/s] Rates that are smaller than this, root mean square, say nothing."""
AXES = ("x", "y", "z")


class Hypothesis(NamedTuple):
    """One thing that may be wrong.

    Attributes:
        term: The term of the sensors.
        kind: As in `differences.Explanation`.
        text: What would be wrong, in words.
        change: The log as it would be then.
    """

    term: str
    kind: str
    text: str
    change: Callable[[SensorLog], SensorLog]


def hypotheses(log: SensorLog) -> Iterator[Hypothesis]:
    """What may be wrong about a log's sensors.

    Args:
        log: The log; terms that it lacks cannot be wrong.
    """
    for kind, text, order in _orders():
        for terms in (("joint_position",), ("joint_velocity",), _JOINT_TERMS):
            yield Hypothesis(" and ".join(terms), kind, text, _reordered(terms, order))
    for term, names in (
        ("joint_position", JOINTS),
        ("joint_velocity", JOINTS),
        ("angular_velocity", AXES),
        ("linear_velocity", AXES),
        ("command", ("vx", "vy", "yaw_rate")),
    ):
        values = getattr(log, term)
        if values is None:
            continue
        for places, which in (
            (range(len(names)), "all of it"),
            *(([place], name) for place, name in enumerate(names)),
            *(
                (range(kind, 12, 3), f"all {joint}")
                for kind, joint in enumerate(("HAA", "HFE", "KFE"))
                if len(names) == len(JOINTS)
            ),
            *(
                (range(3 * leg, 3 * leg + 3), f"all joints of {name}")
                for leg, name in enumerate(LEGS)
                if len(names) == len(JOINTS)
            ),
        ):
            yield Hypothesis(
                term, "sign", f"the sign of {which} differs", _times(term, [*places], -1.0)
            )
        every = [*range(len(names))]
        for factor, text in _SCALES.items():
            yield Hypothesis(
                term, "scale", f"its scale differs: it is {text}", _times(term, every, factor)
            )
    turn = rotation(log.orientation)
    for term in ("angular_velocity", "linear_velocity"):
        values = getattr(log, term)
        if values is not None:
            for matrix, text in (
                (turn, "it is in the world frame instead of the base frame"),
                (np.swapaxes(turn, -1, -2), "it is turned to the base frame twice"),
            ):
                turned = (matrix @ values[..., None])[..., 0]
                yield Hypothesis(term, "frame", text, _with(term, turned))
    quat = log.orientation
    yield Hypothesis(
        "orientation",
        "order",
        "w comes first instead of last",
        _with("orientation", quat[:, [3, 0, 1, 2]]),
    )
    yield Hypothesis(
        "orientation",
        "order",
        "w is taken to come first",
        _with("orientation", quat[:, [1, 2, 3, 0]]),
    )
    yield Hypothesis(
        "orientation",
        "frame",
        "it is that of the world in the base frame",
        _with("orientation", quat * (-1.0, -1.0, -1.0, 1.0)),
    )
    for factor in (2, 4, 5, 10):
        first = int(log.tick[0])
        slow = first + (log.tick - first) * factor
        fast = first + (log.tick - first) // factor
        yield Hypothesis(
            "phase", "rate", f"the gait clock runs {factor} times too fast", _with("tick", slow)
        )
        yield Hypothesis(
            "phase", "rate", f"the gait clock runs {factor} times too slowly", _with("tick", fast)
        )


_SCALES: Mapping[float, str] = {
    DEGREES: "57.3 times as large (degrees for radians?)",
    1.0 / DEGREES: "1/57.3 times as large (radians for degrees?)",
    **{factor: f"{factor:g} times as large" for factor in (2.0, 4.0, 10.0, 20.0)},
    **{1.0 / factor: f"1/{factor:g} times as large" for factor in (2.0, 4.0, 10.0, 20.0)},
}
"""Factors that other policies have, and those of other units."""
_JOINT_TERMS = ("joint_position", "joint_velocity")


def _orders() -> Iterator[tuple[str, str, list[int]]]:
    """Orders that other programs have: by joint instead of by leg, and other legs first."""
    by_leg = np.arange(len(JOINTS)).reshape(len(LEGS), 3)
    by_joint = by_leg.T.ravel().tolist()
    back = np.argsort(by_joint).tolist()
    yield "order", "its order differs: by joint instead of by leg", by_joint
    yield "order", "its order differs: by leg instead of by joint", back
    for legs in (
        (1, 0, 3, 2),
        (2, 3, 0, 1),
        (3, 2, 1, 0),
        (0, 2, 1, 3),
        (1, 0, 2, 3),
        (0, 1, 3, 2),
        (0, 2, 3, 1),
        (1, 3, 0, 2),
        (2, 0, 3, 1),
    ):
        names = ", ".join(LEGS[leg] for leg in legs)
        yield "order", f"its order differs: legs {names}", by_leg[[*legs]].ravel().tolist()
    reverse = by_leg[:, ::-1].ravel().tolist()
    yield "order", "its order differs: knee first in each leg", reverse


def _with(term: str, values: NDArray) -> Callable[[SensorLog], SensorLog]:
    """A change to these values of a term."""
    return lambda log: replace(log, **{term: values})


def _times(term: str, places: list[int], factor: float) -> Callable[[SensorLog], SensorLog]:
    """A change of some columns of a term by a factor."""

    def change(log: SensorLog) -> SensorLog:
        values = getattr(log, term).copy()
        values[:, places] *= factor
        return replace(log, **{term: values})

    return change


def _reordered(terms: tuple[str, ...], order: list[int]) -> Callable[[SensorLog], SensorLog]:
    """A change of the order of the columns of some terms."""
    return lambda log: replace(log, **{term: getattr(log, term)[:, order] for term in terms})


MOST_ROWS = 400
"""Number of rows on which hypotheses are tried: a few of them settle it."""


def explain_targets(
    log: SensorLog, policy: OnnxPolicy, network: Network, targets: Array
) -> Finding:
    """Which hypothesis makes the network answer as the robot was commanded.

    Args:
        log: The log.
        policy: Gives the layout.
        network: The network.
        targets: ``(T, 12)`` the joint targets that were logged [rad].
    """
    short = log.first(MOST_ROWS)
    targets = targets[: len(short)]

    def error(changed: SensorLog) -> float:
        answers = network(reference_inputs(changed, policy.description, targets))
        # Some targets may have been clipped by what the motors measured, others not.
        return float(np.median(np.abs(answers - targets)))

    most = float(
        np.abs(network(reference_inputs(short, policy.description, targets)) - targets).max()
    )
    what = (
        "the robot was commanded other joint targets than the policy gives for these sensors, by "
        f"up to {most:.3g} rad"
    )
    found = _most_likely(short, error)
    if found is not None:
        text = f"{found.term}: {what}, and the same if {found.text}"
        return Finding(found.term, found.kind, text)
    advice = "log the network's input (network_input), which names the term"
    text = f"joint_target: {what}, and no change of one term explains it; {advice}"
    return Finding("joint_target", "unknown", text)


def explain_term(
    log: SensorLog, policy: OnnxPolicy, term: slice, given: Float32Array, kept: Array
) -> Hypothesis | None:
    """Which hypothesis makes a part of the network's input what it was; None if none does.

    Args:
        log: The log.
        policy: Gives the layout.
        term: Where the part lies in the input.
        given: ``(T, inputs)`` what the network was given.
        kept: ``(T, 12)`` the joint targets that were applied [rad].
    """
    short = log.first(MOST_ROWS)
    rows = slice(len(short))

    def error(changed: SensorLog) -> float:
        inputs = reference_inputs(changed, policy.description, kept[rows])
        return largest(inputs[:, term], given[rows, term])[0]

    return _most_likely(short, error)


def _most_likely(log: SensorLog, error: Callable[[SensorLog], float]) -> Hypothesis | None:
    """The hypothesis that leaves the smallest error, if that is small; None otherwise.

    Args:
        log: The log.
        error: How far a log, changed as a hypothesis says, is from what was seen.
    """
    errors = [(error(each.change(log)), each) for each in hypotheses(log)]
    least, best = min(errors, key=lambda pair: pair[0])
    return best if least <= LIKELY * error(log) else None


def explain_sensors(log: SensorLog) -> list[Finding]:
    """Which rates are not the derivatives of what they belong to.

    Args:
        log: The log; rows that repeat a measurement, as where a datagram was lost, are left out.
    """
    new = np.diff(log.time_ns, prepend=log.time_ns[0] - 1) != 0
    if new.sum() < 2 or (np.diff(log.time_ns) < 0).any():
        return [Finding("time_ns", "time", "time_ns: it does not rise from row to row")]
    log = log.at(new)
    dt = np.diff(log.time_ns) / 1e9
    pairs = []
    slope = np.diff(log.joint_position, axis=0) / dt[:, None]
    rate = (log.joint_velocity[1:] + log.joint_velocity[:-1]) / 2.0
    pairs.append(("joint_velocity", "the derivative of joint_position", slope, rate, JOINTS))
    turn = rotation(log.orientation)
    spin = _spin(turn, dt)
    gyro = (log.angular_velocity[1:] + log.angular_velocity[:-1]) / 2.0
    pairs.append(("angular_velocity", "the turning of orientation", spin, gyro, AXES))
    findings = []
    for term, source, expected, given, names in pairs:
        size = max(np.sqrt(np.mean(expected**2)), np.sqrt(np.mean(given**2)))
        error = np.sqrt(np.mean((given - expected) ** 2))
        if size < LEAST_RATE:
            continue
        if error <= CONSISTENT * size:
            findings += _opposite(term, source, expected, given, names)
            continue
        frame = turn[1:] if term == "angular_velocity" else None
        kind, text = explain(expected, given, names, CONSISTENT, frame)
        findings.append(Finding(term, kind, f"{term}: it is not {source}; {text}"))
    scaled = [finding for finding in findings if finding.kind == "scale"]
    if len(scaled) == len(pairs):
        return [
            Finding(
                "time_ns",
                "rate",
                "rate: all rates differ by a factor from the derivatives of what they belong to "
                f"({scaled[0].text}); the rows are not as far apart as time_ns says",
            )
        ]
    return findings


def _opposite(
    term: str, source: str, expected: Array, given: Array, names: Sequence[str]
) -> list[Finding]:
    """Single rates, of little weight among all of them, that have the opposite sign."""
    size = np.sqrt(np.mean(expected**2, axis=0))
    error = np.sqrt(np.mean((given + expected) ** 2, axis=0))
    places = np.flatnonzero((size > LEAST_RATE) & (error <= CONSISTENT * size))
    if not len(places):
        return []
    which = ", ".join(names[place] for place in places.tolist())
    text = f"{term}: it is not {source}; the sign of {which} differs"
    return [Finding(term, "sign", text)]


def _spin(turn: Array, dt: Array) -> Array:
    """``(T - 1, 3)`` the angular velocity that turns each orientation into the next, base frame."""
    step = np.swapaxes(turn[:-1], -1, -2) @ turn[1:]
    # Small angles: the skew part of the step is the sine of the angle times the axis.
    axis = np.stack(
        [
            step[:, 2, 1] - step[:, 1, 2],
            step[:, 0, 2] - step[:, 2, 0],
            step[:, 1, 0] - step[:, 0, 1],
        ],
        axis=1,
    )
    return axis / 2.0 / dt[:, None]
