"""The record of what was measured when a robot, a gait and a box of commands were prepared.

It is stored in the file of the initial states made then, so that a run needs only one file.
`prepare` makes it; `starts` reads and writes it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from surefoot.config import CommandBox, SafetyConfig
from surefoot.config.json_io import from_json, to_json
from surefoot.config.json_text import parse_json
from surefoot.types import Array

Triple = tuple[float, float, float]
"""vx [m/s], vy [m/s] and yaw rate [rad/s], or a factor of each."""
ASTRAY: Triple = (0.1, 0.1, 0.2)
"""Errors of vx [m/s], vy [m/s] and yaw rate [rad/s] that are small at any command."""


@dataclass(frozen=True)
class CommandGain:
    """The factors on the commands of a gait inside the planner, and how they were measured.

    Attributes:
        gain: The gains of vx, vy and yaw rate, as `ExpertConfig.command_gain`.
        told: vx [m/s], vy [m/s] and yaw rate [rad/s] that were commanded, each way.
        forward: The mean of each that was reached at the positive command, with gains of 1; if a
            gain came out large, with that gain, unless the robot then fell.
        backward: The mean of each that was reached at the negative command.
    """

    gain: Triple
    told: Triple
    forward: Triple
    backward: Triple


@dataclass(frozen=True)
class Followed:
    """How the expert followed one command in the settled gait.

    Attributes:
        command: The commanded vx, vy [m/s] and yaw rate [rad/s].
        velocity: The mean of each over whole gait periods.
        fell: Whether the robot fell; then the command has no initial states.
    """

    command: Triple
    velocity: Triple
    fell: bool = False


@dataclass(frozen=True)
class Preparation:
    """What a robot, a gait and a box of commands need in addition to their initial states.

    Attributes:
        key: SHA-256 of everything that the preparation depends on.
        description: SHA-256 of the robot's spec and of its URDF.
        commands: The box.
        gain: The command gains; if they were given, all velocities in them are zero.
        safety: The bounds: the robot's own table, widened to what the settled gait needs.
        followed: How the expert followed each command.
        seconds: How long the preparation took [s].
    """

    key: str
    description: str
    commands: CommandBox
    gain: CommandGain
    safety: SafetyConfig
    followed: tuple[Followed, ...]
    seconds: float

    @property
    def command_gain(self) -> Triple:
        """The gains of vx, vy and yaw rate."""
        return self.gain.gain

    @property
    def astray(self) -> tuple[Followed, ...]:
        """The commands at which the robot stays up but does not follow its command.

        There the mean velocity is off by more than half of the command, and by more than `ASTRAY`.
        """
        return tuple(
            each
            for each in self.followed
            if not each.fell
            and any(
                abs(reached - told) > max(least, 0.5 * abs(told))
                for reached, told, least in zip(each.velocity, each.command, ASTRAY, strict=True)
            )
        )

    @property
    def tracking_error(self) -> Triple:
        """The largest error of the mean vx, vy [m/s] and yaw rate [rad/s] of all commands."""
        up = [each for each in self.followed if not each.fell]
        vx, vy, yaw_rate = (
            max((abs(each.velocity[axis] - each.command[axis]) for each in up), default=0.0)
            for axis in range(3)
        )
        return vx, vy, yaw_rate


def rounded(values: Array) -> Triple:
    """Three numbers of an array, rounded to four decimals, as in a configuration."""
    x, y, z = (round(float(value), 4) + 0.0 for value in values)  # no negative zero
    return x, y, z


def text_of(preparation: Preparation) -> str:
    """The record as text, for a file."""
    return json.dumps(to_json(preparation), allow_nan=False)


def read_preparation(text: str) -> Preparation:
    """The record in a text.

    Raises:
        ValueError: The text is not a record.
    """
    return from_json(Preparation, parse_json(text.encode()), "prepared")
