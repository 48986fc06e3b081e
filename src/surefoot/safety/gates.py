"""When the expert takes over, and when a robot has failed: gates, blocking, falls, stalls.

A `Gate` calls states unsafe: `Bounds` by the paper's Table I, `AnyOf` if one of several does, and
those that are learned (``gates.py``). `SafetyMonitor` adds the blocking of Algorithm 4. `fallen`
ends an episode; `stepping` decides afterwards whether the robot kept walking. All array code over B
robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import Enum, IntEnum
from functools import lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np
from numba import njit

from surefoot.config import SafetyConfig
from surefoot.types import Array, BoolArray, IntArray, State, to_ticks

LEFT_RIGHT = np.array([1.0, -1.0, 1.0, -1.0])
FRONT_HIND = np.array([1.0, 1.0, -1.0, -1.0])
TROT_HEIGHT = 0.20
"""[m] of the centre of mass in the trot (BiConMP)."""


class Outcome(IntEnum):
    """How an episode ended. Failure is data: its id replays it."""

    SUCCESS = 0
    FELL = 1
    STALLED = 2
    DIVERGED = 3


class HandBack(Enum):
    """When the policy drives again after a takeover; the paper's text and code disagree."""

    EVERY_VIOLATION_RESTARTS = "every_violation_restarts"
    """T_block without a violation (Algorithm 4)."""
    SAFE_OR_BLOCKED = "safe_or_blocked"
    """Safe again, or T_block over (the paper's prose)."""
    SAFE_AND_BLOCKED = "safe_and_blocked"
    """Safe again, and at least T_block since the takeover (the paper's research code; "at least
    2 s" in the text)."""


def unsafe(state: State, config: SafetyConfig) -> BoolArray:
    """``(B,)`` True where a robot is outside the paper's Table I."""
    return _outside(state.com[:, 2], state.roll_pitch, state.q[:, 7:], *_table(config))


def margin(state: State, config: SafetyConfig, angle: float, height: float) -> Array:
    """``(n,)`` distance to the nearest bound of Table I, in units; negative outside.

    Args:
        state: of n robots.
        config: the bounds.
        angle: the unit of an angle [rad].
        height: the unit of the height [m].
    """
    low, high = _table(config)
    values = np.column_stack([state.com[:, 2], state.roll_pitch, state.q[:, 7:]])
    unit = np.append(height, np.full(len(low) - 1, angle))
    return (np.minimum(values - low, high - values) / unit).min(axis=1)


def fallen(state: State, config: SafetyConfig) -> BoolArray:
    """``(B,)`` True where base height, roll or pitch is that of a robot that has fallen."""
    no_joints = state.q[:, 7:7]
    return _outside(state.q[:, 2], state.roll_pitch, no_joints, *_fall_bounds(config))


@njit(cache=True)
def _outside(height: Array, roll_pitch: Array, joints: Array, low: Array, high: Array) -> BoolArray:
    """Where a number is outside its bounds, or none; compiled, because it is asked every tick."""
    result = np.empty(len(height), np.bool_)
    for robot in range(len(height)):
        inside = low[0] <= height[robot] <= high[0]
        for i in range(2):
            inside &= low[1 + i] <= roll_pitch[robot, i] <= high[1 + i]
        for i in range(joints.shape[1]):
            inside &= low[3 + i] <= joints[robot, i] <= high[3 + i]
        result[robot] = not inside
    return result


@lru_cache
def _fall_bounds(config: SafetyConfig) -> tuple[Array, Array]:
    """Bounds ``(3,)`` of the base's height [m], roll and pitch [rad]."""
    (low, high), angle = config.fall_height, np.radians(config.fall_angle)
    return np.array([low, -angle, -angle]), np.array([high, angle, angle])


@lru_cache
def _table(config: SafetyConfig) -> tuple[Array, Array]:
    """Bounds ``(15,)`` of the centre of mass's height [m], roll, pitch and the joints [rad]."""
    hip, thigh, knee = config.hip_abduction, config.hip_flexion, config.knee
    rows = [(-config.roll_pitch, config.roll_pitch)] * 2
    for side, end in zip(LEFT_RIGHT, FRONT_HIND, strict=True):
        for sign, bounds in ((side, hip), (end, thigh), (end, knee)):
            low, high = sorted(sign * bound for bound in bounds)
            rows.append((low, high))
    low, high = np.radians(rows).T
    return np.append(config.com_height[0], low), np.append(config.com_height[1], high)


class Gate(Protocol):
    """Says in which states the expert is needed (pi_safe, pi_safety)."""

    def reset(self, batch: int) -> None:
        """Forget everything; ``batch`` robots follow."""
        ...

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where a state is unsafe; called once a tick.

        Args:
            state: of B robots, as they measure it.
            tick: ``(B,)`` gait clock [ms].
            command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        """
        ...


class Bounds:
    """The paper's Table I."""

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config

    def reset(self, batch: int) -> None:
        """It has no memory."""

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """True outside the table."""
        return unsafe(state, self._config)


def tightened(config: SafetyConfig, share: float) -> SafetyConfig:
    """The bounds on height, roll and pitch moved towards a level trot; the joints keep theirs.

    Args:
        config: Table I.
        share: of the angles that is left, and of the height below that of the trot; 1 changes
            nothing.
    """
    low, high = config.com_height
    low = TROT_HEIGHT - share * (TROT_HEIGHT - low)
    return replace(config, com_height=(low, high), roll_pitch=share * config.roll_pitch)


class AnyOf:
    """Unsafe where one of several gates says so."""

    def __init__(self, gates: Sequence[Gate]) -> None:
        self._gates = gates

    def reset(self, batch: int) -> None:
        """For all of them."""
        for gate in self._gates:
            gate.reset(batch)

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """Every gate is asked at every tick, whatever the others say: they may remember."""
        return np.any([gate.unsafe(state, tick, command) for gate in self._gates], axis=0)


class SafetyMonitor:
    """Says who drives: the expert from a violation on, until the hand-back rule lets go.

    Args:
        gate: says which states are unsafe.
        block: T_block [s]; 0 hands back as soon as the state is safe (Algorithm 2).
        hand_back: the rule that ends a block.
    """

    def __init__(
        self, gate: Gate, block: float, hand_back: HandBack = HandBack.SAFE_AND_BLOCKED
    ) -> None:
        self._gate = gate
        self._block = to_ticks(block)
        self._hand_back = HandBack(hand_back)
        self.reset(0)

    def reset(self, batch: int) -> None:
        """No robot of ``batch`` is blocked."""
        self._gate.reset(batch)
        self._blocked_for, self._anyone = np.full(batch, -1), False

    def blocking(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the expert must drive during this tick; call once a tick.

        The arguments are those of `Gate.unsafe`.
        """
        violation = self._gate.unsafe(state, tick, command)
        if not self._anyone and not violation.any():
            return violation
        clock = np.where(self._blocked_for >= 0, self._blocked_for + 1, -1)
        if self._hand_back is HandBack.EVERY_VIOLATION_RESTARTS:
            clock[violation] = 0
        if self._hand_back is HandBack.SAFE_OR_BLOCKED:
            release = (clock >= 0) & (~violation | (clock >= self._block))
        else:
            release = ~violation & (clock >= self._block)
        clock[release] = -1
        clock[violation & (clock < 0) & ~release] = 0
        self._blocked_for, blocked = clock, clock >= 0
        self._anyone = bool(blocked.any())
        return blocked


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
