"""Where episodes begin, and what disturbs the robots in them."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class PerturbationConfig:
    """Contact-consistent perturbation of a start; sigmas before its projection (paper)."""

    base_position: float = 0.1
    """[m]"""
    base_orientation: float = 0.7
    """[rad]"""
    joint_position: float = 0.2
    """[rad]"""
    velocity: float = 0.2
    """[m/s, rad/s]"""
    max_penetration: float = 0.002
    """[m] a start with a foot sphere deeper in the ground is drawn again."""


@dataclass(frozen=True)
class NoiseConfig:
    """Standard deviations of white noise on what a robot measures, anew at every tick."""

    base_height: float = 0.0
    """[m]"""
    base_orientation: float = 0.0
    """[rad] about each axis of the base."""
    base_linear_velocity: float = 0.0
    """[m/s] base frame."""
    base_angular_velocity: float = 0.0
    """[rad/s] base frame."""
    joint_position: float = 0.0
    """[rad]"""
    joint_velocity: float = 0.0
    """[rad/s]"""


@dataclass(frozen=True)
class DisturbanceConfig:
    """What disturbs a robot, drawn anew for each episode from its id; nothing by default."""

    pushes: int = 0
    """Pushes on the base in an episode, from any horizontal direction, at any time."""
    impulse: tuple[float, float] = (0.5, 1.5)
    """[Ns] smallest and largest push."""
    gentle: float = 1.0
    """`impulse` in the first iteration is this share of what it is in the last; in between it rises
    evenly. A policy that has not seen pushes yet is thrown by less."""
    expert_impulse: tuple[float, float] = (0.0, 0.0)
    """[Ns] smallest and largest of one more push where the expert drives in order to teach: early
    in LocoSafeDAGGER's tail and in the queries of LocoDAGGER. It shows how to recover, and the
    expert stands more than a policy does."""
    fall_angle: float = 0.0
    """[deg] roll or pitch beyond this is a fall, if it is more than `safety.fall_angle`: robots
    that are pushed tilt further, and recover (the paper's research code judges pushes by 60)."""
    push_duration: float = 0.01
    """[s] of the force (paper, IV-F)."""
    friction: tuple[float, float] = (1.0, 1.0)
    """Smallest and largest factor on `simulation.friction`; the planner does not know of it."""
    mass: tuple[float, float] = (1.0, 1.0)
    """Smallest and largest factor on mass and inertia of the base; neither does it of this."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    delay: int = 0
    """[ms] from a torque's command to its action."""
