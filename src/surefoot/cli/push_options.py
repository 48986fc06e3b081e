"""The options that make push recovery shorter, which `evaluate` and `compare` share."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.config import PushConfig
from surefoot.config.evaluation import shortened


@dataclass(frozen=True, kw_only=True)
class OnPushes:
    """A command whose robots can be pushed, with fewer pushes than a run's configuration has."""

    push_speeds: int | None = None
    """The number of forward speeds of the robots that are pushed, each at the ten phases of the
    gait. Without it the run's configuration decides: 10 are the paper's 100 robots a level; 5 cost
    half. With 1, ten robots, no lower end of an interval is above 0."""
    push_directions: int | None = None
    """The number of directions of the pushes; without it the run's configuration decides. The time
    is in proportion: 4 cost half of the default's 8."""
    push_resolution: float | None = None
    """The distance between two levels of the pushes, in N s, up to about the same strongest push;
    without it the run's configuration decides. The default's 0.2 takes five or six rounds, 0.8
    three or four. With --push-speeds 2 --push-directions 4 --push-resolution 0.8 the robots walk
    for about 0.5 thousand seconds instead of 7 thousand."""

    def check_pushed(self, pushes: bool) -> None:
        """Check that what shortens the pushes is not asked for without pushes.

        Args:
            pushes: Whether the robots are pushed.

        Raises:
            ValueError: They are not, and an option says how.
        """
        given = {
            "--push-speeds": self.push_speeds,
            "--push-directions": self.push_directions,
            "--push-resolution": self.push_resolution,
        }
        names = [name for name, value in given.items() if value is not None]
        if names and not pushes:
            raise ValueError(f"{', '.join(names)} without pushes; add --pushes")

    def shortened(self, push: PushConfig) -> PushConfig:
        """The pushes of a run with what the options change.

        Raises:
            ValueError: A number is out of its range.
        """
        return shortened(push, self.push_speeds, self.push_directions, self.push_resolution)
