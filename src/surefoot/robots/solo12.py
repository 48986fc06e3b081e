"""Solo12 (Grimminger et al., 2020), the robot of the paper; `config.robot_table` describes it."""

from __future__ import annotations

from surefoot.config import RobotConfig
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel


def solo12(config: RobotConfig | None = None) -> RobotModel:
    """Load Solo12 as ``example-robot-data`` describes it: 2.500 kg, point feet, 12 joints.

    Args:
        config: The robot's limits; the defaults if it is None.

    Raises:
        ImportError: The package ``example-robot-data`` is missing.
    """
    return load_robot(config or "solo12")
