"""What a log's sensors say about each other and about the robot, whatever was commanded.

Joint rates must be the derivatives of the angles, and the angular velocity must match the turning
of the orientation. The posture must be like those that the policy was trained from, and the height
must match the legs. A robot's own flights can only be judged in this way, because their targets
were computed from the same sensors. Read `hypotheses` for what may be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.deploy.description import PolicyDescription, start_limits
from surefoot.deploy.kinematics import feet_and_com
from surefoot.interop.logs.differences import DEGREES, explain
from surefoot.interop.logs.hypotheses import BOTH_JOINT_TERMS, hypotheses, scaled
from surefoot.interop.logs.replay import Finding
from surefoot.interop.logs.sensor_log import AXES, SensorLog
from surefoot.rotations import rotation
from surefoot.types import JOINTS, Array

CONSISTENT = 0.3
"""A measured rate is taken for the derivative if the root mean square of the difference is at most
this fraction of that of the rates; impacts of the feet cause some difference."""
LEAST_RATE = 0.05
"""[rad/s] Rates with a smaller root mean square than this show nothing."""
MARGIN = 0.1
"""[rad] How far a joint may be beyond its limits."""
PERTURBED = 0.5
"""[rad] How far a joint may be beyond the initial states trained on: robots that begin perturbed
1.5 times as far were up to 0.3 beyond, and a knee of the wrong sign is more than 2 beyond."""
HEIGHTS = (0.5, 2.0)
"""The measured height must be within these multiples of the height by the legs, because robots
leave the ground, and the ground is not level."""
MILLIMETERS = (500.0, 2000.0)
"""A height that is too large by a factor in this range is in millimeters."""


def explain_posture(log: SensorLog, description: PolicyDescription) -> list[Finding]:
    """The joint that is farthest beyond its possible range, and what would explain that.

    Args:
        log: The log.
        description: The policy, for the limits of the joints and the postures trained from.
    """
    misfit = _misfit(log, description)
    if misfit is None:
        return []
    nominal = np.array(description.nominal)
    tried = [each for each in hypotheses(log) if each.terms == BOTH_JOINT_TERMS]
    tried += [scaled(BOTH_JOINT_TERMS, factor) for factor in (DEGREES, 1.0 / DEGREES)]
    fitting = []
    for each in tried:
        changed = each.change(log)
        if _misfit(changed, description) is None:
            fitting.append((float(np.abs(_usual(changed) - nominal).sum()), each))
    text = f"joint_position: {misfit}"
    if not fitting:
        return [Finding("joint_position", "unknown", text)]
    _, best = min(fitting, key=lambda pair: pair[0])
    return [Finding("joint_position", best.kind, f"{text}; it fits if {best.text}")]


def _usual(log: SensorLog) -> Array:
    """``(12,)`` the median of each joint angle [rad], which a stumble does not change."""
    return np.median(log.joint_position, axis=0)


def _misfit(log: SensorLog, description: PolicyDescription) -> str | None:
    """The joint that is farthest beyond its range, in words; None if all are inside."""
    limits = np.array(description.position_limit, float)
    limits = np.where(np.isnan(limits), (-np.inf, np.inf), limits).T
    beyond = _beyond(log.joint_position, limits)
    row, joint = np.unravel_index(beyond.argmax(), beyond.shape)
    if beyond[row, joint] > MARGIN:
        angle = log.joint_position[row, joint]
        return _outside(f"is {angle:.3f} rad in row {row}, and its limits are", joint, limits)
    trained = start_limits(description.start_range)[:, 2:]
    usual = _usual(log)
    # A robot that falls leaves these postures after its first row, one that stumbles only briefly.
    beyond = np.minimum(_beyond(log.joint_position[0], trained), _beyond(usual, trained))
    joint = beyond.argmax()
    if beyond[joint] > PERTURBED:
        angle = usual[joint]
        text = f"is mostly {angle:.3f} rad, and the initial states trained on have"
        return _outside(text, joint, trained)
    return None


def _beyond(angles: Array, ranges: Array) -> Array:
    """How far joint angles ``(..., 12)`` are outside ``(2, 12)`` ranges [rad]."""
    return np.maximum(ranges[0] - angles, angles - ranges[1])


def _outside(text: str, joint: np.intp, ranges: Array) -> str:
    """A text about a joint, with the joint's name and range."""
    low, high = ranges[:, joint]
    return f"{JOINTS[joint]} {text} {low:.3f} to {high:.3f}"


def explain_height(log: SensorLog, description: PolicyDescription) -> list[Finding]:
    """Whether the height differs from that of the base above the lowest foot.

    Args:
        log: The log.
        description: The policy, for whether it sees the height, and the geometry of the legs.
    """
    asked = any(term.name == "base_height" for term in description.observation)
    if log.base_height is None or not asked:
        return []
    feet, _ = feet_and_com(description.kinematics, log.joint_position)
    up = rotation(log.orientation)[:, 2]
    lowest = (feet @ up[..., None])[..., 0].min(axis=1)
    of_legs = description.kinematics.foot_radius - lowest
    expected = float(np.median(of_legs))
    if min(expected, of_legs[0]) <= 0.0:  # the robot lies on its back
        return []
    found = float(np.median(log.base_height))
    # As with the posture: a robot that falls begins with the right height.
    begins = float(log.base_height[0] / of_legs[0])
    factor = found / expected
    if any(HEIGHTS[0] <= each <= HEIGHTS[1] for each in (begins, factor)):
        return []
    kind = "scale"
    how = f"it is {factor:.3g} times as large"
    if found == 0.0:
        kind = "unknown"
        how = "does anything measure it?"
    elif factor < 0.0:
        kind = "sign"
        how = "its sign differs"
    elif MILLIMETERS[0] < factor < MILLIMETERS[1]:
        how += " (millimeters for meters?)"
    text = (
        f"base_height: it is mostly {found:.3g} m, and by the angles of the joints the base is "
        f"{expected:.3g} m above the lowest foot; {how}"
    )
    return [Finding("base_height", kind, text)]


def explain_sensors(log: SensorLog) -> list[Finding]:
    """The rates that are not the derivatives of their angles or of the orientation.

    Args:
        log: The log; rows that repeat a measurement, as after a lost datagram, are left out.
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
    return findings


def _opposite(
    term: str, source: str, expected: Array, given: Array, names: Sequence[str]
) -> list[Finding]:
    """Single rates of opposite sign, which weigh too little to show in the error of all rates."""
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
