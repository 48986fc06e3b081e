"""How an episode ends: falls, and whether a robot kept stepping.

`fallen` ends an episode; `stepping` decides afterwards whether the robot kept walking. All array
code over B robots.
"""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache
from itertools import pairwise

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.safety.gates import outside
from surefoot.types import Array, BoolArray, IntArray, State


class Outcome(IntEnum):
    """How an episode ended. Failure is data: its id replays it."""

    SUCCESS = 0
    FELL = 1
    STALLED = 2
    DIVERGED = 3


def fallen(state: State, config: SafetyConfig) -> BoolArray:
    """``(B,)`` True where base height, roll or pitch is that of a robot that has fallen."""
    no_joints = state.q[:, 7:7]
    return outside(state.q[:, 2], state.roll_pitch, no_joints, *_fall_bounds(config))


@lru_cache
def _fall_bounds(config: SafetyConfig) -> tuple[Array, Array]:
    """Bounds ``(3,)`` of the base's height [m], roll and pitch [rad]."""
    (low, high), angle = config.fall_height, np.radians(config.fall_angle)
    return np.array([low, -angle, -angle]), np.array([high, angle, angle])


def stepping(feet_height: Array, contacts: BoolArray, foot_radius: float) -> BoolArray:
    """``(B,)`` True where a robot kept stepping for two thirds of an episode (paper, IV-F).

    The earliest of the four feet's last touchdowns lies at or after 2/3 of the episode.

    Args:
        feet_height: ``(B, T, 4)`` height of the foot centres above the ground [m].
        contacts: ``(B, T, 4)`` foot contacts.
        foot_radius: [m].
    """
    last = np.array(
        [
            [
                touchdowns(feet_height[b, :, leg] - foot_radius, contacts[b, :, leg])[-1:].max(
                    initial=-1
                )
                for leg in range(4)
            ]
            for b in range(len(contacts))
        ]
    )
    return last.min(axis=1) >= 2 * contacts.shape[1] / 3


def strictly_stepping(
    feet_height: Array, contacts: BoolArray, foot_radius: float, period: int
) -> BoolArray:
    """``(B,)`` True where every foot touches down in every window of 1.5 gait periods.

    Over at least two thirds of the episode; reported beside `stepping`.
    """
    T = contacts.shape[1]
    window = 3 * period // 2
    result = np.zeros(len(contacts), dtype=bool)
    for b in range(len(contacts)):
        busy = np.ones(T, dtype=bool)
        for leg in range(4):
            down = touchdowns(feet_height[b, :, leg] - foot_radius, contacts[b, :, leg])
            edges = np.concatenate([[-1], down, [T]])
            for start, end in pairwise(edges):
                if end - start > window:
                    busy[start + 1 : end] = False
        result[b] = busy.mean() >= 2 / 3
    return result


AIRBORNE, CLEARANCE, GROUNDED = 40, 0.005, 20
"""A touchdown: 40 ms without contact, at least 5 mm of clearance in them, 20 ms of contact."""


def touchdowns(clearance: Array, contact: BoolArray) -> IntArray:
    """Ticks at which one foot touches down for good.

    A trembling foot of a standing robot passes anything weaker than the rule above.

    Args:
        clearance: ``(T,)`` height of the foot sphere above the ground [m].
        contact: ``(T,)`` foot contact.
    """
    edges = np.flatnonzero(np.diff(contact.astype(np.int8)))
    starts = np.concatenate([[0], edges + 1])
    ends = np.concatenate([edges + 1, [len(contact)]])
    found = []
    swung = False
    for start, end in zip(starts, ends, strict=True):
        if contact[start]:
            if swung and end - start >= GROUNDED:
                found.append(start)
                swung = False
        else:
            # A bounce shorter than a touchdown does not undo the swing before it.
            long = end - start >= AIRBORNE and clearance[start:end].max() >= CLEARANCE
            swung = swung or long
    return np.array(found, dtype=np.int64)
