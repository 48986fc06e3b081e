"""Where episodes begin, and what disturbs the robots in them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar, Literal

from surefoot.config.checked import Angle, Checked, Rising, Share, Within

Split = Literal["nominal", "train", "select", "test"]
"""Splits of the stored initial states: a settled gait cycle, and perturbed states to train on, to
select a policy on, and to test it on once."""
TeachingSplit = Literal["train", "nominal"]
"""Splits in which rollouts that are learned from may begin."""
Sigma = Annotated[float, Within(0.0, 1000.0)]
"""A standard deviation."""
Impulse = Annotated[tuple[float, float], Within(0.0, 1000.0), Rising()]
"""The smallest and the largest impulse [N s]."""
Factor = Annotated[tuple[float, float], Within(0.001, 1000.0), Rising()]
"""The smallest and the largest factor."""
LONGEST_PUSH = 60.0
"""[s] Maximum duration of a push."""
LONGEST_DELAY = 1000
"""[ms] Maximum delay of the torques."""


@dataclass(frozen=True)
class PerturbationConfig(Checked):
    """Contact-consistent perturbation of an initial state (paper).

    The standard deviations are those before the projection.
    """

    section: ClassVar[str] = "perturbation"

    base_position: Sigma = 0.1
    """[m] deviation of the base position along each axis."""
    base_orientation: Sigma = 0.7
    """[rad] deviation of the base orientation about each axis."""
    joint_position: Sigma = 0.2
    """[rad] deviation of each joint angle."""
    velocity: Sigma = 0.2
    """[m/s, rad/s] deviation of each velocity: linear, angular and of the joints."""
    max_penetration: Annotated[float, Within(0.0, 10.0)] = 0.002
    """[m] how deep a foot sphere may be in the ground; deeper states are drawn again."""
    linear_velocity: Sigma | None = None
    """[m/s] deviation of the base's linear velocity, along each axis, where it is another one than
    `velocity`; None is that one."""


@dataclass(frozen=True)
class StateNoiseConfig(Checked):
    """Standard deviations of white noise on the measured state, drawn anew at every tick.

    A policy sees it, and so does an expert that is evaluated; one that teaches, and the gates of a
    training, see the state without.
    """

    section: ClassVar[str] = "disturbance.noise"

    base_height: Sigma = 0.0
    """[m] noise on the height of the base."""
    base_orientation: Sigma = 0.0
    """[rad] noise on the orientation of the base, about each of its axes."""
    base_linear_velocity: Sigma = 0.0
    """[m/s] noise on the linear velocity of the base, along each of its axes."""
    base_angular_velocity: Sigma = 0.0
    """[rad/s] noise on the angular velocity of the base, about each of its axes."""
    joint_position: Sigma = 0.0
    """[rad] noise on each joint angle."""
    joint_velocity: Sigma = 0.0
    """[rad/s] noise on each joint rate."""


@dataclass(frozen=True)
class DisturbanceConfig(Checked):
    """What disturbs a robot, drawn anew for each episode from its id; nothing by default."""

    section: ClassVar[str] = "disturbance"

    pushes: Annotated[int, Within(0, 1000)] = 0
    """How many pushes act on the base in an episode, from any horizontal direction, at any time."""
    impulse: Impulse | None = (0.5, 1.5)
    """[N s] the smallest and the largest push; None is the robot's own, by its mass (Solo12: 0.3 to
    1.5, and 0.5 to 3 in pre-training and in behavior cloning's data, where the expert drives)."""
    gentle: Share = 1.0
    """`impulse` in the first iteration is this share of what it is in the last one; in between it
    rises evenly. A policy that has not seen pushes yet is thrown by smaller ones."""
    expert_impulse: Impulse | None = (0.0, 0.0)
    """[N s] the smallest and the largest additional push where the expert drives in order to teach:
    early in LocoSafeDAGGER's tail and in LocoDAGGER's queries. The expert then shows how to
    recover; it withstands stronger pushes than a policy does. None is the robot's own, by its mass
    (Solo12: 0.5 to 3)."""
    fall_angle: Angle = 0.0
    """[deg] roll or pitch beyond this is a fall, if it is more than `safety.fall_angle`: robots
    that are pushed tilt further and recover (the paper's research code allows 60 after pushes)."""
    push_duration: Annotated[float, Within(0.001, LONGEST_PUSH)] = 0.01
    """[s] how long the force of a push acts (paper, IV-F)."""
    friction: Factor = (1.0, 1.0)
    """The smallest and the largest factor on `simulation.friction`; the planner does not know of
    it."""
    mass: Factor = (1.0, 1.0)
    """The smallest and the largest factor on mass and inertia of the base; the planner does not
    know of it either."""
    noise: StateNoiseConfig = field(default_factory=StateNoiseConfig)
    delay: Annotated[int, Within(0, LONGEST_DELAY)] = 0
    """[ms] how long it takes from a torque's command to its action."""


def acting(
    disturbance: DisturbanceConfig, *, rises: bool = False, teaches: bool = False
) -> DisturbanceConfig:
    """A disturbance in which settings without effect, of pushes that never come, are the defaults.

    Args:
        disturbance: What is drawn for each episode.
        rises: Whether there are iterations over which pushes grow (`gentle`).
        teaches: Whether the expert drives in order to teach, in a tail or in queries
            (`expert_impulse`).
    """
    plain = DisturbanceConfig()
    pushed = disturbance.pushes > 0
    taught = teaches and disturbance.expert_impulse != plain.expert_impulse
    return replace(
        disturbance,
        impulse=disturbance.impulse if pushed else plain.impulse,
        gentle=disturbance.gentle if pushed and rises else plain.gentle,
        expert_impulse=disturbance.expert_impulse if taught else plain.expert_impulse,
        push_duration=disturbance.push_duration if pushed or taught else plain.push_duration,
    )
