"""Command gains, measured: a gait reaches a share of what is planned, and more is planned for it.

Six robots walk for three seconds from standing, each at one command along one axis, both ways; the
gain of an axis is what was planned over what was reached. Biases that do not depend on the
direction cancel. A gait that reaches little is measured once more, with the gain; where it then
falls, the first gain stays, and `prepare` finds how far it walks with that. Next:
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
"""[s] From here on their velocity counts."""
TRIED = (0.2, 0.15, 0.5)
"""[m/s, m/s, rad/s] vx, vy and yaw rate that a robot of Solo12's size is told, or less: no more
than the box has."""
LEAST_TRIED = 0.25
"""The least share of `TRIED` that it is told, however narrow the box: of less, a sway would count
for much."""
LEAST_SHARE = 0.4
"""A gait that reaches less of what is planned does not go where it is told."""
FAR = 1.5
"""A larger gain is measured again with the gain itself: a gait that is so far from what is planned
is not proportional to it."""


@dataclass(frozen=True)
class _Reached:
    """What six robots reached of what they were told, along vx, vy and yaw rate.

    Attributes:
        told: ``(3,)`` what they were told, each way.
        forward: ``(3,)`` what was reached of it.
        backward: ``(3,)`` what was reached of its opposite.
        up: ``(3,)`` True where neither robot fell.
    """

    told: Array
    forward: Array
    backward: Array
    up: BoolArray

    @property
    def share(self) -> Array:
        """``(3,)`` the share that was reached, without what is the same both ways."""
        return (self.forward - self.backward) / (2 * self.told)

    @property
    def usable(self) -> BoolArray:
        """``(3,)`` True where the robots stayed up and went where they were told."""
        return self.up & (self.share >= LEAST_SHARE)

    def where_usable(self, other: _Reached) -> _Reached:
        """The same, with what was reached at another time along axes that are not usable."""
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

    Along an axis that `config.commands` closes at zero the robot may fall, or not move at all; the
    gain is then 1.

    Args:
        robot: The robot.
        gait: The gait, which is one that moves.
        config: The expert, whose own gains have no influence, the commands, the simulator and the
            fall bounds.
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
    """``(3,)`` what robots are told when they are measured: vx, vy [m/s] and yaw rate [rad/s].

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
    # Whole periods, so that a gait's sway cancels.
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
        GaitError: It reached too small a share of what it was told.
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
