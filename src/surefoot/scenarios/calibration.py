"""Measures command gains: a gait reaches only a share of what is planned, so more is planned.

Six robots walk for three seconds from standing, each at one command along one axis, both ways; the
gain of an axis is the planned velocity over the reached one. Biases that do not depend on the
direction cancel. A gait that reaches little is measured once more, with the gain. If the robot then
falls, the first gain stays, and `prepare` finds out at which commands it walks with that. Next:
`surefoot.scenarios.walking`, and `surefoot.mpc.footholds`, where the gains are used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surefoot.config import CommandBox, Config, Gait
from surefoot.config.gait_table import gait_name
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios.preparation import CommandGain, rounded
from surefoot.scenarios.walking import GaitError, Walks, expert_walks
from surefoot.types import Array, BoolArray, to_ticks

SECONDS = 3.0
"""[s] How long the robots walk."""
SETTLED = 1.0
"""[s] Time from which on their velocity counts."""
TRIED = (0.2, 0.15, 0.5)
"""[m/s, m/s, rad/s] vx, vy and yaw rate commanded to a robot of Solo12's size, or less if the box
is narrower."""
LEAST_TRIED = 0.25
"""The least share of `TRIED` that is commanded, however narrow the box: with less, the sway of the
gait would distort the result."""
LEAST_SHARE = 0.4
"""A gait that reaches a smaller share of what is planned does not follow its commands."""
FAR = 1.5
"""A larger gain is measured again, with the gain applied: a gait that reaches so little does not
respond in proportion to the command."""


@dataclass(frozen=True)
class _Reached:
    """How far six robots followed their commands, along vx, vy and yaw rate.

    Attributes:
        told: ``(3,)`` the command along each axis; its opposite was commanded, too.
        forward: ``(3,)`` the velocity reached at that command.
        backward: ``(3,)`` the velocity reached at its opposite.
        up: ``(3,)`` True where neither robot fell.
    """

    told: Array
    forward: Array
    backward: Array
    up: BoolArray

    @property
    def share(self) -> Array:
        """``(3,)`` the share of the command that was reached, without biases."""
        return (self.forward - self.backward) / (2 * self.told)

    @property
    def usable(self) -> BoolArray:
        """``(3,)`` True where the robots stayed up and followed their commands."""
        return self.up & (self.share >= LEAST_SHARE)

    def where_usable(self, other: _Reached) -> _Reached:
        """These measurements, with those of another time along axes that are not usable."""
        return replace(
            self,
            forward=np.where(self.usable, self.forward, other.forward),
            backward=np.where(self.usable, self.backward, other.backward),
            up=np.where(self.usable, self.up, other.up),
        )


def calibrate_command_gain(
    robot: RobotModel, gait: Gait, config: Config, scale: float = 1.0
) -> CommandGain:
    """Measure the command gains of a robot and a gait; takes a few seconds.

    Along an axis that is closed at zero in `config.commands`, the robot may fall or not move at
    all; the gain is then 1.

    Args:
        robot: The robot.
        gait: The gait, which must not be one that stands.
        config: The expert, whose own gains are ignored, the commands, the simulator and the fall
            bounds.
        scale: The robot's leg length over Solo12's.

    Raises:
        GaitError: A robot fell with gains of 1, or reached too little of what was planned; the
            message has the numbers.
    """
    config = with_own_values(replace(config, gait=gait), robot)
    name = gait_name(gait)
    needed = needed_axes(config.commands)
    told = told_commands(config.commands, scale)
    gain = np.ones(3)
    walks = _walks(robot, config, told, gain)
    walks.of(np.tile(needed, 2)).check(config.safety, name)
    reached = _reached(walks, config)
    _check_moved(reached, needed, name)
    gain = 1.0 / np.where(reached.usable, reached.share, 1.0)
    if gain.max() > FAR:
        again = _reached(_walks(robot, config, told, gain), config)
        gain = gain / np.where(again.usable, again.share, 1.0)
        reached = again.where_usable(reached)
    return CommandGain(
        rounded(gain), rounded(told), rounded(reached.forward), rounded(reached.backward)
    )


def told_commands(box: CommandBox, scale: float) -> Array:
    """``(3,)`` the commands in a measurement of gains: vx, vy [m/s] and yaw rate [rad/s].

    Args:
        box: The commands that they are to follow.
        scale: The robot's leg length over Solo12's.
    """
    tried = np.array(TRIED) * (np.sqrt(scale), np.sqrt(scale), 1.0)
    ends = np.abs(box.axes).max(axis=1)
    return np.where(ends > 0.0, np.clip(ends, LEAST_TRIED * tried, tried), tried)


def needed_axes(box: CommandBox) -> BoolArray:
    """``(3,)`` True for the axes along which there are commands."""
    return np.array([axis != (0.0, 0.0) for axis in box.axes])


def _walks(robot: RobotModel, config: Config, told: Array, gain: Array) -> Walks:
    """What six robots do, two for each axis.

    Args:
        robot: The robot.
        config: The gait, the expert and the simulator.
        told: ``(3,)`` vx [m/s], vy [m/s] and yaw rate [rad/s], each way.
        gain: ``(3,)`` gains of the expert.
    """
    x, y, z = gain.tolist()
    config = replace(config, expert=replace(config.expert, command_gain=(x, y, z)))
    command = np.concatenate([np.diag(told), -np.diag(told)])
    return expert_walks(robot, config, command, to_ticks(SECONDS))


def _reached(walks: Walks, config: Config) -> _Reached:
    """The mean velocities of six robots.

    Args:
        walks: What they did, from `_walks`.
        config: The gait and the fall bounds.
    """
    # Whole periods, so that the sway of the gait cancels.
    period = to_ticks(config.gait.period)
    counted = max((to_ticks(SECONDS) - to_ticks(SETTLED)) // period, 1) * period
    velocity = walks.since(to_ticks(SECONDS) - counted).mean_velocity
    forward_fell, backward_fell = walks.lost(config.safety).reshape(2, 3)
    up = ~(forward_fell | backward_fell)
    told = np.diag(walks.command[:3])
    return _Reached(told, np.diag(velocity[:3]), np.diag(velocity[3:]), up)


def _check_moved(reached: _Reached, needed: BoolArray, gait: str) -> None:
    """Check that a gait moves the robot along each axis that is needed.

    Raises:
        GaitError: It reached too small a share of its command.
    """
    share = np.where(needed, reached.share, 1.0)
    axis = int(share.argmin())
    if share[axis] >= LEAST_SHARE:
        return
    name = ("vx", "vy", "yaw rate")[axis]
    unit = ("m/s", "m/s", "rad/s")[axis]
    raise GaitError(
        f"the gait {gait} does not move the robot: of {name} {reached.told[axis]:.3g} {unit} it "
        f"reached {reached.forward[axis]:.3f}, and of the opposite {reached.backward[axis]:.3f} "
        f"{unit}, in {SECONDS:g} s; close that axis of the commands, or use another gait"
    )
