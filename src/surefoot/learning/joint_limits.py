"""The limits of a robot's joints, and the safety bounds of a policy, as in a policy's files.

Read ``policy_header.py`` for policy files, and `deploy.description` for exported ones.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from surefoot.types import JOINTS, Array

Pair = tuple[float, float]
"""The smallest and the largest value."""
MaybePair = tuple[float | None, float | None]
"""The smallest and the largest value; either may be unknown."""


@dataclass(frozen=True)
class JointLimits:
    """The limits of a robot's twelve joints, in the order of ``JOINTS``; None where unknown.

    Attributes:
        torque: ``(12,)`` largest torques [N m].
        speed: ``(12,)`` largest rates [rad/s].
        position: ``(12, 2)`` smallest and largest angles [rad].

    Raises:
        ValueError: One of them does not have twelve values.
    """

    torque: tuple[float | None, ...]
    speed: tuple[float | None, ...]
    position: tuple[MaybePair, ...]

    def __post_init__(self) -> None:
        """Check the numbers of joints."""
        for name in ("torque", "speed", "position"):
            _check_twelve(f"limits.{name}", getattr(self, name))


@dataclass(frozen=True)
class SafetyBounds:
    """The safety bounds that a policy was trained with; beyond them the expert took over.

    Attributes:
        com_height: Height of the center of mass above the ground [m].
        roll: Roll [rad].
        pitch: Pitch [rad].
        joints: ``(12, 2)`` joint angles [rad], in the order of ``JOINTS``.

    Raises:
        ValueError: There are not twelve joints, or a lower bound exceeds its upper bound.
    """

    com_height: Pair
    roll: Pair
    pitch: Pair
    joints: tuple[Pair, ...]

    def __post_init__(self) -> None:
        """Check the pairs."""
        _check_twelve("bounds.joints", self.joints)
        for low, high in (self.com_height, self.roll, self.pitch, *self.joints):
            if not -math.inf < low <= high < math.inf:
                raise ValueError(
                    f"bounds has {low} to {high}; the first must not exceed the second"
                )


def finite_or_none(values: Array) -> tuple[float | None, ...]:
    """Numbers ``(n,)`` as a tuple, with None in place of those that are not finite."""
    return tuple(value if math.isfinite(value) else None for value in values.tolist())


def _check_twelve(name: str, values: tuple[Any, ...]) -> None:
    """Check that there is a value for each joint.

    Raises:
        ValueError: There are fewer or more.
    """
    if len(values) != len(JOINTS):
        raise ValueError(f"{name} has {len(values)} values; use one for each of the 12 joints")
