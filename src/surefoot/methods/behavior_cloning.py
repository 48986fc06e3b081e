"""Behaviour cloning (paper, II-A): the expert drives, the policy imitates.

    D <- collect rollout data from the expert
    train pi on D
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import BehaviorCloningConfig
from surefoot.methods.stages import best, collect, expert_rollouts, train, validate
from surefoot.run import Run


def behavior_cloning(run: Run, workers: int) -> Path:
    """Clone the expert; the run's folder gets data, policy and metrics.

    Args:
        run: an open run, new or to be resumed.
        workers: processes for the rollouts; the result does not depend on it.

    Returns:
        File of the policy.

    Raises:
        TypeError: the run was configured for another method.
    """
    method = run.config.method
    if not isinstance(method, BehaviorCloningConfig):
        raise TypeError(f"this run is configured for {run.method}, not for behavior_cloning")

    collect(run, 0, expert_rollouts(run.config, method.data), workers)
    train(run, 0, method.epochs)
    validate(run, 0, workers)
    best(run, 0)
    return run.best_policy
