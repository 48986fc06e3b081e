"""What was measured when a robot, a gait and a box of commands were prepared, as a record.

It lies in the file of the initial states that were made then, so that one file is all that a run
needs. `prepare` makes it; `starts` reads and writes it.
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
    """By how much the commands of a gait are scaled inside the planner, and what was measured.

    Attributes:
        gain: The gains of vx, vy and yaw rate, as `ExpertConfig.command_gain`.
        told: vx [m/s], vy [m/s] and yaw rate [rad/s] that the robots were told, each way.
        forward: The mean of each that was reached at the positive command, with gains of 1; where
            one came out large, with that gain, unless the robot then fell.
        backward: The mean of each that was reached at the negative command.
    """

    gain: Triple
    told: Triple
    forward: Triple
    backward: Triple


@dataclass(frozen=True)
class Followed:
    """What the expert made of one command, settled.

    Attributes:
        command: vx, vy [m/s] and yaw rate [rad/s] that the robot was told.
        velocity: The mean of each over whole gait periods.
        fell: Whether the robot fell; then the command has no initial states.
    """

    command: Triple
    velocity: Triple
    fell: bool = False


@dataclass(frozen=True)
class Preparation:
    """What a robot, a gait and a box of commands need besides their initial states.

    Attributes:
        key: SHA-256 of all that this depends on.
        description: SHA-256 of the robot's spec and of its URDF.
        commands: The box.
        gain: The command gains; what was reached is zero where they were given.
        safety: The bounds: the robot's own table, joined with what the settled gait needs.
        followed: What the expert made of each of the commands.
        seconds: How long it took to make [s].
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
        """The commands at which the robot stays up, but does not walk as it is told.

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
    """Three numbers of an array, rounded to four digits, as a configuration holds them."""
    x, y, z = (round(float(value), 4) + 0.0 for value in values)  # no negative zero
    return x, y, z


def text_of(preparation: Preparation) -> str:
    """The record as text, for a file."""
    return json.dumps(to_json(preparation), allow_nan=False)


def read_preparation(text: str) -> Preparation:
    """The record that a text holds.

    Raises:
        ValueError: It holds none.
    """
    return from_json(Preparation, parse_json(text.encode()), "prepared")
