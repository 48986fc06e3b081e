"""How an episode ends: falls, and whether a robot kept stepping.

`Falls` ends an episode; `stepping` decides afterwards whether the robot kept walking (paper,
IV-F). All of it is array code over B robots. Read `engine` next for where they are called.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from itertools import pairwise

import numpy as np

from surefoot.config import Gait, SafetyConfig
from surefoot.mpc.schedule import stands
from surefoot.robots.bounds import fallen
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray, State, to_ticks

AIRBORNE = 40
"""[ms] A foot without contact for this long may have swung."""
CLEARANCE = 0.005
"""[m] A foot that rose this high above the ground in that time has swung."""
GROUNDED = 20
"""[ms] A foot in contact for this long after it swung has touched down."""


class Outcome(IntEnum):
    """How an episode ended. A failure is data: it can be replayed from the episode's id."""

    SUCCESS = 0
    FELL = 1
    STALLED = 2
    DIVERGED = 3


def failed(outcome: IntArray) -> BoolArray:
    """``(n,)`` True for robots that fell, or that the expert gave up on."""
    return (outcome == Outcome.FELL) | (outcome == Outcome.DIVERGED)


class Falls:
    """Judges tick by tick which of B robots have fallen, from `SafetyConfig.grace` on.

    A robot has fallen where its base's height, roll or pitch is out of bounds, and where something
    other than a foot has been on the ground for `SafetyConfig.body_contact`.

    Args:
        safety: The bounds.
        batch: The number of robots B.
    """

    def __init__(self, safety: SafetyConfig, batch: int) -> None:
        self._safety = safety
        self._grace = to_ticks(safety.grace)
        # A time shorter than one tick counts as one tick.
        self._most_lying = max(to_ticks(safety.body_contact), 1) if safety.body_contact else None
        # The number of consecutive ticks of contact.
        self._lying = np.zeros(batch, np.int64)

    def reset(self, rows: BoolArray) -> None:
        """Forget the contacts of the robots ``(B,)`` that begin an episode."""
        self._lying[rows] = 0

    def judge(self, state: State, touching: BoolArray, elapsed: IntArray | int) -> BoolArray:
        """Count another tick; return ``(B,)`` True where a robot has fallen.

        Args:
            state: The states of B robots, with heights above their ground.
            touching: ``(B,)`` True where something other than a foot touches the ground.
            elapsed: The number of ticks since the episodes began, or ``(B,)`` that of each robot.
        """
        if self._most_lying is not None:
            self._lying = np.where(touching, self._lying + 1, 0)
        judged = elapsed >= self._grace
        if not np.count_nonzero(judged):
            return np.zeros(len(touching), bool)
        lost = fallen(state.q, self._safety)
        if self._most_lying is not None:
            lost |= self._lying >= self._most_lying
        return lost & judged


def judged_from(safety: SafetyConfig, *gaits: Gait) -> float | None:
    """The shortest duration of an episode that is judged for stepping [s]; None if none is.

    Three periods and touchdowns are long enough for every foot of a perfect gait to touch down in
    the last third.

    Args:
        safety: The shortest duration that is judged, whatever the gait.
        gaits: The gaits that robots may walk in the episode. The slowest one decides; a gait that
            stands does not count (see `never_standing`).
    """
    periods = [to_ticks(gait.period) for gait in gaits if not stands(gait)]
    if safety.stepping_from is None or not periods:
        return None
    period = max(periods)
    return max(safety.stepping_from, 3 * (period + GROUNDED) / TICKS_PER_SECOND)


def never_standing(gaits: Sequence[Gait], walked: IntArray) -> BoolArray:
    """``(B,)`` True for robots that never walk a gait that stands, and so have to keep stepping.

    Args:
        gaits: The gaits, in the order of their numbers; empty if unknown, and then all robots have
            to step.
        walked: ``(B, T)`` the number of the gait that each robot is to walk, tick by tick.
    """
    standing = [number for number, gait in enumerate(gaits) if stands(gait)]
    return np.asarray(np.isin(walked, standing, invert=True).all(axis=1))


