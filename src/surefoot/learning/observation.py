"""What the policy sees: 42 numbers of the robot's state and 5 of its goal, as named slices.

Nothing in them tells where the robot is or which way is north: turning or shifting the whole robot
leaves every number unchanged. Positions and headings enter only relative to the robot itself.
The network's input is the observation followed by the goal.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from surefoot.rotations import to_heading
from surefoot.types import Array, IntArray, State

Float32Array = NDArray[np.float32]

OBSERVATION_SIZES = {
    "base_height": 1,
    "gravity": 3,
    "base_velocity": 6,
    "joint_position": 12,
    "joint_velocity": 12,
    "feet": 8,
}
"""Base height [m]; direction of gravity in the base frame; linear and angular velocity of the base
in its own frame [m/s, rad/s]; joint angles [rad] and rates [rad/s]; x, y of the four feet relative
to the centre of mass in the heading frame [m]."""

GOAL_SIZES = {"phase": 2, "command": 3}
"""Gait phase, as sine and cosine, or as a fraction of the period and a zero; vx, vy [m/s] and yaw
rate [rad/s] in the heading frame."""

Phase = Literal["circle", "fraction"]


def _slices(sizes: dict[str, int]) -> dict[str, slice]:
    """Consecutive slices of the given sizes."""
    ends = np.cumsum(list(sizes.values())).tolist()
    return {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


OBSERVATION = _slices(OBSERVATION_SIZES)
OBSERVATION_SIZE = sum(OBSERVATION_SIZES.values())
GOAL = _slices(GOAL_SIZES)
GOAL_SIZE = sum(GOAL_SIZES.values())
INPUT_SIZE = OBSERVATION_SIZE + GOAL_SIZE


def observe(state: State, out: Float32Array | None = None) -> Float32Array:
    """The observation of one robot, or of any batch of them.

    Args:
        state: with any leading axes.
        out: ``(..., 42)`` array to write into.

    Returns:
        ``(..., 42)`` float32, laid out as ``OBSERVATION``.
    """
    q, v = state.q, state.v
    if out is None:
        out = np.empty((*q.shape[:-1], OBSERVATION_SIZE), np.float32)
    feet = state.feet[..., :2] - state.com[..., None, :2]
    feet = to_heading(feet, state.heading[..., None, :])
    out[..., OBSERVATION["base_height"]] = q[..., 2:3]
    out[..., OBSERVATION["gravity"]] = -state.rotation[..., 2, :]
    out[..., OBSERVATION["base_velocity"]] = v[..., :6]
    out[..., OBSERVATION["joint_position"]] = q[..., 7:]
    out[..., OBSERVATION["joint_velocity"]] = v[..., 6:]
    out[..., OBSERVATION["feet"]] = feet.reshape(*q.shape[:-1], OBSERVATION_SIZES["feet"])
    return out


def goal(
    tick: IntArray | int,
    command: Array,
    period_ticks: int,
    phase: Phase = "circle",
    out: Float32Array | None = None,
) -> Float32Array:
    """The goal: where the gait is, and where to go.

    Args:
        tick: ``(...)`` gait clock [ms].
        command: ``(..., 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        period_ticks: gait period [ms].
        phase: as ``PolicyConfig.phase``.
        out: ``(..., 5)`` array to write into.

    Returns:
        ``(..., 5)`` float32, laid out as ``GOAL``; exactly periodic in ``tick``.
    """
    command = np.asarray(command)
    if out is None:
        shape = np.broadcast_shapes(np.shape(tick), command.shape[:-1])
        out = np.empty((*shape, GOAL_SIZE), np.float32)
    first, second = GOAL["phase"].start, GOAL["phase"].start + 1
    within = np.asarray(tick) % period_ticks
    if phase == "circle":
        angle = within * (2.0 * np.pi / period_ticks)
        out[..., first], out[..., second] = np.sin(angle), np.cos(angle)
    else:
        out[..., first], out[..., second] = within / period_ticks, 0.0
    out[..., GOAL["command"]] = command
    return out


def network_input(
    state: State,
    tick: IntArray | int,
    command: Array,
    period_ticks: int,
    phase: Phase = "circle",
    out: Float32Array | None = None,
) -> Float32Array:
    """``(..., 47)`` observation and goal side by side, as the network takes them.

    Args:
        state: with any leading axes.
        tick: ``(...)`` gait clock [ms].
        command: ``(..., 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        period_ticks: gait period [ms].
        phase: as ``PolicyConfig.phase``.
        out: ``(..., 47)`` array to write into.
    """
    if out is None:
        out = np.empty((*state.q.shape[:-1], INPUT_SIZE), np.float32)
    observe(state, out[..., :OBSERVATION_SIZE])
    goal(tick, command, period_ticks, phase, out[..., OBSERVATION_SIZE:])
    return out
