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
from surefoot.types import to_ticks

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

    Args:
        robot: The robot.
        gait: The gait; the gains of one that stands are 1.
        config: The expert, whose own gains have no influence, the simulator and the fall bounds.
        scale: The robot's leg length over Solo12's.

    Raises:
        ValueError: A robot fell, or reached too little of what was planned; the message has the
            numbers.
    """
    root = np.sqrt(scale)
    planned = np.array(TRIED) * (root, root, 1.0)
    if stands(gait):
        rest = (0.0, 0.0, 0.0)
        return CommandGain((1.0, 1.0, 1.0), _triple(planned), rest, rest)
    expert = replace(config.expert, command_gain=(1.0, 1.0, 1.0))
    command = np.concatenate([np.diag(planned), -np.diag(planned)])
    uncalibrated = replace(config, gait=gait, expert=expert)
    walks = expert_walks(robot, uncalibrated, command, to_ticks(SECONDS))
    name = gait_name(gait)
    walks.check(config.safety, name)
    # Whole periods, so that a gait's sway cancels.
    period = to_ticks(gait.period)
    counted = max((to_ticks(SECONDS) - to_ticks(SETTLED)) // period, 1) * period
    reached = walks.since(to_ticks(SECONDS) - counted).mean_velocity
    forward = np.diag(reached[:3])
    backward = np.diag(reached[3:])
    share = (forward - backward) / (2 * planned)
    if share.min() < LEAST_SHARE:
        axis = int(share.argmin())
        unit = ("m/s", "m/s", "rad/s")[axis]
        raise ValueError(
            f"the gait {name} does not move the robot: of {('vx', 'vy', 'yaw rate')[axis]} "
            f"{planned[axis]:.2f} {unit} it reached {forward[axis]:.3f}, and of the opposite "
            f"{backward[axis]:.3f} {unit}, in {SECONDS:g} s; use another gait"
        )
    return CommandGain(_triple(1.0 / share), _triple(planned), _triple(forward), _triple(backward))


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


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    """Three numbers, rounded to four digits, as a configuration holds them."""
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z