def stepping(feet_height: Array, contacts: BoolArray, foot_radius: float) -> BoolArray:
    """``(B,)`` True where a robot kept stepping for two thirds of an episode (paper, IV-F).

    The earliest of the four feet's last touchdowns lies at or after 2/3 of the episode.

    Args:
        feet_height: ``(B, T, 4)`` height of the foot centers above the ground [m].
        contacts: ``(B, T, 4)`` foot contacts.
        foot_radius: Radius of the foot spheres [m].
    """
    B, T, _ = contacts.shape
    last = np.full((B, 4), -1)
    for b in range(B):
        for leg in range(4):
            down = touchdowns(feet_height[b, :, leg] - foot_radius, contacts[b, :, leg])
            if len(down):
                last[b, leg] = down[-1]
    return last.min(axis=1) >= 2 * T / 3


def strictly_stepping(
    feet_height: Array, contacts: BoolArray, foot_radius: float, period: IntArray | int
) -> BoolArray:
    """``(B,)`` True where every foot touches down in every window of 1.5 gait periods.

    The robot has to do so for at least two thirds of the episode. This rule is stricter than
    `stepping`; it is only reported, and decides nothing.

    Args:
        feet_height: ``(B, T, 4)`` height of the foot centers above the ground [m].
        contacts: ``(B, T, 4)`` foot contacts.
        foot_radius: Radius of the foot spheres [m].
        period: The gait period [ms], or ``(B,)`` that of each robot.
    """
    T = contacts.shape[1]
    windows = 3 * np.broadcast_to(period, len(contacts)) // 2
    result = np.zeros(len(contacts), dtype=bool)
    for b in range(len(contacts)):
        busy = np.ones(T, dtype=bool)
        window = int(windows[b])
        for leg in range(4):
            down = touchdowns(feet_height[b, :, leg] - foot_radius, contacts[b, :, leg])
            edges = np.concatenate([[-1], down, [T]])
            for start, end in pairwise(edges):
                if end - start > window:
                    busy[start + 1 : end] = False
        result[b] = busy.mean() >= 2 / 3
    return result


def heights_of_swings(feet: Array, contacts: BoolArray, foot_radius: float) -> Array:
    """The heights of feet above uneven ground, ``(B, T, 4)`` [m], without a map of it.

    Below a swing, the ground is taken as the straight line between the two places that the swing
    connects. A foot in contact is on the ground, and so is one that never touches it.

    Args:
        feet: ``(B, T, 4, 3)`` the foot centers, world frame [m].
        contacts: ``(B, T, 4)`` foot contacts.
        foot_radius: Radius of the foot spheres [m].
    """
    T = contacts.shape[1]
    heights = np.full(contacts.shape, foot_radius)
    for b, leg in np.ndindex(len(contacts), contacts.shape[2]):
        for start, end in airborne(contacts[b, :, leg]):
            if end - start == T:
                continue
            path = feet[b, start:end, leg]
            # A swing at either end of the episode has only one such place, which serves for both.
            first = feet[b, start - 1 if start > 0 else end, leg]
            last = feet[b, end if end < T else start - 1, leg]
            way = last[:2] - first[:2]
            square = max(float(way @ way), 1e-12)
            share = np.clip((path[:, :2] - first[:2]) @ way / square, 0.0, 1.0)
            ground = first[2] + share * (last[2] - first[2])
            heights[b, start:end, leg] += path[:, 2] - ground
    return heights


def airborne(contact: BoolArray) -> list[tuple[int, int]]:
    """The first tick of each interval in which one foot is in the air, and the tick after its last.

    Args:
        contact: ``(T,)`` foot contact.
    """
    padded = np.concatenate([[True], contact, [True]])
    edges = np.flatnonzero(np.diff(padded.astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def touchdowns(clearance: Array, contact: BoolArray) -> IntArray:
    """Ticks at which one foot touches down after a swing.

    A swing is `AIRBORNE` ticks without contact that reach `CLEARANCE`, and a touchdown is
    `GROUNDED` ticks of contact after it. The trembling feet of a standing robot would pass any
    weaker rule.

    Args:
        clearance: ``(T,)`` height of the foot sphere above the ground [m].
        contact: ``(T,)`` foot contact.
    """
    edges = np.flatnonzero(np.diff(contact.astype(np.int8)))
    starts = np.concatenate([[0], edges + 1])
    ends = np.concatenate([edges + 1, [len(contact)]])
    ticks = []
    swung = False
    for start, end in zip(starts, ends, strict=True):
        if contact[start]:
            if swung and end - start >= GROUNDED:
                ticks.append(start)
                swung = False
        else:
            # A bounce shorter than a touchdown does not undo the swing before it.
            long = end - start >= AIRBORNE
            swung = swung or (long and clearance[start:end].max() >= CLEARANCE)
    return np.array(ticks, dtype=np.int64)
