"""SafeDAGGER (Zhang and Cho, 2016; paper, Algorithm 2): a learned pi_safe calls the expert.

D <- expert rollouts; pre-train pi_1 on D, and pi_safe
for i = 1 .. N:
    roll out pi_i; where pi_safe says unsafe, the expert drives
    D' <- {(s, pi*(s)) | pi_safe says unsafe}
    D <- D u D'
    train pi_{i+1} on D, and pi_safe
return the best pi_i on validation, and its pi_safe

pi_safe predicts from the state alone that the policy deviates from the expert by more than tau, so
that nobody has to ask the expert who drives. A run numbers policies from 0, as for the other
methods: iteration i rolls out the policy i - 1 under the pi_safe that was trained after it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surefoot.config import SafeDaggerConfig
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job
from surefoot.runs.checks import check_config, parameters
from surefoot.runs.gate_training import guard, train_guards
from surefoot.runs.run import Run
from surefoot.runs.sampling import (
    disturbance_in,
    draw_starts,
    episode_ids,
    expert_frames,
    expert_rollouts,
)
from surefoot.runs.stages import best, collect, train, validate
from surefoot.safety.monitor import SafetyMonitor
from surefoot.types import PlanFunction
from surefoot.workers import Workers


def safe_dagger(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with SafeDAGGER; the run's folder gets data, policies, pi_safe and metrics.

    Args:
        run: an open run, new or to be resumed.
        workers: who runs the rollouts; the result does not depend on it.
        plan: the expert's MPC, any plain function; without it the BiConMP-style planner.

    Returns:
        File of the policy that did best on the `select` starts; its pi_safe is
        ``run.gate_path("classifier", i)`` of the same iteration.

    Raises:
        TypeError: the run was configured for another method.
        ValueError: a parameter cannot be had.
    """
    method = parameters(run, SafeDaggerConfig)
    check_config(run.config)

    # Pre-training (behaviour cloning)
    collect(run, 0, collection(run, 0, plan), workers)
    train(run, 0, method.pretraining_epochs)
    train_guards(run, 0, ["classifier"], method.unsafe_share)
    validate(run, 0, workers)

    for i in range(1, method.iterations + 1):
        collect(run, i, collection(run, i, plan), workers)
        train(run, i, method.epochs)
        train_guards(run, i, ["classifier"], method.unsafe_share)
        validate(run, i, workers)

    best(run, method.iterations)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i; fixed by the run's seed."""
    config, method = run.config, parameters(run, SafeDaggerConfig)
    if i == 0:
        return expert_rollouts(config, method.pretraining, plan)
    starts = draw_starts(method, np.random.default_rng(run.seed("starts", i)))
    pi_safe = guard(run, i, ["classifier"])
    return Job(
        config,
        Episodes(starts, method.T, id=episode_ids(i, len(starts))),
        # Without blocking: the expert drives in the states called unsafe, and only in those.
        SafetySwitch(SafetyMonitor(pi_safe, block=0.0)),
        policy=run.policy_path(i - 1),
        keep=expert_frames,
        plan=plan,
        disturbance=disturbance_in(config, i, method.iterations),
    )
