"""Noise on the torques that act on a robot, drawn at intervals and held in between.

DART injects it while the expert drives: the commanded torque plus the noise acts, clipped, but the
commanded torque is recorded and learned from. White noise at 1 kHz would be averaged out by the
inertia of a leg, so each draw is held. A draw is fixed by the robot's seed and the number of the
hold, so an episode that branches off continues with the same noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.scenarios.seeds import seed_of
from surefoot.types import JOINTS, Array, IntArray


@dataclass(frozen=True)
class TorqueNoise:
    """Normal noise on the torques of B robots, of one covariance, with a seed for each robot.

    Attributes:
        root: ``(12, 12)`` symmetric root of the covariance of the joint torques [N m].
        hold: How long a draw is held [ms].
        seeds: The root seeds of the B robots.
        before: ``(B,)`` how many ticks of each robot's noise are before the episode [ms].

    Raises:
        ValueError: The shapes do not agree, a number is not finite, or the hold is less than a
            tick.
    """

    root: Array
    hold: int
    seeds: tuple[np.random.SeedSequence, ...]
    before: IntArray

    def __post_init__(self) -> None:
        """Check all fields."""
        n = len(JOINTS)
        if self.root.shape != (n, n) or not np.isfinite(self.root).all():
            raise ValueError(
                f"torque noise: root {self.root.shape} must be ({n}, {n}) finite numbers"
            )
        if self.hold < 1:
            raise ValueError(f"torque noise: held for {self.hold} ms; use 1 or more")
        if self.before.shape != (len(self.seeds),) or (self.before < 0).any():
            raise ValueError("torque noise: before must be (B,) numbers from 0 on, one a seed")

    def __len__(self) -> int:
        return len(self.seeds)

    def __getitem__(self, rows: slice | NDArray) -> TorqueNoise:
        """The noise of some of the robots."""
        chosen = np.arange(len(self.seeds))[rows]
        return replace(
            self, seeds=tuple(self.seeds[row] for row in chosen), before=self.before[rows]
        )

    def after(self, ticks: IntArray) -> TorqueNoise:
        """The noise of episodes that branch off from these.

        Args:
            ticks: ``(B,)`` the tick of its episode at which each robot branches off [ms].
        """
        return replace(self, before=self.before + ticks)

    def draw(self, robot: int, number: int) -> Array:
        """``(12,)`` the noise of one robot during a hold [N m].

        Args:
            robot: The row of the robot.
            number: Number of the hold, from 0 on.
        """
        seed = self.seeds[robot]
        key = (*seed.spawn_key, number)
        rng = np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=key))
        return self.root @ rng.standard_normal(len(JOINTS))


def make_torque_noise(covariance: Array, hold: int, root: int, episode: IntArray) -> TorqueNoise:
    """The torque noise of episodes, each drawn from its own id.

    Args:
        covariance: ``(12, 12)`` covariance of the joint torques [N^2 m^2].
        hold: How long a draw is held [ms].
        root: Root seed.
        episode: ``(B,)`` ids of the episodes.
    """
    values, vectors = np.linalg.eigh(covariance)
    # Rounding may leave an eigenvalue of a singular matrix a little below zero.
    symmetric_root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    seeds = tuple(seed_of(root, "torque", id_) for id_ in episode.tolist())
    return TorqueNoise(symmetric_root, hold, seeds, np.zeros(len(seeds), dtype=np.int64))


def join_torque_noises(parts: Sequence[TorqueNoise]) -> TorqueNoise | None:
    """The noise of several parts, one after another; None without any.

    Args:
        parts: The parts, of one covariance.
    """
    if not parts:
        return None
    return replace(
        parts[0],
        seeds=tuple(seed for part in parts for seed in part.seeds),
        before=np.concatenate([part.before for part in parts]),
    )


class HeldNoise:
    """The noise of each tick of B robots, drawn when it changes.

    Args:
        noise: The noise.
    """

    def __init__(self, noise: TorqueNoise) -> None:
        self._noise = noise
        self._number = np.full(len(noise), -1)
        self._held = np.zeros((len(noise), len(JOINTS)))

    def at(self, elapsed: int) -> Array:
        """``(B, 12)`` noise on the torques in a tick of the episodes [N m]."""
        number = (self._noise.before + elapsed) // self._noise.hold
        for robot in np.flatnonzero(number != self._number).tolist():
            self._held[robot] = self._noise.draw(robot, int(number[robot]))
        self._number = number
        return self._held
