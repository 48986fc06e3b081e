"""How many robots would have switched themselves off (latched), with a hardware profile.

An episode continues where an actual robot would have latched, so that falls and latches are counted
separately. Read `rollouts.latching` for the rules.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.evaluation.digits import as_digits
from surefoot.evaluation.ids import ids_as_text
from surefoot.rollouts.latching import Latch
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.types import TICKS_PER_SECOND


@dataclass(frozen=True)
class Latching:
    """Which of n robots would have latched.

    Attributes:
        profile: Name of the hardware profile, or its file.
        latched: Number of robots that would have latched in the episode or at its beginning.
        latched_successes: Number of these among the successes.
        by_position: Number of robots that would have latched because a joint left its range.
        by_speed: Number of robots that would have latched because a joint was too fast.
        by_torque: Number of robots that would have latched because a torque was at its limit for
            too long.
        outside: Number of initial states outside the profile, in which a robot latches at once.
        outside_states: Ids of these initial states, as text such as ``700-798,850``.
        latches: One digit for each episode, its `Latch`.
        latched_at: When each of these robots would have latched [s], in the order of the episodes.
    """

    profile: str
    latched: int
    latched_successes: int
    by_position: int
    by_speed: int
    by_torque: int
    outside: int
    outside_states: str
    latches: str
    latched_at: tuple[float, ...]


def latching_of(summary: Summary, profile: str) -> Latching:
    """Which robots of n episodes would have latched.

    Args:
        summary: The n episodes, of a robot with this hardware profile.
        profile: The profile's name, or its file.
    """
    latched = summary.latch > Latch.NONE
    at_once = latched & (summary.latch_tick == 0) & (summary.latch != Latch.TORQUE)
    return Latching(
        profile=profile,
        latched=int(latched.sum()),
        latched_successes=int((latched & (summary.outcome == Outcome.SUCCESS)).sum()),
        by_position=int((summary.latch == Latch.POSITION).sum()),
        by_speed=int((summary.latch == Latch.SPEED).sum()),
        by_torque=int((summary.latch == Latch.TORQUE).sum()),
        outside=int(at_once.sum()),
        outside_states=ids_as_text(summary.start[at_once]),
        latches=as_digits(np.maximum(summary.latch, Latch.NONE)),
        latched_at=tuple((summary.latch_tick[latched] / TICKS_PER_SECOND).tolist()),
    )
