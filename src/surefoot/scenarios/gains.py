"""Keeps command gains, which are measured once for a robot and a gait.

They are a small file below the user's caches, under a SHA-256 of what they depend on (`keys`).
`calibration` measures them; `prepare` makes everything else that is needed.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

from surefoot.caches import user_folder
from surefoot.config import Config
from surefoot.config.json_io import read_record
from surefoot.files import write_json
from surefoot.mpc.gaits import names_of
from surefoot.mpc.schedule import stands
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import size_of, with_own_values
from surefoot.robots.several_gaits import for_each_gait
from surefoot.scenarios.boxes import box_in_words
from surefoot.scenarios.calibration import calibrate_command_gain, needed_axes, told_commands
from surefoot.scenarios.keys import ingredients_of, key_of
from surefoot.scenarios.preparation import CommandGain, Triple
from surefoot.scenarios.walking import GaitError

NO_GAIN: Triple = (1.0, 1.0, 1.0)
"""The gains where none are measured."""
ZERO: Triple = (0.0, 0.0, 0.0)
"""The velocity reached where nothing was measured."""

logger = logging.getLogger(__name__)


def check_goes(config: Config) -> None:
    """Check that the commands are zero if all gaits stand.

    A standing gait among others, which share its commands, stands whatever they are.

    Args:
        config: The gaits and the commands.

    Raises:
        GaitError: The commands are not zero.
    """
    if all(map(stands, config.gaits)) and needed_axes(config.commands).any():
        raise GaitError(
            f"the gait {names_of(config)} goes nowhere, but the commands are "
            f"{box_in_words(config.commands)}; make them zero, or use another gait"
        )


def with_measured_gain(config: Config) -> Config:
    """The configuration with the robot's own values and measured command gains in place of None.

    Args:
        config: The configuration; gains that are given stay.

    Raises:
        ValueError: The robot does not walk in a gait; the message has the numbers.
    """
    return for_each_gait(_with_measured_gain, config)


def _with_measured_gain(config: Config) -> Config:
    """The same as `with_measured_gain`, for a configuration of one gait."""
    own = with_own_values(config)
    if own.expert.command_gain is not None:
        return own
    gain = measured_gain(load_robot(own.robot), own).gain
    return replace(own, expert=replace(own.expert, command_gain=gain))


def measured_gain(robot: RobotModel, config: Config) -> CommandGain:
    """The command gains of a robot and a gait, measured in seconds unless they were before.

    Args:
        robot: The robot.
        config: The gait, the expert, the commands, the simulator and the fall bounds.

    Raises:
        ValueError: The robot does not walk in this gait; the message has the numbers.
    """
    config = with_own_values(config, robot)
    config = replace(config, expert=replace(config.expert, command_gain=None))
    if stands(config.gait):
        return CommandGain(NO_GAIN, ZERO, ZERO, ZERO)
    ratio = size_of(robot).length_ratio
    needed = needed_axes(config.commands).tolist()
    key = key_of(ingredients_of(config), needed, told_commands(config.commands, ratio).tolist())
    path = Path(user_folder("gains")) / f"{key}.json"
    if path.exists():
        try:
            return read_record(path, CommandGain)
        except ValueError as error:
            logger.warning(f"the command gains are measured again ({error})")
    logger.info(
        f"measuring the command gains of {robot.name}, for seconds; they are kept in {path}"
    )
    gain = calibrate_command_gain(robot, config.gait, config, ratio)
    write_json(path, gain)
    return gain
