"""At which commands of a box a gait walks, and the largest box that it can walk.

A gait walks a box if the robot stays up at nine tenths of the commands spread over it. If it does
not, each end of each axis is tried alone in five steps, and the box of the ends reached is shrunk
until the gait walks it. Next: `prepare`.
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
"""Factor by which a box is shrunk at a time, if the gait walks its ends but not its corners."""
TRIALS = 8
"""Maximum number of times that a box is shrunk."""
COMMANDS = 20
"""The number of commands at which a smaller box is tried."""
DIGITS = 2
"""The decimals of a box that is proposed; further ones are cut off."""


def walks_enough(up: BoolArray) -> bool:
    """Whether a gait walks a box, given ``(n,)`` True for the commands at which robots stay up."""
    return bool(up.mean() >= LEAST_SURVIVED)


def largest_box(robot: RobotModel, config: Config) -> CommandBox | None:
    """The largest box in the configured one that a gait walks; None if robots fall on the spot.

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


def box_in_words(box: CommandBox) -> str:
    """A box for messages, in the form of command-line options."""
    return " ".join(
        f"--{name} {low:g} {high:g}"
        for name, (low, high) in zip(("vx", "vy", "yaw-rate"), box.axes, strict=True)
    )


def _walked_ends(robot: RobotModel, config: Config) -> CommandBox:
    """The box of the parts of the axes that the gait walks, each end of each axis alone."""
    axes = np.array(config.commands.axes)
    command = np.zeros((3, 2, len(STEPS), 3))
    for axis in range(3):
        command[axis, :, :, axis] = np.outer(axes[axis], STEPS)
    up = _up(robot, config, command.reshape(-1, 3)).reshape(3, 2, len(STEPS))
    # Up to the first step at which the robot falls.
    steps = np.logical_and.accumulate(up, axis=2).sum(axis=2)
    walked = np.array([0.0, *STEPS])[steps] * axes
    # If an axis does not contain zero, its near end moves with the far one.
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
    """A smaller box about that command of a box which is nearest to zero, with few decimals."""
    axes = np.array(box.axes)
    center = np.clip(0.0, axes[:, :1], axes[:, 1:])
    reach = factor * (axes - center)
    # The small summand keeps 0.6, which may be 0.59999 as a float, from becoming 0.59.
    reach = np.trunc(reach * 10**DIGITS + 1e-6 * np.sign(reach)) / 10**DIGITS
    return _box(center + reach + 0.0)


def _box(axes: Array) -> CommandBox:
    """The box of three axes ``(3, 2)``."""
    vx, vy, yaw_rate = ((float(low), float(high)) for low, high in axes)
    return CommandBox(vx, vy, yaw_rate)
