"""Which episodes methods run: their ids and starts, the expert's rollouts, the rules of keeping."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surefoot.config import Config, DisturbanceConfig, ExpertData, IterativeConfig
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import Episodes, Rollout
from surefoot.rollouts.jobs import Job
from surefoot.scenarios.starts import Starts, StartSet, at_rest, join_starts, load_starts
from surefoot.types import BoolArray, IntArray, PlanFunction

EPISODES_PER_ITERATION = 100_000
"""Episode ids: iteration * this + index."""


def episode_ids(iteration: int, count: int) -> IntArray:
    """Ids that no other iteration of a run uses."""
    return iteration * EPISODES_PER_ITERATION + np.arange(count)


def rising(first: float, i: int, iterations: int) -> float:
    """A share that rises evenly from what it is in the first iteration to 1 in the last."""
    return first + (1.0 - first) * (i - 1) / max(iterations - 1, 1)


def disturbance_in(config: Config, i: int, iterations: int) -> DisturbanceConfig:
    """What disturbs the rollouts of iteration i."""
    collection = config.collection
    share = rising(collection.gentle, i, iterations)
    low, high = collection.impulse
    return replace(collection, impulse=(share * low, share * high))


def expert_rollouts(
    config: Config,
    data: ExpertData,
    plan: PlanFunction | None = None,
    disturbance: DisturbanceConfig | None = None,
) -> Job:
    """Expert rollouts to clone, from the `train` starts; failed rollouts are dropped whole."""
    stored = load_starts()
    parts = [stored["train"][expert_rows(stored, data)]]
    if data.nominal:
        # From standing still, as a robot is switched on: no other start teaches that.
        speeds = np.unique(parts[0].command, axis=0)
        parts.insert(0, at_rest(standing(solo12(config.robot)), speeds))
    starts = join_starts(parts)
    return Job(
        config,
        Episodes(starts, data.duration, id=episode_ids(0, len(starts))),
        ExpertOnly(),
        keep=keep_unless_failed,
        plan=plan,
        disturbance=disturbance or DisturbanceConfig(),
    )


def expert_rows(stored: StartSet, data: ExpertData) -> IntArray:
    """Rows of the `train` split: velocities x ten phases x perturbations."""
    grid = stored.rows("train")
    if data.perturbations > grid.shape[0]:
        raise ValueError(
            f"{data.perturbations} perturbations asked for, the starts {stored.name!r} hold "
            f"{grid.shape[0]} of each velocity and phase"
        )
    velocities = stored.velocities("train", data.velocities)
    return grid[: data.perturbations, :, velocities].ravel()


def keep_unless_failed(record: Rollout) -> BoolArray:
    """All frames of rollouts that neither fell nor diverged."""
    return record.happened & ~record.failed[:, None]


def draw_starts(method: IterativeConfig, rng: np.random.Generator) -> Starts:
    """Starts of one iteration: every velocity, at one random phase, with random perturbations.

    The first perturbations of the stored ones belong to the pre-training.
    """
    stored = load_starts()
    grid = stored.rows("train")[method.pretraining.perturbations :]
    perturbations, phases, _ = grid.shape
    if not 1 <= method.perturbations <= perturbations:
        raise ValueError(
            f"{method.perturbations} perturbations asked for, the starts {stored.name!r} hold "
            f"{perturbations} of each velocity and phase beyond those of the pre-training"
        )
    rows = []
    for velocity in stored.velocities("train", method.velocities):
        phase = rng.integers(phases)
        which = rng.choice(perturbations, method.perturbations, replace=False)
        rows.extend(grid[which, phase, velocity])
    return stored["train"][np.array(rows)]


def expert_frames(record: Rollout) -> BoolArray:
    """``(B, T)`` the frames to keep: what the expert drove, tail included.

    A block of the expert that ends in a fall or a divergence is dropped whole; it teaches how to
    fall. Earlier blocks of that rollout ended well and are kept.
    """
    keep = record.expert_drove & record.happened
    for robot in np.flatnonzero(record.failed):
        tick = record.length[robot] - 1
        while tick >= 0 and keep[robot, tick]:
            keep[robot, tick] = False
            tick -= 1
    return keep
