"""Whether the rates of a log are the derivatives of what they belong to.

Joint rates must be the derivatives of the angles, and the angular velocity must match the turning
of the orientation, of which either may be wrong. A robot's own flights can only be judged in this
way, because their targets were computed from the same sensors. Read `differences` for how two
recordings may differ, and `hypotheses` for what may be wrong with an orientation.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.deploy.description import PolicyDescription
from surefoot.deploy.kinematics import feet_and_com
from surefoot.interop.logs.differences import Explanation, explain, remaining, size_of
from surefoot.interop.logs.hypotheses import orientations
from surefoot.interop.logs.replay import Finding
from surefoot.interop.logs.sensor_log import AXES, SensorLog
from surefoot.rotations import rotation
from surefoot.types import JOINTS, Array, IntArray

CONSISTENT = 0.3
"""A measured rate is taken for the derivative if the root mean square of the difference is at most
this fraction of that of the rates; impacts of the feet cause some difference."""
LEAST_RATE = 0.05
"""[rad/s] Rates with a smaller root mean square than this show nothing."""
OUTLIER = 20.0
"""A row is an outlier where derivative and rate differ by this multiple of the usual rate .."""
LEAST_OUTLIER = 20.0
"""[rad/s] .. and by this: impacts of the feet change the rate of a joint by some rad/s."""
LEAST_SPEED = 0.03
"""[m/s] Velocities of the base with a smaller root mean square than this show nothing."""
FOLLOWS = 0.5
"""The velocity of the base follows the feet if at most this fraction of it differs: feet roll and
give way, and estimators lag."""
SLIP = 0.1
"""[m/s] Two feet stand if the velocities of the base that they give differ by at most this; in
walks on flat ground, they do in more than 90 % of the rows."""
STANDING = 0.7
"""The share of rows in which two feet must stand for the velocity to be judged."""
BETTER = 0.5
"""One of two explanations is named alone if it leaves at most this fraction of what the other
leaves; otherwise both are named, as equal alternatives."""
UPRIGHT = 0.5
"""A base is upright while the cosine of its tilt is mostly at least this."""


def explain_sensors(log: SensorLog, description: PolicyDescription) -> list[Finding]:
    """The rates that are not the derivatives of their angles or of the orientation.

    If all are, the linear velocity of the base is compared with that of the feet on the ground.

    Args:
        log: The log; rows that repeat a measurement, as after a lost datagram, are left out.
        description: The policy, for the geometry of the legs.
    """
    new = np.diff(log.time_ns, prepend=log.time_ns[0] - 1) != 0
    if new.sum() < 2 or (np.diff(log.time_ns) < 0).any():
        return [Finding("time_ns", "time", "time_ns: it does not rise from row to row")]
    log = log.at(new)
    dt = np.diff(log.time_ns) / 1e9
    slope = np.diff(log.joint_position, axis=0) / dt[:, None]
    rate = (log.joint_velocity[1:] + log.joint_velocity[:-1]) / 2.0
    turn = rotation(log.orientation)
    spin = _spin(turn, dt)
    gyro = (log.angular_velocity[1:] + log.angular_velocity[:-1]) / 2.0
    pairs = (
        ("joint_velocity", "the derivative of joint_position", slope, rate, JOINTS),
        ("angular_velocity", "the turning of orientation", spin, gyro, AXES),
    )
    findings = []
    for term, source, expected, given, names in pairs:
        size = max(size_of(expected), size_of(given))
        error = size_of(given - expected)
        if size < LEAST_RATE:
            continue
        if error <= CONSISTENT * size:
            findings += _opposite(term, source, expected, given, names) or _outlier(
                log, term, expected - given, size, np.flatnonzero(new)
            )
            continue
        of_base = term == "angular_velocity"
        told = explain(expected, given, names, CONSISTENT, turn[1:] if of_base else None)
        finding = Finding(term, told.kind, f"{term}: it is not {source}; {told.text}")
        findings.append(_or_orientation(log, finding, told, given, dt) if of_base else finding)
    factors = [finding for finding in findings if finding.kind == "scale"]
    if len(factors) == len(pairs):
        return [
            Finding(
                "time_ns",
                "rate",
                "rate: all rates differ by a factor from the derivatives of what they belong to "
                f"({factors[0].text}); the rows are not as far apart as time_ns says",
            )
        ]
    return findings or _explain_velocity(log, description, gyro, dt)


def _outlier(log: SensorLog, term: str, error: Array, size: float, rows: IntArray) -> list[Finding]:
    """The measurement that is far off in a single row, if there is one.

    An angle that is off in one row gives one slope that is too large and then one of the other
    sign; a rate that is off is in the means of two steps with the same sign.

    Args:
        log: The log, without repeated rows.
        term: The rate.
        error: ``(T - 1, n)`` the derivatives less the rates, from row to row.
        size: The size of the rates.
        rows: ``(T,)`` where the rows are in the whole log.
    """
    step, place = np.unravel_index(np.abs(error).argmax(), error.shape)
    most = error[step, place]
    if abs(most) <= max(OUTLIER * size, LEAST_OUTLIER):
        return []
    around = np.pad(error[:, place], 1)[step : step + 3]
    before, _, after = around.tolist()
    row = int(step) + int(abs(after) >= abs(before))
    beside = after if abs(after) >= abs(before) else before
    names = {"joint_velocity": "joint_position", "angular_velocity": "orientation"}
    wrong = term if beside * most > 0.0 else names[term]
    numbers = getattr(log, wrong)
    near = max(row - 2, 0) if row > 1 else row + 2
    if wrong == "orientation":
        which = "it"
        here, there = (np.array2string(numbers[each], precision=3) for each in (row, near))
    else:
        which = (JOINTS if wrong.startswith("joint") else AXES)[place]
        here, there = (f"{numbers[each, place]:.4g}" for each in (row, near))
    text = (
        f"{wrong}: {which} is {here} in row {rows[row]}, and {there} in row {rows[near]}, which no "
        "robot does so quickly; leave the row out, or look at what reads the sensor"
    )
    return [Finding(wrong, "outlier", text)]


def _explain_velocity(
    log: SensorLog, description: PolicyDescription, gyro: Array, dt: Array
) -> list[Finding]:
    """Whether the linear velocity differs from what the feet on the ground say, which do not slip.

    A foot at p on the ground has the velocity v + omega x p + dp/dt = 0. Nothing is said unless the
    two lowest feet mostly agree on v, so that they stand.

    Args:
        log: The log; its other rates are right.
        description: The policy, for the geometry of the legs.
        gyro: ``(T - 1, 3)`` the angular velocity between the rows [rad/s].
        dt: ``(T - 1,)`` the time between the rows [s].
    """
    if log.linear_velocity is None:
        return []
    feet, _ = feet_and_com(description.kinematics, log.joint_position)
    turn = rotation(log.orientation)[1:]
    between = (feet[1:] + feet[:-1]) / 2.0
    of_feet = -np.diff(feet, axis=0) / dt[:, None, None] - np.cross(gyro[:, None], between)
    height = (between @ turn[:, 2, :, None])[..., 0]
    lowest = height.argsort(axis=1)[:, :2, None]
    pair = np.take_along_axis(of_feet, lowest, axis=1)
    stand = np.linalg.norm(pair[:, 0] - pair[:, 1], axis=1) <= SLIP
    if stand.mean() < STANDING:
        return []
    expected = pair.mean(axis=1)[stand]
    given = ((log.linear_velocity[1:] + log.linear_velocity[:-1]) / 2.0)[stand]
    if max(size_of(expected), size_of(given)) < LEAST_SPEED:
        return []
    term = "linear_velocity"
    source = "that of the base over the feet that stand"
    if remaining(expected, given) <= FOLLOWS:
        return _opposite(term, source, expected, given, AXES)
    told = explain(expected, given, AXES, FOLLOWS, turn[stand])
    text = (
        f"{term}: it is not {source} (a robot that hangs in the air has none, and shows nothing); "
        f"{told.text}"
    )
    return [Finding(term, told.kind, text)]


def _or_orientation(
    log: SensorLog, finding: Finding, told: Explanation, gyro: Array, dt: Array
) -> Finding:
    """The finding that angular velocity and orientation disagree, with the wrong one of the two.

    Args:
        log: The log.
        finding: The finding, if the angular velocity is the wrong one.
        told: How the angular velocity would be wrong.
        gyro: ``(T - 1, 3)`` the angular velocity between the rows [rad/s].
        dt: ``(T - 1,)`` the time between the rows [s].
    """
    stands = _upright(log)
    found = []
    for each in orientations(log):
        changed = each.change(log)
        left = remaining(_spin(rotation(changed.orientation), dt), gyro)
        if left <= CONSISTENT:
            found.append((not _upright(changed), left, each))
    if not found:
        return finding
    lies, left, best = min(found, key=lambda each: each[:2])
    if stands and lies:
        return finding
    text = (
        "orientation: angular_velocity is not its turning, and the two agree if, of the "
        f"orientation, {best.text}"
    )
    alone = Finding("orientation", best.kind, text)
    # A robot that walks is upright.
    if told.kind == "unknown" or (not lies and not stands) or left <= BETTER * told.left:
        return alone
    if told.left <= BETTER * left:
        return finding
    text = f"{finding.text}; or, just as likely, the orientation is wrong: {best.text}"
    return Finding(finding.term, finding.kind, text)


def _upright(log: SensorLog) -> bool:
    """Whether the base is mostly upright."""
    return float(np.median(rotation(log.orientation)[:, 2, 2])) >= UPRIGHT


def _opposite(
    term: str, source: str, expected: Array, given: Array, names: Sequence[str]
) -> list[Finding]:
    """Single rates of opposite sign, which weigh too little to show in the error of all rates."""
    size = np.array([size_of(column) for column in expected.T])
    error = np.array([size_of(column) for column in (given + expected).T])
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
