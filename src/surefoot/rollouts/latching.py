"""Which robots would have been switched off by their own protection, under a hardware profile.

A real robot latches: once a joint is beyond its range or too fast, or a torque has been at its
limit for too long, its motors only damp. In simulation the episode continues, and the first rule
that would have latched is reported in addition to the outcome. Driver timeouts cannot happen in
simulation. Read `config.profiles` for the rules.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from surefoot.config.profiles import HardwareProfile
from surefoot.robots.profile import beyond_range, beyond_speed, position_limits, torque_limits
from surefoot.rollouts.episodes import Rollout
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray, to_ticks


class Latch(IntEnum):
    """What would have switched a robot off; of several rules at one tick, the first one here."""

    NONE = 0
    POSITION = 1
    SPEED = 2
    TORQUE = 3


NEVER = -1
"""The tick of a robot that would not have latched."""


def first_latches(rollouts: Rollout, profile: HardwareProfile) -> tuple[IntArray, IntArray]:
    """The first rule by which each robot would have latched, and when.

    Only the episode proper counts, not its tail; the joints are measured without noise.

    Args:
        rollouts: What happened in B episodes.
        profile: The limits and the rules.

    Returns:
        ``(B,)`` values of `Latch`, and the ticks ``(B,)`` at which the robots would have latched,
        or `NEVER`.
    """
    T = rollouts.duration
    happened = rollouts.happened[:, :T]
    broken = {
        Latch.POSITION: beyond_range(position_limits(profile), rollouts.q[:, :T]),
        Latch.SPEED: beyond_speed(profile, rollouts.v[:, :T]),
        Latch.TORQUE: _saturated(profile, rollouts.torque[:, :T], happened),
    }
    kind = np.full(len(happened), int(Latch.NONE))
    tick = np.full(len(happened), NEVER)
    for latch, where in broken.items():
        where = where & happened
        first = np.where(where.any(axis=1), where.argmax(axis=1), T)
        earlier = first < np.where(tick == NEVER, T, tick)
        kind[earlier] = latch
        tick[earlier] = first[earlier]
    return kind, tick


def latched_in_words(rollouts: Rollout, profile: HardwareProfile) -> str:
    """What would have switched the first robot off, and when; empty if nothing.

    Args:
        rollouts: What happened.
        profile: The limits and the rules.
    """
    kind, tick = first_latches(rollouts, profile)
    if kind[0] == Latch.NONE:
        return ""
    return f"{Latch(int(kind[0])).name.lower()} at {tick[0] / TICKS_PER_SECOND:.3f} s"


def _saturated(profile: HardwareProfile, torque: Array, happened: BoolArray) -> BoolArray:
    """``(B, T)`` True where a torque has been at its limit for as long as the profile allows."""
    if profile.saturation is None:
        return np.zeros(happened.shape, dtype=bool)
    # A clipped torque equals the limit exactly.
    full = (np.abs(torque) >= torque_limits(profile)) & happened[..., None]
    allowed = to_ticks(profile.saturation)
    # A tick is saturated if the last `allowed` ticks all were: a difference of running sums.
    sums = np.cumsum(full, axis=1, dtype=np.int64)
    sums = np.concatenate([np.zeros_like(sums[:, :1]), sums], axis=1)
    result = np.zeros(happened.shape, dtype=bool)
    if allowed <= full.shape[1]:
        held = sums[:, allowed:] - sums[:, :-allowed] == allowed
        result[:, allowed - 1 :] = held.any(axis=2)
    return result
