"""Randomness: every draw has a seed of its own, fixed by the root seed and by what it is for."""

from __future__ import annotations

import numpy as np

PURPOSES = ("starts", "network", "order", "disturbance", "coin", "query", "gate")
"""What is random; the place in this list is the first number of a seed's spawn key."""


def seed_of(root: int, purpose: str, number: int) -> np.random.SeedSequence:
    """The seed of a draw: never one of who computes it.

    Args:
        root: the configuration's seed.
        purpose: one of `PURPOSES`.
        number: of the iteration, or the id of the episode.
    """
    return np.random.SeedSequence(root, spawn_key=(PURPOSES.index(purpose), number))
