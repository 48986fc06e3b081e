"""Behavior cloning (paper, II-A): the expert drives, the policy imitates.

D <- collect rollout data from the expert
train pi on D

The paper uses it as a baseline at several sizes of D: each policy of the series is trained from
scratch on the first whole episodes of D in a random order (`runs.stages.first_frames`).
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import BehaviorCloningConfig
from surefoot.rollouts.jobs import Job
from surefoot.runs.checks import check_config
from surefoot.runs.run import Run
from surefoot.runs.sampling import expert_rollouts
from surefoot.runs.stages import (
    choose_best_policy,
    collect_data,
    first_frames,
    train_policy,
    validate_policy,
)
from surefoot.types import PlanFunction
from surefoot.workers import Workers


def behavior_cloning(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Clone the expert; the run's folder gets data, policies and metrics.

    Args:
        run: An open run, new or resumed.
        workers: Processes that run the rollouts; the result does not depend on them.
        plan: The expert's MPC, any plain function; None for the BiConMP-style planner.

    Returns:
        File of the policy that was trained on all frames, or else on the last size of the series.

    Raises:
        TypeError: The run was configured for another method.
        ValueError: A parameter is out of range.
    """
    method = run.parameters(BehaviorCloningConfig)
    check_config(run.config)

    # D <- collect rollout data from the expert
    collect_data(run, 0, collection(run, 0, plan), workers)

    # Train one policy for each size of the series, on the first episodes of D in a random order
    for size, frames in enumerate(method.frames):
        train_policy(run, size, method.training, first_frames(run, frames), fresh=True)
        validate_policy(run, size, workers)

    # Train pi on D
    last = method.sizes - 1
    if method.all_frames:
        train_policy(run, last, method.training, run.dataset, fresh=True)
        validate_policy(run, last, workers)

    choose_best_policy(run, last, first=last)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The expert rollouts to clone; there is only iteration 0.

    Raises:
        ValueError: The iteration is not 0.
    """
    if i != 0:
        raise ValueError(f"behavior cloning collects once; there is no iteration {i}")
    config = run.config
    data = run.parameters(BehaviorCloningConfig).data
    return expert_rollouts(config, data, plan, config.collection)
