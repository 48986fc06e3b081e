"""When the runtime gives a robot up, how it stands up, and what a robot's hardware allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

from surefoot.config.checked import Angle, Checked, Duration, Seconds, Share, Within
from surefoot.config.robots import Rates, Torques, Travel

Ticks = Annotated[int, Within(1, 1000)]
"""A number of ticks of 1 ms."""


@dataclass(frozen=True)
class RuntimeConfig(Checked):
    """How the runtime stands a robot up, and which faults let it damp the joints for good."""

    section: ClassVar[str] = "runtime"

    stand: Duration = 2.0
    """[s] from the present posture to the nominal one (unitree_rl_mjlab)."""
    stand_kp: Annotated[float, Within(0.1, 100.0)] = 4.0
    """The stiffness while it stands up, as a multiple of the policy's."""
    stand_kd: Annotated[float, Within(0.1, 100.0)] = 2.0
    """The damping while it stands up, as a multiple of the policy's."""
    posture: Annotated[float, Within(0.0, 1.0)] = 0.1
    """[rad] how far beyond the initial states trained on roll, pitch and joints may be when the
    policy takes over."""
    settle: Seconds = 3.0
    """[s] how long the standing robot may take to come to such a posture."""
    missed_deadlines: Ticks = 10
    """So many ticks in a row that took longer than a tick are a fault."""
    tilt: Angle = 45.0
    """[deg] roll or pitch beyond this is a fault."""
    saturation: Duration = 0.1
    """[s] a joint at its torque limit for so long without a break is a fault."""
    saturation_share: Share = 0.98
    """What counts as at the limit, as a share of it."""
    block: Seconds = 2.0
    """[s] how long the expert drives at least after the gate has called a state unsafe (T_block)."""
    plan_latency: Ticks = 8
    """[ms] a plan is asked for so long before it takes effect, for the state expected then; a plan
    takes 2 to 4 ms, and the way to the planner and back."""
    plan_patience: Ticks = 60
    """[ms] the expert may be without a plan for so long."""


@dataclass(frozen=True)
class HardwareProfile(Checked):
    """What a robot's own driver allows, which is less than its description says."""

    section: ClassVar[str] = "profile"

    robot: str
    """The name of the robot."""
    position: tuple[Travel, Travel, Travel]
    """[rad] ranges of a leg's three joints, the same for all legs."""
    speed: Rates
    """[rad/s] largest rates of a leg's joints."""
    torque: Torques
    """[N m] largest torques of a leg's joints."""
    damping: Annotated[float, Within(0.0, 1000.0)]
    """[N m s/rad] damping of the joints of a robot that is latched."""
    command_timeout: Duration
    """[s] the runtime may be silent for so long."""


PROFILES: Mapping[str, HardwareProfile] = {
    # Limits of ODRI's demo configuration; 8 A x 0.025 N m/A x 9 = 1.8 N m. Its motor boards switch
    # off after 5 ms without a command.
    "solo12-odri": HardwareProfile(
        robot="solo12",
        position=((-0.9, 0.9), (-1.45, 1.45), (-2.8, 2.8)),
        speed=(80.0, 80.0, 80.0),
        torque=(1.8, 1.8, 1.8),
        damping=0.2,
        command_timeout=0.005,
    ),
}
"""Hardware profiles, by name."""
