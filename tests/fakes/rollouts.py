"""Synthetic rollouts and summaries, for tests of what is made of them."""

from dataclasses import fields, replace

import numpy as np

from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.summary import Summary
from surefoot.scenarios.starts import Starts
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
    drove = changes.pop("expert_drove", np.zeros((B, T), bool))
    torque = np.zeros((B, T, 12))
    standing = np.zeros((B, 19))
    standing[:, 6] = 1.0
    starts = Starts(standing, np.zeros((B, 18)), np.zeros(B, int), np.zeros((B, 3)), np.arange(B))
    rollouts = Rollout(
        **vars(states),
        seen=states,
        torque=torque,
        expert_torque=torque,
        expert_drove=drove,
        expert_asked=drove,
        body_contact=np.zeros((B, T), bool),
        starts=starts,
        length=np.full(B, T),
        outcome=np.zeros(B, np.int64),
        duration=T,
    )
    return replace(rollouts, **changes)


def summary_of(outcome, **figures) -> Summary:
    """Episodes with these outcomes, and zeros for all figures that are not given."""
    n = len(outcome)
    zeros = {
        "query": np.zeros(n, bool),
        "expert": np.full(n, "surefoot.mpc.planner"),
        "expert_drove_last": np.zeros(n, bool),
        "expert_drove_before": np.zeros(n, bool),
        "tilted_far": np.zeros((n, 2), bool),
        "strict": np.zeros(n, bool),
        "command": np.zeros((n, 3)),
        "mean_velocity": np.zeros((n, 3)),
        "mse": np.zeros((n, 3)),
        "settled_mse": np.zeros((n, 3)),
        "max_torque": np.zeros(n),
    }
    counts = {field.name: np.zeros(n, np.int64) for field in fields(Summary)}
    arrays = {name: np.array(array) for name, array in figures.items()}
    return Summary(**{**counts, **zeros, "outcome": np.array(outcome, np.int64), **arrays})
