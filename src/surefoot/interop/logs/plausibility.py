"""What a log's sensors say about the robot, whatever was commanded.

The posture must be like those that the policy was trained from, and the height must match the legs.
Read `rates` next, for what the sensors say about each other, and `hypotheses` for what may be
wrong.
"""

from __future__ import annotations

import numpy as np

from surefoot.deploy.description import PolicyDescription, start_limits
from surefoot.deploy.kinematics import feet_and_com
from surefoot.interop.logs.differences import DEGREES
from surefoot.interop.logs.hypotheses import BOTH_JOINT_TERMS, hypotheses, scaled
from surefoot.interop.logs.replay import Finding
from surefoot.interop.logs.sensor_log import SensorLog
from surefoot.rotations import rotation
from surefoot.types import JOINTS, Array

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
