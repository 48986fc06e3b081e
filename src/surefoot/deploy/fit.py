"""Whether a policy may drive a robot: name, joint order, rate, and the posture it begins in.

Read `loop` next.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.faults import Limits, roll_pitch
from surefoot.deploy.interfaces import DeployedPolicy, Sensors
from surefoot.deploy.protocol import Description, check_description
from surefoot.types import JOINTS, Array

INSIDE = 0.25
"""How far inside the range of a joint the standing posture must be, as a share of that range: the
weight of the robot bends its legs further."""
STANDS_STILL = 1.0
"""[m/s] A base that stands moves slower than this; one whose velocity is in mm/s seems faster."""


class WrongRobotError(ValueError):
    """A policy was made for another robot, joint order or rate than the bridge's."""


def check_robot(policy: DeployedPolicy, description: Description) -> None:
    """Check that a policy was made for a robot.

    Args:
        policy: The policy.
        description: What the bridge says about its robot.

    Raises:
        WrongRobotError: Robot, joint order or rate differ.
        ValueError: The limits or times of the bridge cannot keep a robot safe.
    """
    check_description(description)
    if policy.robot != description.robot:
        raise WrongRobotError(
            f"the policy was made for the robot {policy.robot}, and the bridge serves "
            f"{description.robot}"
        )
    check_joints_and_rate(policy.joints, policy.rate_hz, description)


def check_joints_and_rate(joints: Sequence[str], rate_hz: int, description: Description) -> None:
    """Check that a bridge has the joints of a policy, in the same order, and its rate.

    Args:
        joints: The names of the policy's twelve joints.
        rate_hz: The policy's rate [Hz].
        description: What the bridge says about its robot.

    Raises:
        WrongRobotError: Joint order or rate differ.
    """
    for number, (own, bridges) in enumerate(zip(joints, description.joints, strict=True)):
        if own != bridges:
            raise WrongRobotError(
                f"joint {number} is {own} for the policy and {bridges} for the bridge; the bridge "
                "has to give the joints in the policy's order"
            )
    if rate_hz != description.rate_hz:
        raise WrongRobotError(
            f"the policy runs at {rate_hz} Hz, and the bridge at {description.rate_hz} Hz"
        )


def limits_of(description: Description) -> Limits:
    """The joint limits that a bridge gives.

    Args:
        description: What the bridge says about its robot.
    """
    return Limits(
        np.array(description.position_low),
        np.array(description.position_high),
        np.array(description.speed),
        np.array(description.torque),
    )


def missing_base(policy: DeployedPolicy, has_expert: bool, sensors: Sensors) -> str | None:
    """Why a robot whose base is not measured cannot be driven; None if the base is not needed.

    Args:
        policy: The policy.
        has_expert: Whether an expert may take over from it.
        sensors: What the robot measures.
    """
    if sensors.base is not None:
        return None
    if policy.needs_base:
        return (
            "the policy needs height and linear velocity of the base, which nothing measures; "
            "train one without them"
        )
    if has_expert:
        return (
            "the expert needs height and linear velocity of the base, which nothing measures; "
            "drive without it, as with --gate damp"
        )
    return None


def wrong_base_of(policy: DeployedPolicy, sensors: Sensors, share: float) -> str | None:
    """Why the measured base of a standing robot cannot be right; None if it can.

    A unit or an origin that is wrong drives a policy mad at once, since it was never trained there.

    Args:
        policy: The policy.
        sensors: What the robot measures.
        share: By what share the height may differ from that by the legs.
    """
    base = sensors.base
    if base is None:
        return None
    expected = policy.height_by_legs(sensors)
    if abs(base.height - expected) > share * abs(expected):
        return (
            f"the base is measured {base.height:.3f} m above the ground, and the legs say "
            f"{expected:.3f} m; check its unit and where it is measured from"
        )
    speed = float(np.linalg.norm(base.velocity))
    if speed > STANDS_STILL:
        return (
            f"the base of the standing robot is measured to move at {speed:.3g} m/s; check its unit"
        )
    return None


def posture_of(policy: DeployedPolicy, limits: Limits) -> Array:
    """The joint angles ``(12,)`` in which a robot is to stand before the policy drives [rad].

    They are the nominal ones, moved into the range of the initial states trained on, in which the
    legs may be bent further than in the nominal posture. They are always within the joint limits,
    whatever the policy's file says.

    Args:
        policy: The policy.
        limits: What the joints may do.
    """
    low, high = policy.start_range[:, 2:]
    known = np.isfinite(low) & np.isfinite(high)
    inside = INSIDE * np.where(known, high - low, 0.0)
    posture = np.clip(policy.nominal, low + inside, high - inside)
    return np.clip(posture, limits.low, limits.high)


def misfit_of(
    policy: DeployedPolicy, has_expert: bool, sensors: Sensors, config: RuntimeConfig
) -> str | None:
    """Why a policy must not take over from a standing robot; None if it may.

    Args:
        policy: The policy.
        has_expert: Whether an expert may take over from it.
        sensors: What the robot measures.
        config: How far height and angles may be off.
    """
    if policy.needs_base or has_expert:
        wrong = wrong_base_of(policy, sensors, config.height)
        if wrong is not None:
            return wrong
    angles = np.concatenate((roll_pitch(sensors.orientation), sensors.joint_position))
    low, high = policy.start_range
    beyond = np.maximum(low - angles, angles - high)
    worst = int(beyond.argmax())
    if beyond[worst] <= config.posture:
        return None
    name = ("roll", "pitch", *JOINTS)[worst]
    return (
        f"{name} is {angles[worst]:.3f} rad; the initial states trained on have "
        f"{low[worst]:.3f} to {high[worst]:.3f}"
    )
