"""Gates: which states are unsafe, so that the expert has to drive.

A `Gate` is asked once a tick about B robots. `Bounds` applies the paper's Table I, `AnyOf` combines
several gates, and learned gates are in ``learned.py``. `unsafe` and `margin` apply the table as
plain functions. Read ``monitor.py`` next, which adds the blocking of Algorithm 4; `robots.bounds`
has the arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Protocol

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.config.checked import known
from surefoot.robots.bounds import outside, table_bounds
from surefoot.types import Array, BoolArray, IntArray, State, one_flag_each


class Gate(Protocol):
    """Says which states are unsafe, so that the expert has to drive."""

    def reset(self, batch: int) -> None:
        """Forget everything and be ready for ``batch`` robots."""
        ...

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where a state is unsafe; called once a tick.

        Args:
            state: States of B robots: without noise in training, and otherwise as the robots
                measure them.
            tick: ``(B,)`` gait clock [ms].
            command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        """
        ...


class Bounds:
    """The gate of the safety bounds, which are the paper's Table I for Solo12.

    Args:
        config: The bounds.
    """

    def __init__(self, config: SafetyConfig) -> None:
        self._config = config
        table_bounds(config)  # refuses a table with missing values at once

    def reset(self, batch: int) -> None:
        """Do nothing: this gate has no memory."""

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where a robot is outside the table."""
        return unsafe(state, self._config)


class AnyOf:
    """The gate that calls a state unsafe if one of several gates does.

    Args:
        gates: The gates, at least one.

    Raises:
        ValueError: There are no gates.
    """

    def __init__(self, gates: Iterable[Gate]) -> None:
        self._gates = tuple(gates)
        if not self._gates:
            raise ValueError("no gates; give at least one")

    def reset(self, batch: int) -> None:
        """Reset all of them."""
        for gate in self._gates:
            gate.reset(batch)

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where any gate says so. Every gate is asked, since it may have a memory.

        Raises:
            ValueError: The answer of a gate is not a boolean array ``(B,)``.
        """
        B = len(tick)
        answers = [
            one_flag_each(gate.unsafe(state, tick, command), B, gate) for gate in self._gates
        ]
        return np.any(answers, axis=0)


def unsafe(state: State, config: SafetyConfig) -> BoolArray:
    """``(B,)`` True where a robot is outside the safety bounds.

    Args:
        state: States of B robots.
        config: The bounds.
    """
    low, high = table_bounds(config)
    return outside(state.com[:, 2], state.q, low, high)


def margin(state: State, config: SafetyConfig, angle: float, height: float) -> Array:
    """``(B,)`` distance of each robot to the nearest safety bound, negative outside.

    Distances to bounds on angles and on the height are made comparable by a unit for each: a margin
    of 1 is ``angle`` away from a bound on an angle, or ``height`` away from one on the height.

    Args:
        state: States of B robots.
        config: The bounds.
        angle: Unit of the distance to a bound on an angle [rad].
        height: Unit of the distance to a bound on the height [m].
    """
    distance = distances(state, config)
    unit = np.append(height, np.full(distance.shape[1] - 1, angle))
    return (distance / unit).min(axis=1)


def distances(state: State, config: SafetyConfig) -> Array:
    """``(B, 15)`` distance of each quantity of Table I to its nearer bound, negative outside.

    The quantities are the height of the center of mass [m], roll, pitch and the twelve joints
    [rad].

    Args:
        state: States of B robots.
        config: The bounds.
    """
    low, high = table_bounds(config)
    values = np.column_stack([state.com[:, 2], state.roll_pitch, state.q[:, 7:]])
    return np.minimum(values - low, high - values)


def tightened(config: SafetyConfig, share: float, height: float) -> SafetyConfig:
    """The table with height, roll and pitch moved towards a level gait; joints keep their bounds.

    It is never tighter than the settled gait needs, where that is known, nor wider than the table.

    Args:
        config: The bounds.
        share: How much is left of the angles, and of the distance from the gait's height down to
            its lower bound; 1 changes nothing.
        height: Height of the center of mass in the gait [m].
    """
    low, high = known(config.com_height, "safety.com_height")
    low = height - share * (height - low)
    tilt = share * known(config.roll_pitch, "safety.roll_pitch")
    if config.settled is not None:
        own_low, _ = known(config.com_height, "safety.com_height")
        lowest, farthest = config.settled
        low = min(low, max(lowest, own_low))
        tilt = max(tilt, min(farthest, known(config.roll_pitch, "safety.roll_pitch")))
    return replace(config, com_height=(low, high), roll_pitch=tilt)
