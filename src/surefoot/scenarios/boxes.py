"""Which commands of a box a gait walks, and the largest box that it does walk.

A box is walked if the robot stays up at nine tenths of the commands that are spread over it. Where
it does not, each end of each axis is tried alone in five steps, and the box of the ends that are
walked is made smaller until it is. Next: `prepare`.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import CommandBox, Config
from surefoot.robots.model import RobotModel
from surefoot.scenarios.make import SURVIVED
from surefoot.scenarios.walking import expert_walks
from surefoot.types import Array, BoolArray, to_ticks

LEAST_SURVIVED = 0.9
"""The share of a box's commands at which a robot has to stay up."""
STEPS = (0.2, 0.4, 0.6, 0.8, 1.0)
"""The shares of an axis that are tried."""
SHRUNK = 0.8
"""A box whose ends are walked, but whose corners are not, is made so much smaller at a time."""
TRIALS = 8
"""The most times a box is shrunk."""
COMMANDS = 20
"""The number of commands at which a smaller box is tried."""
DIGITS = 2
"""The decimals of a box that is proposed; they are cut off."""


def walks_enough(up: BoolArray) -> bool:
    """Whether a gait walks a box, where ``(n,)`` robots are up at its commands."""
    return bool(up.mean() >= LEAST_SURVIVED)


def largest_box(robot: RobotModel, config: Config) -> CommandBox | None:
    """The largest box that a gait walks within the configured one; None if it does not even stand.

    Args:
        robot: The robot.
        config: The gait, the expert, the commands, the simulator and the fall bounds.
    """
    box = _walked_ends(robot, config)
    for _ in range(TRIALS):
        if walks_enough(_up(robot, config, box.spread(COMMANDS))):
            return box
        box = _times(box, SHRUNK)
    zero = CommandBox((0.0, 0.0))
    return zero if walks_enough(_up(robot, config, zero.spread(1))) else None


def describe(box: CommandBox) -> str:
    """A box for messages, as options of a command."""
    return " ".join(
        f"--{name} {low:g} {high:g}"
        for name, (low, high) in zip(("vx", "vy", "yaw-rate"), box.axes, strict=True)
    )


def _walked_ends(robot: RobotModel, config: Config) -> CommandBox:
    """The box of those parts of the ends of the axes that are walked, each one alone."""
    axes = np.array(config.commands.axes)
    command = np.zeros((3, 2, len(STEPS), 3))
    for axis in range(3):
        command[axis, :, :, axis] = np.outer(axes[axis], STEPS)
    up = _up(robot, config, command.reshape(-1, 3)).reshape(3, 2, len(STEPS))
    # Up to the first step at which the robot falls.
    steps = np.logical_and.accumulate(up, axis=2).sum(axis=2)
    walked = np.array([0.0, *STEPS])[steps] * axes
    # An end on the far side of zero moves with the other one.
    low = np.minimum(walked[:, 0], walked[:, 1])
    high = np.maximum(walked[:, 0], walked[:, 1])
    low = np.where(axes[:, 0] > 0.0, np.minimum(axes[:, 0], high), low)
    high = np.where(axes[:, 1] < 0.0, np.maximum(axes[:, 1], low), high)
    return _times(_box(np.column_stack([low, high])), 1.0)


def _up(robot: RobotModel, config: Config, command: Array) -> BoolArray:
    """``(n,)`` True where a robot stays up at a command for three seconds."""
    walks = expert_walks(robot, config, command, to_ticks(SURVIVED), 10)
    return ~walks.lost(config.safety)


def _times(box: CommandBox, factor: float) -> CommandBox:
    """A smaller box about the commands of a box that are the nearest to zero, in few decimals."""
    axes = np.array(box.axes)
    center = np.clip(0.0, axes[:, :1], axes[:, 1:])
    reach = factor * (axes - center)
    # Of 0.6, which is 0.59999 as a number, no hundredth is cut off.
    reach = np.trunc(reach * 10**DIGITS + 1e-6 * np.sign(reach)) / 10**DIGITS
    return _box(center + reach + 0.0)


def _box(axes: Array) -> CommandBox:
    """The box of three axes ``(3, 2)``."""
    vx, vy, yaw_rate = ((float(low), float(high)) for low, high in axes)
    return CommandBox(vx, vy, yaw_rate)
