"""Randomness: every draw has its own seed, fixed by the root seed and the purpose.

Seeds are spawned by purpose and by the number of the iteration or episode, never by worker, so
results do not depend on how the work is spread. `surefoot.workers` spreads it; read that next.
"""

from __future__ import annotations

import numpy as np

PURPOSES = (
    "starts",
    "network",
    "order",
    "disturbance",
    "coin",
    "query",
    "gate",
    "series",
    "torque",
    "terrain",
    "gaits",
)
"""What is random. The index in this list is the first number of a seed's spawn key, so a new
purpose goes to the end."""


def seed_of(root: int, purpose: str, number: int) -> np.random.SeedSequence:
    """The seed of a draw, independent of the worker that uses it.

    Args:
        root: The seed of the configuration.
        purpose: What is drawn, one of `PURPOSES`.
        number: The number of the iteration, or the id of the episode.

    Raises:
        ValueError: There is no such purpose.
    """
    return np.random.SeedSequence(root, spawn_key=(PURPOSES.index(purpose), number))
