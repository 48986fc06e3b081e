"""The motor limit, compiled for the engine, which clips the torques of every tick.

`robots.model.clip_torque` is the reference; the results are the same to the bit. Read `engine`
next.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from surefoot.types import Array


def clip_torque(torque: Array, limit: float) -> Array:
    """Clip joint torques ``(B, 12)`` [N m] to the motor limit, in a new array.

    A torque that is not a number becomes zero, so that a broken controller goes limp.

    Args:
        torque: ``(B, 12)`` joint torques [N m].
        limit: The torque limit, the same for all joints [N m].
    """
    clipped = np.array(torque, dtype=np.float64, order="C")
    _clip(clipped.reshape(-1), limit)
    return clipped


@njit(cache=True)
def _clip(torque: Array, limit: float) -> None:
    """Clip torques ``(n,)`` in place."""
    for i in range(len(torque)):
        if np.isnan(torque[i]):
            torque[i] = 0.0
        elif torque[i] > limit:
            torque[i] = limit
        elif torque[i] < -limit:
            torque[i] = -limit
