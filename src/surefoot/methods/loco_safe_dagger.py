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
    method = parameters(run, LocoSafeDaggerConfig)
    check_config(run.config)

    # Pre-training (behaviour cloning)
    collect(run, 0, collection(run, 0, plan), workers)
    train(run, 0, method.pretraining_epochs)
    train_guards(run, 0, method.gates, alarm=method.alarm)
    validate(run, 0, workers)

    for i in range(1, method.iterations + 1):
        # Policy rollout + data collection, and the extra data collection of T_end
        collect(run, i, collection(run, i, plan), workers)
        train(run, i, method.epochs)
        train_guards(run, i, method.gates, alarm=method.alarm)
        validate(run, i, workers)

    best(run, method.iterations)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i: who drives, how long, what is kept; fixed by the run's seed."""
    config, method = run.config, parameters(run, LocoSafeDaggerConfig)
    if i == 0:
        return expert_rollouts(config, method.pretraining, plan)
    pi_safety = guard(run, i, method.gates, method.alarm, method.tightest)
    monitor = SafetyMonitor(pi_safety, method.T_block, method.hand_back)
    starts = draw_starts(method, np.random.default_rng(run.seed("starts", i)))
    return Job(
        config,
        Episodes(starts, method.T, method.T_end, episode_ids(i, len(starts))),
        SafetySwitch(monitor),
        policy=run.policy_path(i - 1),
        keep=expert_frames,
        plan=plan,
        disturbance=disturbance_in(config, i, method.iterations),
        trace="history" in method.gates,
    )
