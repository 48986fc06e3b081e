"""LocoSafeDAGGER (paper, Algorithm 4): the policy drives, the expert rescues, rescues teach.

Pre-training: D <- expert rollouts; train pi_0 on D
for i = 1 .. N:
    roll out pi_{i-1} for T; where pi_safety says unsafe, the expert drives for T_block
        and D <- D u {its frames}
    the expert drives T_end more, D <- D u {its frames}
    train pi_i on D
return the best pi_i on validation
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surefoot.config import LocoSafeDaggerConfig
from surefoot.engine import Rollout, SafetySwitch
from surefoot.episodes import Job
from surefoot.methods.stages import (
    best,
    check,
    collect,
    episode_ids,
    equally_spaced,
    expert_rollouts,
    train,
    validate,
)
from surefoot.run import Run
from surefoot.safety import HandBack, SafetyMonitor
from surefoot.starts import Starts, load_starts
from surefoot.types import BoolArray, PlanFunction
from surefoot.workers import Workers


def loco_safe_dagger(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with LocoSafeDAGGER; the run's folder gets data, policies and metrics.

    Args:
        run: an open run, new or to be resumed.
        workers: who runs the rollouts; the result does not depend on it.
        plan: the expert's MPC, any plain function; without it the BiConMP-style planner.

    Returns:
        File of the policy that did best on the `select` starts.

    Raises:
        TypeError: the run was configured for another method.
        ValueError: a parameter cannot be had, such as a hand-back rule that does not exist.
    """
    method = parameters(run)
    check(run.config)
    collection(run, 1, plan)  # what cannot be had is an error now, not after the pre-training

    # Pre-training (behaviour cloning)
    collect(run, 0, collection(run, 0, plan), workers)
    train(run, 0, method.pretraining_epochs)
    validate(run, 0, workers)

    for i in range(1, method.iterations + 1):
        # Policy rollout + data collection, and the extra data collection of T_end
        collect(run, i, collection(run, i, plan), workers)
        train(run, i, method.epochs)
        validate(run, i, workers)

    best(run, method.iterations)
    return run.best_policy


def parameters(run: Run) -> LocoSafeDaggerConfig:
    """The method's parameters; TypeError if the run was configured for another."""
    method = run.config.method
    if not isinstance(method, LocoSafeDaggerConfig):
        raise TypeError(f"this run is configured for {run.method}, not for loco_safe_dagger")
    return method


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i: who drives, how long, what is kept; fixed by the run's seed."""
    config, method = run.config, parameters(run)
    if i == 0:
        return expert_rollouts(config, method.pretraining, plan)
    monitor = SafetyMonitor(config.safety, method.T_block, HandBack(method.hand_back))
    starts = draw_starts(method, np.random.default_rng(run.seed("starts", i)))
    return Job(
        config,
        starts,
        episode_ids(i, len(starts)),
        SafetySwitch(monitor),
        method.T,
        tail=method.T_end,
        policy=run.policy(i - 1),
        keep=expert_frames,
        plan=plan,
    )


def draw_starts(method: LocoSafeDaggerConfig, rng: np.random.Generator) -> Starts:
    """Starts of one iteration: every velocity, at one random phase, with random perturbations.

    The first perturbations of the stored ones belong to the pre-training.
    """
    stored = load_starts()
    grid = stored.rows("train")[method.pretraining.perturbations :]
    perturbations, phases, velocities = grid.shape
    if not 1 <= method.perturbations <= perturbations:
        raise ValueError(
            f"{method.perturbations} perturbations asked for, the starts {stored.name!r} hold "
            f"{perturbations} of each velocity and phase beyond those of the pre-training"
        )
    rows = []
    for velocity in equally_spaced(velocities, method.velocities):
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
