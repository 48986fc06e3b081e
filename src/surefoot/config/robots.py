"""The robot's limits."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RobotConfig:
    """The robot's limits."""

    torque_limit: float = 2.7
    """[Nm] at the joint: the peak torque of Solo12's actuator module (Grimminger et al., 2020)."""
