"""Hardware profiles as data: what a robot's motors and drivers allow, and when they switch off.

A robot's spec says what its joints could do; a profile says what the electronics of one actual
robot let them do. `robot.profile` names one: torques are then clipped to it, and an evaluation
counts how many robots would have switched themselves off. The package has some profiles by name,
and a JSON or TOML file may define a user's own. `surefoot.robots.profile` reads them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from surefoot.config.checked import Checked, Duration, Rates, Rising, Torques, Within

LEG_JOINTS = 3
"""The joints of a leg."""
ALL_JOINTS = 12
"""The joints of a robot."""

Range = Annotated[tuple[float, float], Within(-12.57, 12.57), Rising()]
"""The smallest and the largest angle of a joint, within two turns either way [rad]."""
Timeout = Annotated[float, Within(0.001, 1.0)]
"""How long a robot may be without commands; a bridge allows no more, since it has fallen by then
[s]."""


@dataclass(frozen=True)
class HardwareProfile(Checked):
    """The limits of one actual robot, and the rules by which it switches itself off.

    What switches a robot off is latched: its motors only damp from then on, until somebody resets
    it.
    """

    section: ClassVar[str] = "robot.profile_spec"

    name: str
    """The profile's name, which is written into results."""
    robot: str
    """The name of the robot that it belongs to."""
    torque_limit: Torques
    """[N m] the largest torques of a leg's joints, to which the drivers clip."""
    position_limit: tuple[Range, ...]
    """[rad] the ranges of a leg's three joints, the same for all legs, or of all twelve; a joint
    beyond its range latches."""
    speed_limit: Rates
    """[rad/s] the largest rates of a leg's joints; a joint that is faster latches."""
    saturation: Duration | None = None
    """[s] a torque that has been at its limit for so long latches; None never does."""
    rate: Annotated[int, Within(1, 100_000)] = 1000
    """[Hz] how often the robot takes commands."""
    command_timeout: Timeout = 0.005
    """[s] without a command for so long, the motor boards latch."""
    damping: Annotated[float, Within(0.0, 1000.0)] = 0.2
    """[N m s/rad] the damping of the joints of a robot that has latched."""

    def __post_init__(self) -> None:
        """Check the fields, and the number of ranges."""
        super().__post_init__()
        if len(self.position_limit) not in (LEG_JOINTS, ALL_JOINTS):
            raise ValueError(
                f"{self.section}.position_limit has {len(self.position_limit)} pairs; give one for "
                "each of a leg's three joints, or for each of all twelve"
            )
        if not self.name or not self.robot:
            raise ValueError(f"{self.section} lacks a name, its own or its robot's; give both")


ODRI = HardwareProfile(
    name="odri",
    robot="solo12",
    # The demonstration of the Open Dynamic Robot Initiative's driver, odri_control_interface:
    # 8 A at 0.025 N m/A through a gear of 9 is 1.8 N m.
    torque_limit=(1.8, 1.8, 1.8),
    position_limit=((-0.9, 0.9), (-1.45, 1.45), (-2.8, 2.8)),
    speed_limit=(80.0, 80.0, 80.0),
)

PROFILES: Mapping[str, HardwareProfile] = {ODRI.name: ODRI}
"""The profiles of the package, by name."""
