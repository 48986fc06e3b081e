"""Solo12 (Grimminger et al., 2020), the robot of the paper; `config.robot_table` describes it."""

from __future__ import annotations

from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel


def solo12() -> RobotModel:
    """Load Solo12 as ``example-robot-data`` describes it: 2.500 kg, point feet, 12 joints.

    Raises:
        ImportError: The package ``example-robot-data`` is missing.
    """
    return load_robot("solo12")
