"""How a simulated twin differs from the robot that a policy was trained on."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from surefoot.config.checked import Checked, Duration, Share, Within
from surefoot.config.scenarios import Impulse

Deviation = Annotated[float, Within(0.0, 10.0)]
"""A standard deviation."""
Milliseconds = Annotated[float, Within(0.0, 1000.0)]
"""A time [ms]."""
Pose = Literal["lying", "standing"]
"""How a twin waits for its first command: lying on its belly, or held up in its nominal pose."""


@dataclass(frozen=True)
class LinkConfig(Checked):
    """What happens to datagrams, in each direction."""

    section: ClassVar[str] = "twin.link"

    loss: Share = 0.0
    """The share of the datagrams that is lost."""
    delay: Milliseconds = 0.0
    """[ms] every datagram is late by this."""
    jitter: Milliseconds = 0.0
    """[ms] and by a uniform draw from 0 to this, so that later ones overtake earlier ones."""


@dataclass(frozen=True)
class SensorNoiseConfig(Checked):
    """Standard deviations of white noise on each sensor of a twin, drawn anew at every tick."""

    section: ClassVar[str] = "twin.noise"

    joint_position: Deviation = 0.0
    """[rad]"""
    joint_velocity: Deviation = 0.0
    """[rad/s]"""
    orientation: Deviation = 0.0
    """[rad] of a rotation about a random axis."""
    angular_velocity: Deviation = 0.0
    """[rad/s]"""
    base_height: Deviation = 0.0
    """[m]"""
    base_velocity: Deviation = 0.0
    """[m/s]"""


@dataclass(frozen=True)
class TwinConfig(Checked):
    """The twin: its floor, its payload, its sensors, its motors, and the way to it."""

    section: ClassVar[str] = "twin"

    pose: Pose = "lying"
    """How it waits for its first command."""
    base: bool = True
    """Whether height and linear velocity of the base are measured, as by motion capture."""
    payload: Annotated[float, Within(0.1, 10.0)] = 1.0
    """Factor on mass and rotational inertia of the base."""
    friction: Annotated[float, Within(0.001, 10.0)] = 0.5
    """Coefficient of the pair of floor and robot."""
    pushes: Annotated[int, Within(0, 1000)] = 0
    """How many pushes act on the base in five seconds in which its joints have stiffness, from any
    horizontal direction, at any time; also while it stands."""
    impulse: Impulse | None = None
    """[N s] the smallest and the largest push; None is the robot's own, by its mass (Solo12: 0.3 to
    1.5)."""
    push_duration: Annotated[float, Within(0.001, 1.0)] = 0.01
    """[s] how long the force of a push acts (paper, IV-F)."""
    delay: Annotated[int, Within(0, 100)] = 0
    """[ms] from a command at the bridge to the motors."""
    noise: SensorNoiseConfig = field(default_factory=SensorNoiseConfig)
    link: LinkConfig = field(default_factory=LinkConfig)
    command_timeout: Duration = 0.02
    """[s] the runtime may be silent for so long, unless a hardware profile says otherwise."""
    command_age: Duration = 0.04
    """[s] the state may be so old that a command answers."""
    state_timeout: Duration = 0.1
    """[s] the bridge may be silent for so long. A bridge on a robot's own computer has 0.02; a twin
    shares its processor with others."""
    seed: Annotated[int, Within(0, 2**63 - 1)] = 0
    """The root of noise, loss, jitter and pushes."""
