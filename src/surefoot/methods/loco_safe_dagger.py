"""LocoSafeDAGGER (paper, Algorithm 4): the policy drives, and learns from the expert's rescues.

Pre-training: D <- expert rollouts; train pi_0 on D
for i = 1 .. N:
    roll out pi_{i-1} for T; where pi_safety says unsafe, the expert drives for T_block
        and D <- D u {its frames}
    the expert drives T_end more, D <- D u {its frames}
    train pi_i on D
return the best pi_i on validation

pi_safety says unsafe if any of the gates in the method's configuration does.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import LocoSafeDaggerConfig
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
    rising_share,
)
from surefoot.runs.stages import (
    Collect,
    choose_best_policy,
    collect_data,
    pretrain,
    train_policy,
    validate_policy,
)
from surefoot.safety.monitor import SafetyMonitor
from surefoot.types import PlanFunction
from surefoot.workers import Workers


def loco_safe_dagger(
    run: Run,
    workers: Workers,
    plan: PlanFunction | None = None,
    on_robot: Collect | None = None,
) -> Path:
    """Train a policy with LocoSafeDAGGER; the run's folder gets data, policies and metrics.

    Args:
        run: An open run, new or resumed.
        workers: Processes that run the rollouts; the result does not depend on them.
        plan: The expert's MPC, any plain function; None for the BiConMP-style planner.
        on_robot: Collects the data of the iterations on a robot (`surefoot.field`); None collects
            it in simulation.

    Returns:
        File of the policy that did best on the `select` initial states; with `on_robot`, of the
        last policy, because those states are simulated.

    Raises:
        TypeError: The run was configured for another method.
        ValueError: A parameter is out of range.
    """
    method = run.parameters(LocoSafeDaggerConfig)
    check_config(run.config)
    collect = on_robot or collect_data

    pretrain(run, method, workers, plan)
    train_gates(run, 0, method.gates, alarm=method.alarm)
    validate_policy(run, 0, workers)

    last = 0
    for i in iterations_within_budget(run, method.iterations):
        # Policy rollout + data collection, and the extra data collection of T_end
        collect(run, i, collection(run, i, plan), workers)
        # Train pi_i on D
        train_policy(run, i, method.training_in(i))
        train_gates(run, i, method.gates, alarm=method.alarm)
        validate_policy(run, i, workers)
        last = i

    choose_best_policy(run, last, first=0 if on_robot is None else last)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i: who drives, for how long, and which frames are kept."""
    config = run.config
    method = run.parameters(LocoSafeDaggerConfig)
    if i == 0:
        return pretraining_rollouts(config, method, plan)
    share = rising_share(method.tightest, i, method.iterations)
    pi_safety = make_gate(run, i, method.gates, method.alarm, share)
    monitor = SafetyMonitor(pi_safety, method.T_block, method.hand_back)
    starts = draw_starts(config, method, i)
    return Job(
        config,
        episodes_from(config, starts, i, method.T, method.T_end),
        SafetySwitch(monitor),
        policy=run.policy_path(i - 1),
        keep=expert_frames,
        plan=plan,
        disturbance=disturbance_in(config, i, method.iterations),
        trace="history" in method.gates,
    )
