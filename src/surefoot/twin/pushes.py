"""Pushes on a twin: at random times and in random directions, as in simulated episodes.

A twin has no episodes. Instead, its time is cut into spans, and the pushes of each span are drawn
like those of an episode. Read `driver` next.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from surefoot.config import DisturbanceConfig
from surefoot.config.twin import TwinConfig
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import own_pushes
from surefoot.scenarios.disturbance import Pushes, draw_disturbances
from surefoot.scenarios.push import push
from surefoot.sim.protocol import Simulator
from surefoot.types import TICKS_PER_SECOND

SPAN = 5
"""[s] `TwinConfig.pushes` counts pushes per this time, as in an episode of `surefoot learn`."""
SPAN_TICKS = SPAN * TICKS_PER_SECOND
ONE = np.ones(1, dtype=bool)


class RandomPushes:
    """Pushes one robot, on a clock that never restarts: no two episodes have the same pushes.

    Args:
        config: How many pushes there are, how strong they are, and the seed.
        robot: The robot, for pushes that suit its size.

    Attributes:
        tick: The ticks so far in which pushes could act [ms].
    """

    def __init__(self, config: TwinConfig, robot: RobotModel) -> None:
        drawn = DisturbanceConfig(
            pushes=config.pushes, impulse=config.impulse, push_duration=config.push_duration
        )
        self._config = own_pushes(drawn, robot)
        self._seed = config.seed
        self.tick = 0
        self.span = lru_cache(maxsize=2)(self._draw)

    def act(self, simulator: Simulator) -> None:
        """Push the robot during its next tick, if a push is due.

        Args:
            simulator: The simulator, of one robot.
        """
        number, elapsed = divmod(self.tick, SPAN_TICKS)
        self.tick += 1
        # A push that begins late in a span continues in the next one.
        for earlier in range(min(number, 1) + 1):
            pushes = self.span(number - earlier)
            if pushes is not None:
                push(simulator, pushes, elapsed + earlier * SPAN_TICKS, ONE)

    def _draw(self, number: int) -> Pushes | None:
        """The pushes of a span, in ticks since it began; None if it has none."""
        return draw_disturbances(
            self._config, self._seed, np.array([number]), SPAN, friction=1.0
        ).pushes
