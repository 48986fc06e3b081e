"""SafeDAGGER (Zhang and Cho, 2016; paper, Algorithm 2): a learned pi_safe calls the expert.

D <- expert rollouts; pre-train pi_1 on D, and pi_safe
for i = 1 .. N:
    roll out pi_i; where pi_safe says unsafe, the expert drives
    D' <- {(s, pi*(s)) | pi_safe says unsafe}
    D <- D u D'
    train pi_{i+1} on D, and pi_safe
return the best pi_i on validation, and its pi_safe

pi_safe is the gate `classifier`: it predicts from the state alone whether the policy deviates from
the expert by more than tau, so the expert need not plan to decide who drives. As in the other
methods, a run counts policies from 0: iteration i rolls out policy i - 1 with the gate that was
trained after that policy.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import SafeDaggerConfig
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.jobs import Job
from surefoot.runs.budget import iterations_within_budget
from surefoot.runs.checks import check_config
from surefoot.runs.gate_training import make_gate, train_gates
from surefoot.runs.run import Run
from surefoot.runs.sampling import (
    disturbance_in,
    draw_starts,
    episodes_from,
    expert_frames,
    pretraining_rollouts,
)
from surefoot.runs.stages import (
    choose_best_policy,
    collect_data,
    pretrain,
    train_policy,
    validate_policy,
)
from surefoot.safety.monitor import SafetyMonitor
from surefoot.types import PlanFunction
from surefoot.workers import Workers


def safe_dagger(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with SafeDAGGER; the run's folder gets data, policies, gates and metrics.

    Args:
        run: An open run, new or resumed.
        workers: Processes that run the rollouts; the result does not depend on them.
        plan: The expert's MPC, any plain function; None for the BiConMP-style planner.

    Returns:
        File of the policy that did best on the `select` initial states; its gate is
        ``run.gate_path("classifier", i)`` of the same iteration.

    Raises:
        TypeError: The run was configured for another method.
        ValueError: A parameter is out of range.
    """
    method = run.parameters(SafeDaggerConfig)
    check_config(run.config)

    # D <- expert rollouts; pre-train pi_1 on D, and pi_safe
    pretrain(run, method, workers, plan)
    train_gates(run, 0, ["classifier"], method.unsafe_share)
    validate_policy(run, 0, workers)

    last = 0
    for i in iterations_within_budget(run, method.iterations):
        # Roll out pi_i, D <- D u D'
        collect_data(run, i, collection(run, i, plan), workers)
        # Train pi_{i+1} on D, and pi_safe
        train_policy(run, i, method.training_in(i))
        train_gates(run, i, ["classifier"], method.unsafe_share)
        validate_policy(run, i, workers)
        last = i

    choose_best_policy(run, last)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i, with the policy and the gate of iteration i - 1."""
    config = run.config
    method = run.parameters(SafeDaggerConfig)
    if i == 0:
        return pretraining_rollouts(config, method, plan)
    # Without blocking, the expert drives in the states that are called unsafe, and only there.
    monitor = SafetyMonitor(make_gate(run, i, ["classifier"]), block=0.0)
    starts = draw_starts(config, method, i)
    return Job(
        config,
        episodes_from(config, starts, i, method.T),
        SafetySwitch(monitor),
        policy=run.policy_path(i - 1),
        keep=expert_frames,
        plan=plan,
        disturbance=disturbance_in(config, i, method.iterations),
    )
