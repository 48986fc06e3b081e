"""The robot's limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from surefoot.config.checked import Checked, Within


@dataclass(frozen=True)
class RobotConfig(Checked):
    """The robot's limits."""

    section: ClassVar[str] = "robot"

    torque_limit: Annotated[float, Within(0.01, 1000.0)] = 2.7
    """[N m] at the joint: the peak torque of Solo12's actuator module (Grimminger et al., 2020)."""
