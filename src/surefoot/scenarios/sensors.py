"""Noisy sensors: from the true state of each tick to what the robots measure.

The noise of each robot is drawn from its own root seed, so that a measurement does not depend on
the other robots of the batch. Read `disturbance` first, which has the noise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import center_of_mass, feet, integrate, legs_of, masses_of
from surefoot.scenarios.disturbance import Disturbance, standard_deviations
from surefoot.types import Array, State

BLOCK = 500
"""The number of ticks for which noise is drawn at a time."""


def make_sensors(robot: RobotModel, disturbance: Disturbance) -> Callable[[State], State] | None:
    """A function from the true state of each tick to what the robots measure; None without noise.

    Feet and center of mass are computed from the measurements, with the robot's model. Contacts, x
    and y are measured without error: no policy sees x and y anyway.

    Args:
        robot: The model of the robots.
        disturbance: The noise and its seeds.
    """
    sigma = standard_deviations(disturbance.noise)
    if not sigma.any():
        return None
    return _Sensors(robot, sigma, disturbance)


class _Sensors:
    """Noisy sensors of B robots; a call makes the measurement of a tick from the true state.

    Args:
        robot: The model of the robots.
        sigma: ``(36,)`` standard deviations of a displacement and of a velocity.
        disturbance: The root seeds of the noise of the B robots, and how much of it is used up.
    """

    def __init__(self, robot: RobotModel, sigma: Array, disturbance: Disturbance) -> None:
        self._legs = legs_of(robot)
        self._masses = masses_of(robot)
        self._sigma = sigma
        self._sources = [np.random.default_rng(seed) for seed in disturbance.seeds]
        if disturbance.measured is not None:
            # Normal draws use up varying amounts of the source, so tick n is reached by drawing.
            for source, ticks in zip(self._sources, disturbance.measured.tolist(), strict=True):
                source.standard_normal((ticks, 36))
        self._block = np.empty((BLOCK, len(self._sources), 36))
        self._next = 0

    def __call__(self, state: State) -> State:
        """What the robots measure of their state in this tick."""
        error = self._error()
        # Displacements are in the base frame, but the height error is vertical, whatever the tilt.
        height = error[:, 2].copy()
        error[:, 2] = 0.0
        q = np.array([integrate(*pair) for pair in zip(state.q, error[:, :18], strict=True)])
        q[:, :3] = state.q[:, :3]
        q[:, 2] += height
        position, _ = feet(q, self._legs)
        com = center_of_mass(q, self._legs, self._masses)
        return State(q, state.v + error[:, 18:], com, position, state.contacts)

    def _error(self) -> Array:
        """``(B, 36)`` errors of the next tick."""
        if self._next == 0:
            for robot, source in enumerate(self._sources):
                self._block[:, robot] = source.standard_normal((BLOCK, 36))
        error = self._sigma * self._block[self._next]
        self._next = (self._next + 1) % BLOCK
        return error
