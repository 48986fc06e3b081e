"""What an exported file says of its joints, in words, for `check` and for the cards beside files.

Joints differ: a knee often has another torque limit than a hip. So a text has one number only where
all twelve joints have the same one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from surefoot.types import JOINTS, LEGS

if TYPE_CHECKING:
    from surefoot.deploy.description import PolicyDescription

ANY = "any"
"""Takes the place of a limit that a joint does not have."""
LEG_JOINTS = len(JOINTS) // len(LEGS)


def each_joint(values: Sequence[float | str | None], unit: str) -> str:
    """A value of each joint with its unit, as short as it can be without leaving one out.

    Args:
        values: ``(12,)`` the values, numbers or texts; None for a joint without one.
        unit: Their unit.

    Returns:
        One value if all joints have the same, those of a leg if all legs are alike, and otherwise
        those of each kind of leg.
    """
    texts = [_shown(value) for value in values]
    if len(set(texts)) == 1:
        return f"{texts[0]} {unit}"
    alike: dict[str, list[str]] = {}
    for number, leg in enumerate(LEGS):
        first = number * LEG_JOINTS
        alike.setdefault(", ".join(texts[first : first + LEG_JOINTS]), []).append(leg)
    if len(alike) == 1:
        return f"{next(iter(alike))} {unit} for the joints of a leg"
    legs = "; ".join(f"{text} ({' '.join(names)})" for text, names in alike.items())
    return f"{legs} {unit} for the joints of a leg"


def limits_in_words(description: PolicyDescription) -> tuple[str, str, str]:
    """The limits of torque, speed and angle in an exported file, a phrase each.

    Args:
        description: What the file says.
    """
    ranges = description.position_limit
    torque = f"torque at most {each_joint(description.torque_limit, 'N m')}"
    speed = "speed without a limit"
    if set(description.speed_limit) != {None}:
        speed = f"speed at most {each_joint(description.speed_limit, 'rad/s')}"
    angles = "angles without a limit"
    if set(ranges) != {(None, None)}:
        texts = [
            None if pair == (None, None) else f"{_shown(pair[0])} to {_shown(pair[1])}"
            for pair in ranges
        ]
        angles = f"angles {each_joint(texts, 'rad')}"
    return torque, speed, angles


def _shown(value: float | str | None) -> str:
    """A value as text."""
    if value is None:
        return ANY
    return value if isinstance(value, str) else f"{value:.5g}"
