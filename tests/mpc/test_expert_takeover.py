"""The expert takes over at every offset from its grid, and survives as on the grid."""

from dataclasses import dataclass

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.mpc.expert import make_expert
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from surefoot.types import Array, IntArray, State

OFFSETS = 50


@dataclass(frozen=True)
class HandOver:
    """The expert under test drives from its own tick on, another controller before that."""

    at: IntArray

    def reset(self, episode: IntArray) -> None:
        assert len(episode) == len(self.at)

    def choose(self, state: State, tick: IntArray, command: Array) -> np.ndarray:
        return tick >= self.at


def survivors(starts_per_offset: int, duration: float) -> np.ndarray:
    """``(50, n)`` True where a robot survives a takeover at that offset from the gait grid."""
    config = Config()
    robot = solo12()
    stored = load_starts()["test"]
    rows = 300 + np.arange(starts_per_offset) * 7
    survived = np.zeros((OFFSETS, starts_per_offset), dtype=bool)
    for first in range(0, OFFSETS, 10):
        offsets = np.repeat(np.arange(first, first + 10), starts_per_offset)
        starts = stored[np.tile(rows, 10)]
        # A second expert, planning on the grid, drives the robot up to the takeover.
        rollouts = rollout(
            make_simulator(robot, len(starts), config.simulation),
            Episodes(starts, duration),
            HandOver(starts.tick + offsets),
            make_expert(robot, config),
            make_expert(robot, config),
        )
        good = rollouts.outcome == Outcome.SUCCESS
        survived[first : first + 10] = good.reshape(10, starts_per_offset)
    return survived


@pytest.mark.slow
def test_takeover_survives_at_every_offset():
    survived = survivors(starts_per_offset=4, duration=3.0)
    on_the_grid = survived[0].mean()
    assert on_the_grid == 1.0
    assert (survived.mean(axis=1) >= on_the_grid).all(), np.flatnonzero(~survived.all(axis=1))
