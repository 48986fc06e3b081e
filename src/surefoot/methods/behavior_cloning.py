"""Behaviour cloning (paper, II-A): the expert drives, the policy imitates.

D <- collect rollout data from the expert
train pi on D

The paper compares with it at several sizes of D: each policy of the series is trained from scratch
on the first whole episodes.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import BehaviorCloningConfig
from surefoot.rollouts.jobs import Job
from surefoot.runs.checks import check_config, parameters
from surefoot.runs.run import Run
from surefoot.runs.sampling import expert_rollouts
from surefoot.runs.stages import best, collect, first_frames, train, validate
from surefoot.types import PlanFunction
from surefoot.workers import Workers


def behavior_cloning(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Clone the expert; the run's folder gets data, policies and metrics.

    Args:
        run: an open run, new or to be resumed.
        workers: who runs the rollouts; the result does not depend on it.
        plan: the expert's MPC, any plain function; without it the BiConMP-style planner.

    Returns:
        File of the policy that was trained on all frames.

    Raises:
        TypeError: the run was configured for another method.
    """
    method = parameters(run, BehaviorCloningConfig)
    check_config(run.config)
    collect(run, 0, collection(run, 0, plan), workers)
    for size, frames in enumerate(method.frames):
        train(run, size, method.epochs, first_frames(run, frames), fresh=True)
        validate(run, size, workers)
    last = len(method.frames)
    train(run, last, method.epochs, run.dataset, fresh=True)
    validate(run, last, workers)
    best(run, last, last)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The expert rollouts to clone; there is only iteration 0."""
    if i != 0:
        raise ValueError(f"behaviour cloning collects once; there is no iteration {i}")
    config = run.config
    data = parameters(run, BehaviorCloningConfig).data
    return expert_rollouts(config, data, plan, config.collection)
