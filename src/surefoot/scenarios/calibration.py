"""Command gains, measured: a gait reaches a share of what is planned, and more is planned for it.

Six robots walk for three seconds from standing, each at one command along one axis, both ways; the
gain of an axis is what was planned over what was reached. Biases that do not depend on the
direction cancel. Next: `surefoot.scenarios.walking`, and `surefoot.mpc.footholds`, where the gains
are used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from surefoot.config import Config, Gait
from surefoot.mpc.gaits import gait_name
from surefoot.mpc.schedule import stands
from surefoot.robots.model import RobotModel
from surefoot.scenarios.walking import expert_walks
from surefoot.types import Array, to_ticks

SECONDS = 3.0
"""[s] How long the robots walk."""
SETTLED = 1.0
"""[s] From here on their velocity counts."""
TRIED = (0.2, 0.15, 0.5)
"""[m/s, m/s, rad/s] The planned vx, vy and yaw rate of a robot of Solo12's size."""
LEAST_SHARE = 0.4
"""A gait that reaches less of what is planned does not go where it is told."""


@dataclass(frozen=True)
class CommandGain:
    """By how much the commands of a gait are scaled inside the planner, and what was measured.

    Attributes:
        gain: The gains of vx, vy and yaw rate, as `ExpertConfig.command_gain`.
        planned: vx [m/s], vy [m/s] and yaw rate [rad/s] that were planned, each way.
        forward: The mean of each that was reached at the positive command.
        backward: The mean of each that was reached at the negative command.
    """

    gain: tuple[float, float, float]
    planned: tuple[float, float, float]
    forward: tuple[float, float, float]
    backward: tuple[float, float, float]


def calibrate_command_gain(
    robot: RobotModel, gait: Gait, config: Config, scale: float = 1.0
) -> CommandGain:
    """Measure the command gains of a robot and a gait; takes a few seconds.

    Along an axis that `config.commands` closes at zero the robot may fall, or not move at all; the
    gain is then 1.

    Args:
        robot: The robot.
        gait: The gait; the gains of one that stands are 1.
        config: The expert, whose own gains have no influence, the commands, the simulator and the
            fall bounds.
        scale: The robot's leg length over Solo12's.

    Raises:
        ValueError: A robot fell, or reached too little of what was planned; the message has the
            numbers.
    """
    planned = np.array(TRIED) * (np.sqrt(scale), np.sqrt(scale), 1.0)
    if stands(gait):
        rest = (0.0, 0.0, 0.0)
        return CommandGain((1.0, 1.0, 1.0), _triple(planned), rest, rest)
    expert = replace(config.expert, command_gain=(1.0, 1.0, 1.0))
    command = np.concatenate([np.diag(planned), -np.diag(planned)])
    uncalibrated = replace(config, gait=gait, expert=expert)
    walks = expert_walks(robot, uncalibrated, command, to_ticks(SECONDS))

    box = config.commands
    needed = np.array([axis != (0.0, 0.0) for axis in (box.vx, box.vy, box.yaw_rate)])
    walks.of(np.tile(needed, 2)).check(config.safety, gait_name(gait))
    # Whole periods, so that a gait's sway cancels.
    period = to_ticks(gait.period)
    counted = max((to_ticks(SECONDS) - to_ticks(SETTLED)) // period, 1) * period
    reached = walks.since(to_ticks(SECONDS) - counted).mean_velocity
    forward = np.diag(reached[:3])
    backward = np.diag(reached[3:])
    share = (forward - backward) / (2 * planned)
    _check_shares(np.where(needed, share, 1.0), planned, forward, backward, gait_name(gait))
    up = ~walks.fallen(config.safety)[-1].reshape(2, 3).any(axis=0)
    usable = up & (share >= LEAST_SHARE)
    gain = np.where(usable, 1.0 / np.where(usable, share, 1.0), 1.0)
    return CommandGain(_triple(gain), _triple(planned), _triple(forward), _triple(backward))


def _check_shares(share: Array, planned: Array, forward: Array, backward: Array, gait: str) -> None:
    """Check that a gait moves the robot along each axis.

    Args:
        share: ``(3,)`` the shares that were reached of what was planned.
        planned: ``(3,)`` what was planned, each way.
        forward: ``(3,)`` what was reached of it.
        backward: ``(3,)`` what was reached of its opposite.
        gait: The name of the gait.

    Raises:
        ValueError: A share is too small.
    """
    axis = int(share.argmin())
    if share[axis] >= LEAST_SHARE:
        return
    name = ("vx", "vy", "yaw rate")[axis]
    unit = ("m/s", "m/s", "rad/s")[axis]
    raise ValueError(
        f"the gait {gait} does not move the robot: of {name} {planned[axis]:.3g} {unit} it reached "
        f"{forward[axis]:.3f}, and of the opposite {backward[axis]:.3f} {unit}, in {SECONDS:g} s; "
        "close that axis of the commands, or use another gait"
    )


def calibrated(robot: RobotModel, config: Config, scale: float = 1.0) -> tuple[Config, CommandGain]:
    """The configuration with the measured gains of its gait, and the measurement.

    Args:
        robot: The robot.
        config: The configuration.
        scale: The robot's leg length over Solo12's.

    Raises:
        ValueError: The robot does not walk in this gait.
    """
    measured = calibrate_command_gain(robot, config.gait, config, scale)
    return replace(config, expert=replace(config.expert, command_gain=measured.gain)), measured


def _triple(values: Array) -> tuple[float, float, float]:
    """Three numbers, rounded to four digits, as a configuration holds them."""
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z
