"""Behaviour cloning (paper, II-A): the expert drives, the policy imitates.

D <- collect rollout data from the expert
train pi on D
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import BehaviorCloningConfig
from surefoot.episodes import Job
from surefoot.methods.stages import best, check, collect, expert_rollouts, train, validate
from surefoot.run import Run
from surefoot.types import PlanFunction
from surefoot.workers import Workers


def behavior_cloning(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Clone the expert; the run's folder gets data, policy and metrics.

    Args:
        run: an open run, new or to be resumed.
        workers: who runs the rollouts; the result does not depend on it.
        plan: the expert's MPC, any plain function; without it the BiConMP-style planner.

    Returns:
        File of the policy.

    Raises:
        TypeError: the run was configured for another method.
    """
    method = parameters(run)
    check(run.config)
    collect(run, 0, collection(run, 0, plan), workers)
    train(run, 0, method.epochs)
    validate(run, 0, workers)
    best(run, 0)
    return run.best_policy


def parameters(run: Run) -> BehaviorCloningConfig:
    """The method's parameters; TypeError if the run was configured for another."""
    method = run.config.method
    if not isinstance(method, BehaviorCloningConfig):
        raise TypeError(f"this run is configured for {run.method}, not for behavior_cloning")
    return method


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The expert rollouts to clone; there is only iteration 0."""
    if i != 0:
        raise ValueError(f"behaviour cloning collects once; there is no iteration {i}")
    return expert_rollouts(run.config, parameters(run).data, plan)
