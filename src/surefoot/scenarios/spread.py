"""Orders of commands and phases of which the first n, for any n, are spread over all of them.

`starts.StartSet` takes the first n initial states, or commands, in these orders.
"""

from __future__ import annotations

import math

import numpy as np

from surefoot.types import Array, IntArray


def along_one_axis(commands: Array) -> bool:
    """Whether commands ``(n, 3)`` differ in at most one number, which never decreases."""
    steps = np.diff(commands, axis=0)
    return bool((steps >= 0.0).all() and steps.any(axis=0).sum() <= 1)


def spread_cells(phases: int, velocities: int) -> IntArray:
    """``(phases x velocities,)`` rows of one perturbation, each once, in a spread order.

    Among the first n, for any n, the numbers of states of two phases, or of two velocities, differ
    by at most one, and both are spread over their range.

    Args:
        phases: Number of phases.
        velocities: Number of velocities.
    """
    n = np.arange(phases * velocities)
    # Diagonals of the grid: each takes every phase and every velocity in turn. A diagonal ends
    # where it would repeat itself, and the next one is shifted.
    shift = n // math.lcm(phases, velocities)
    # Multiples of the powers of 1 / 1.3247, modulo 1, fill the unit square evenly (Roberts, 2018).
    phase = _ranks(phases, 0.7548776662466927)[n % phases]
    velocity = _ranks(velocities, 0.5698402909980532)[(n + shift) % velocities]
    return phase * velocities + velocity


def _ranks(n: int, step: float) -> IntArray:
    """``(n,)`` the numbers below n in a spread order: the ranks of multiples of the step."""
    return np.argsort(np.argsort(np.arange(n) * step % 1.0))
