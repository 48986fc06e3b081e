"""Reads hardware profiles, and says which states lie within one.

Read `config.profiles` for what a profile is, and `rollouts.latching` for which robots would have
switched themselves off in an episode.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surefoot.config.profiles import PROFILES, HardwareProfile
from surefoot.errors import unknown
from surefoot.robots.data_file import SUFFIXES, read_data_file
from surefoot.types import JOINTS, LEGS, TICKS_PER_SECOND, Array, BoolArray

MOST_BYTES = 100_000
"""[B] No file with a profile is larger."""


def load_profile(which: str, robot: str) -> HardwareProfile:
    """Load the profile of a robot.

    Args:
        which: The name of a profile of the package, or a JSON or TOML file with one.
        robot: The name of the robot that it has to belong to.

    Raises:
        ValueError: There is no such profile or file, it belongs to another robot, or it takes
            commands at another rate.
    """
    if which in PROFILES:
        profile = PROFILES[which]
    elif which.lower().endswith(SUFFIXES):
        profile = read_data_file(Path(which), HardwareProfile, MOST_BYTES, "hardware profile")
    else:
        raise ValueError(
            f"{unknown('profile', which, PROFILES)}; a profile of your own is a "
            f"{' or '.join(SUFFIXES)} file"
        )
    return checked_profile(profile, robot)


def checked_profile(profile: HardwareProfile, robot: str) -> HardwareProfile:
    """Return a profile, if it belongs to the robot, and policies can drive at its rate.

    Args:
        profile: The profile.
        robot: The name of the robot that it has to belong to.

    Raises:
        ValueError: It belongs to another robot, or takes commands at another rate.
    """
    if profile.robot != robot:
        raise ValueError(
            f"the hardware profile {profile.name!r} belongs to the robot {profile.robot}, not to "
            f"{robot}; name a profile of {robot}, or write one in a {' or '.join(SUFFIXES)} file"
        )
    if profile.rate != TICKS_PER_SECOND:
        raise ValueError(
            f"the hardware profile {profile.name!r} takes commands at {profile.rate} Hz, but "
            f"policies and simulations run at {TICKS_PER_SECOND} Hz: set its rate to "
            f"{TICKS_PER_SECOND} if the robot takes them so often, or leave the profile out"
        )
    return profile


def check_standing(profile: HardwareProfile, joints: Array, robot: str) -> None:
    """Check that a robot may stand within its profile.

    Args:
        profile: The profile.
        joints: ``(12,)`` the joint angles of the standing robot [rad].
        robot: The name of the robot.

    Raises:
        ValueError: A joint of the standing robot is not within its range, so that the robot would
            latch before it walks.
    """
    outside = [
        f"{joint} stands at {angle:.3g} rad, and may have {low:g} to {high:g} rad"
        for joint, angle, (low, high) in zip(JOINTS, joints, position_limits(profile), strict=True)
        if not low < angle < high
    ]
    if outside:
        raise ValueError(
            f"{robot} cannot stand within the hardware profile {profile.name!r}: "
            f"{'; '.join(outside)}. Correct position_limit: radians, with the zeros and signs that "
            f"`surefoot robot {robot}` shows; give the ranges of all {len(JOINTS)} joints where "
            "those of the legs differ"
        )


def torque_limits(profile: HardwareProfile) -> Array:
    """The torque limits ``(12,)`` of a profile [N m]."""
    return np.tile(profile.torque_limit, len(LEGS))


def speed_limits(profile: HardwareProfile) -> Array:
    """The speed limits ``(12,)`` of a profile [rad/s]."""
    return np.tile(profile.speed_limit, len(LEGS))


def position_limits(profile: HardwareProfile) -> Array:
    """The smallest and the largest angle of each joint ``(12, 2)`` of a profile [rad]."""
    ranges = np.array(profile.position_limit)
    return ranges if len(ranges) == 3 * len(LEGS) else np.tile(ranges, (len(LEGS), 1))


def beyond_range(limits: Array, q: Array) -> BoolArray:
    """``(...)`` True where a joint is beyond its range.

    Args:
        limits: ``(12, 2)`` smallest and largest angle of each joint [rad].
        q: ``(..., 19)`` configurations.
    """
    low, high = limits.T
    joints = q[..., 7:]
    return np.asarray(((joints < low) | (joints > high)).any(axis=-1))


def beyond_speed(profile: HardwareProfile, v: Array) -> BoolArray:
    """``(...)`` True where a joint is faster than the profile allows.

    Args:
        profile: The profile.
        v: ``(..., 18)`` velocities.
    """
    return np.asarray((np.abs(v[..., 6:]) > speed_limits(profile)).any(axis=-1))
