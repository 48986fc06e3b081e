"""Arbiters: who drives each robot, the expert or the policy, decided anew at every tick.

`ExpertOnly` collects data to clone, `PolicyOnly` evaluates, `RandomMix` flips DAGGER's coin, and
`SafetySwitch` lets the expert rescue. Read `engine` next, which asks them.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.seeds import seed_of
from surefoot.types import Array, BoolArray, IntArray, State


class Arbiter(Protocol):
    """Decides who drives each robot, anew at every tick."""

    def reset(self, episode: IntArray) -> None:
        """Begin new episodes.

        Args:
            episode: ``(B,)`` ids of the episodes; they fix all randomness.
        """
        ...

    def choose(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the expert drives during this tick; called once a tick.

        Args:
            state: The states of B robots: without noise in training, and otherwise as the robots
                measure them.
            tick: ``(B,)`` gait clock [ms], which advances from call to call.
            command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        """
        ...


class ExpertOnly:
    """The expert always drives (behavior cloning)."""

    def reset(self, episode: IntArray) -> None:
        """Do nothing: there is no memory."""

    def choose(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` all True."""
        return np.ones(len(tick), dtype=bool)


class PolicyOnly:
    """The policy always drives (evaluation)."""

    def reset(self, episode: IntArray) -> None:
        """Do nothing: there is no memory."""

    def choose(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` all False."""
        return np.zeros(len(tick), dtype=bool)


class RandomMix:
    """A coin decides: at every tick (DAGGER), or once per expert period (LocoDAGGER).

    Args:
        probability: Probability that the expert drives: beta_i, or alpha^(i-1).
        every: Number of ticks of the gait clock between flips; the coin is also flipped in the
            first tick of an episode.
        seed: Root of the randomness; each episode flips its own coin.

    Raises:
        ValueError: The probability is not in 0 to 1, or there is no tick between flips.
    """

    def __init__(self, probability: float, every: int, seed: int) -> None:
        if not 0.0 <= probability <= 1.0 or every < 1:
            raise ValueError(
                f"a coin with probability {probability} every {every} ticks; use a probability of "
                "0 to 1, and at least 1 tick"
            )
        self._probability = probability
        self._every = every
        self._seed = seed
        self.reset(np.zeros(0, dtype=np.int64))

    def reset(self, episode: IntArray) -> None:
        """Give each episode its own coin."""
        seeds = [seed_of(self._seed, "coin", id_) for id_ in episode.tolist()]
        self._coins = [np.random.default_rng(seed) for seed in seeds]
        self._expert: BoolArray | None = None

    def choose(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the last flip chose the expert."""
        if self._expert is None:
            thrown = np.ones(len(tick), dtype=bool)
            self._expert = np.zeros(len(tick), dtype=bool)
        else:
            thrown = tick % self._every == 0
        if thrown.any():
            self._expert = self._expert.copy()
            for robot in np.flatnonzero(thrown).tolist():
                self._expert[robot] = self._coins[robot].random() < self._probability
        return self._expert


class SafetySwitch:
    """The policy drives unless the monitor blocks it; then the expert does (Algorithms 2 and 4).

    Args:
        monitor: A gate with blocking.
    """

    def __init__(self, monitor: SafetyMonitor) -> None:
        self._monitor = monitor

    def reset(self, episode: IntArray) -> None:
        """Unblock all robots."""
        self._monitor.reset(len(episode))

    def choose(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the monitor blocks the policy."""
        return self._monitor.blocking(state, tick, command)
