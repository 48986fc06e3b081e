"""Synthetic rollouts, for tests of what is made of them."""

from dataclasses import replace

import numpy as np

from surefoot.engine import Rollout
from surefoot.starts import Starts
from surefoot.types import State


def blank(B: int, T: int, **changes) -> Rollout:
    """B robots that stand at the origin for T ticks, all feet down, driven by the policy."""
    q = np.zeros((B, T, 19))
    q[..., 6] = 1.0
    states = State(
        changes.pop("q", q),
        changes.pop("v", np.zeros((B, T, 18))),
        np.zeros((B, T, 3)),
        np.zeros((B, T, 4, 3)),
        np.ones((B, T, 4), bool),
    )
    drove, torque = changes.pop("expert_drove", np.zeros((B, T), bool)), np.zeros((B, T, 12))
    starts = Starts(
        np.zeros((B, 19)), np.zeros((B, 18)), np.zeros(B, int), np.zeros((B, 3)), np.arange(B)
    )
    record = Rollout(
        **vars(states),
        seen=states,
        torque=torque,
        expert_torque=torque,
        expert_drove=drove,
        expert_asked=drove,
        starts=starts,
        length=np.full(B, T),
        outcome=np.zeros(B, np.int64),
        duration=T,
    )
    return replace(record, **changes)
