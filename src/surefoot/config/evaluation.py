"""How one controller is evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from surefoot.config.scenarios import DisturbanceConfig


@dataclass(frozen=True)
class EvaluationConfig:
    """The paper's robustness test (IV-F): one perturbed start per velocity and phase."""

    duration: float = 5.0
    """[s] (paper)."""
    episodes: int = 100
    """The first so many of a split: 10 velocities x 10 phases each hundred."""
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """Axes of realism: friction, mass, sensor noise, late torques, pushes; the paper has none."""


@dataclass(frozen=True)
class PushConfig:
    """Push recovery: impulses on the base of a trotting robot (paper, IV-F).

    Robots begin in the first perturbation of a split, ten phases at each speed, and are pushed at
    2 s (the paper's research code: 100 robots a level, between 0.5 and 3 Ns).
    """

    split: Literal["nominal", "train", "select", "test"] = "test"
    """of the stored starts; `nominal` is the settled gait cycle."""
    speeds: int = 10
    """Equally spaced ones of the split's, all by default."""
    before: float = 2.0
    """[s] before the push (the paper's research code), simulated once for all levels."""
    after: float = 1.6
    """[s] that the robot has to stay up and stepping from the push on; of less than
    `safety.stepping_from` the stepping is not judged."""
    duration: float = 0.01
    """[s] of the force."""
    directions: int = 8
    """Equally spaced, in the heading frame."""
    success: float = 0.8
    """Share of the robots that have to survive a level (the paper's research code)."""
    fall_angle: float = 60.0
    """[deg] roll or pitch beyond this is a fall here (the paper's research code)."""
    resolution: float = 0.2
    """[Ns] between levels; the monotone fit interpolates."""
    levels: int = 30
    """The strongest push tried is this times the resolution."""
