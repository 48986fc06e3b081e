"""How one controller is evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, ClassVar

from surefoot.config.checked import Angle, Checked, Duration, Share, Within, known
from surefoot.config.scenarios import DisturbanceConfig, Split


@dataclass(frozen=True)
class EvaluationConfig(Checked):
    """The paper's robustness test (IV-F): one perturbed initial state per command and phase."""

    section: ClassVar[str] = "evaluation"

    duration: Duration = 5.0
    """[s] how long an episode lasts (paper)."""
    episodes: Annotated[int, Within(1, 1_000_000)] = 100
    """How many initial states of a split are used, of each gait if there are several. For the trot,
    each hundred of them is 10 commands at 10 phases; if the last hundred is not complete, what is
    used of it is spread over both."""
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """What makes an evaluation harder: friction, mass, sensor noise, delayed torques and pushes;
    the paper has none of them. `gentle` and `expert_impulse` have no meaning here."""


@dataclass(frozen=True)
class PushConfig(Checked):
    """Push recovery: impulses on the base of a trotting robot (paper, IV-F).

    Robots begin in the first perturbation of a split, at all phases (ten of a trot) for each
    command, and are pushed at 2 s (the paper's research code: 100 robots a level, between 0.5 and
    3 N s).
    """

    section: ClassVar[str] = "push"

    split: Split = "test"
    """Split of the stored initial states; `nominal` is the settled gait cycle."""
    speeds: Annotated[int, Within(1, 1000)] = 10
    """How many commands of the split are used, spread over all of them; the default is all of them
    in the packaged sets, equally spaced speeds."""
    before: Duration = 2.0
    """[s] how long the robots trot before the push (the paper's research code); this is simulated
    once for all levels."""
    after: Duration = 1.6
    """[s] how long a robot has to stay up and stepping after the push, and longer in a gait whose
    steps take longer to judge; if this is less than `safety.stepping_from`, the stepping is not
    judged."""
    duration: Duration = 0.01
    """[s] how long the force acts."""
    directions: Annotated[int, Within(1, 360)] = 8
    """How many equally spaced directions are tried, in the heading frame."""
    success: Share = 0.8
    """Share of the robots that has to survive a level (the paper's research code)."""
    fall_angle: Angle = 60.0
    """[deg] roll or pitch beyond this is a fall here (the paper's research code)."""
    resolution: Annotated[float, Within(0.001, 100.0)] | None = None
    """[N s] distance between two levels; the monotone fit interpolates. None is the robot's own, by
    its mass (Solo12: 0.2)."""
    levels: Annotated[int, Within(1, 10_000)] = 30
    """How many levels are tried; the strongest push is this times the resolution."""

    @property
    def strongest(self) -> float:
        """The strongest push [N s]."""
        return self.levels * known(self.resolution, "push.resolution")


def shortened(
    push: PushConfig,
    speeds: int | None = None,
    directions: int | None = None,
    resolution: float | None = None,
) -> PushConfig:
    """Settings of push recovery that take less time: fewer robots or directions, coarser levels.

    The simulated time is that of speeds x phases x directions x (about log2 of the levels)
    episodes.

    Args:
        push: The settings; those that are not given below are kept.
        speeds: The number of forward speeds, each at all phases of the gait.
        directions: The number of directions.
        resolution: The distance between two levels [N s]; the strongest push stays about the same.

    Raises:
        ValueError: A number is out of its range.
    """
    levels = push.levels
    if resolution is None:
        resolution = push.resolution
    elif resolution > 0.0:  # any other is refused below, by the range of the field
        levels = max(round(push.strongest / resolution), 1)
    return replace(
        push,
        speeds=push.speeds if speeds is None else speeds,
        directions=push.directions if directions is None else directions,
        resolution=resolution,
        levels=levels,
    )
