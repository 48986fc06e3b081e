"""Walks without a simulation: robots do as they are told up to a speed, and lie beyond it."""

import numpy as np
import pytest

from surefoot.config import Split
from surefoot.robots.model import standing
from surefoot.scenarios.make import SplitSize
from surefoot.scenarios.walking import Walks

SMALL: dict[Split, SplitSize] = {
    "nominal": SplitSize(3, 1),
    "train": SplitSize(3, 2),
    "select": SplitSize(2, 1),
    "test": SplitSize(2, 1),
}
"""A set of few states: 10 phases of a trot."""


class FakeWalks:
    """Stands in for `expert_walks`.

    Args:
        limit: A robot lies where it is told a larger vx [m/s] either way.
    """

    def __init__(self, limit: float = 10.0) -> None:
        self.limit = limit
        self.asked = []

    def __call__(self, robot, config, command, ticks, every=1, progress=None) -> Walks:
        self.asked.append(command)
        n = len(command)
        tick = np.arange(0, ticks, every)
        q = np.tile(standing(robot), (len(tick), n, 1))
        q[:, np.abs(command[:, 0]) > self.limit, 2] = 0.01
        v = np.zeros((len(tick), n, 18))
        gain = np.array(config.expert.command_gain or (1.0, 1.0, 1.0))
        v[:, :, [0, 1, 5]] = 0.8 * gain * command
        return Walks(tick, q, v, command)


def _perturb(robot, q, v, stance, perturbation, safety, rng):
    """A random neighbor without the search for one that is acceptable."""
    change = np.zeros(19)
    change[7:] = 0.01 * rng.standard_normal(12)
    return q + change, v


@pytest.fixture
def fake_walks(monkeypatch, tmp_path) -> FakeWalks:
    """Everything is prepared from fake walks, in few states, and kept in a folder of the test."""
    walks = FakeWalks()
    for module in ("make", "boxes", "calibration"):
        monkeypatch.setattr(f"surefoot.scenarios.{module}.expert_walks", walks)
    monkeypatch.setattr("surefoot.scenarios.make.perturb", _perturb)
    folder = tmp_path / "cache" / "surefoot"
    for module in ("prepare", "gains"):
        target = f"surefoot.scenarios.{module}.user_folder"
        monkeypatch.setattr(target, lambda name: str(folder / name))
    return walks
