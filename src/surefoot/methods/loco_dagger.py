"""LocoDAGGER (paper, Algorithm 3): a coin for each expert period, and expert rollouts from there.

Pre-training: D <- expert rollouts; train pi_0 on D
for i = 1 .. N:
    p <- alpha^(i-1)
    roll out for T; once per expert period the expert drives with probability p, else pi_{i-1}
    for j = 1 .. N_query:
        s_0 <- a random state of the rollout
        the expert drives from s_0 for T_query, D <- D u {its frames}
    train pi_i on D
return the best pi_i on validation
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import LocoDaggerConfig
from surefoot.rollouts.arbiters import RandomMix
from surefoot.rollouts.jobs import Job
from surefoot.runs.budget import iterations_within_budget
from surefoot.runs.checks import check_config
from surefoot.runs.query import Query
from surefoot.runs.run import Run
from surefoot.runs.sampling import (
    disturbance_in,
    draw_starts,
    episodes_from,
    pretraining_rollouts,
)
from surefoot.runs.stages import (
    choose_best_policy,
    collect_data,
    pretrain,
    train_policy,
    validate_policy,
)
from surefoot.types import GRID, PlanFunction
from surefoot.workers import Workers


def loco_dagger(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with LocoDAGGER; the run's folder gets data, policies and metrics.

    Args:
        run: An open run, new or resumed.
        workers: Processes that run the rollouts; the result does not depend on them.
        plan: The expert's MPC, any plain function; None for the BiConMP-style planner.

    Returns:
        File of the policy that did best on the `select` initial states.

    Raises:
        TypeError: The run was configured for another method.
        ValueError: A parameter is out of range.
    """
    method = run.parameters(LocoDaggerConfig)
    check_config(run.config)

    pretrain(run, method, workers, plan)
    validate_policy(run, 0, workers)

    last = 0
    for i in iterations_within_budget(run, method.iterations):
        # Policy rollout, and data collection from its states
        collect_data(run, i, collection(run, i, plan), workers)
        # Train pi_i on D
        train_policy(run, i, method.training_in(i))
        validate_policy(run, i, workers)
        last = i

    choose_best_policy(run, last)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i and the queries that follow; the run's seed fixes both."""
    config = run.config
    method = run.parameters(LocoDaggerConfig)
    if i == 0:
        return pretraining_rollouts(config, method, plan)
    p = method.alpha ** (i - 1)
    starts = draw_starts(config, method, i)
    return Job(
        config,
        episodes_from(config, starts, i, method.T),
        RandomMix(p, GRID, config.seed),
        policy=run.policy_path(i - 1),
        plan=plan,
        disturbance=disturbance_in(config, i, method.iterations),
        then=Query(method.N_query, method.T_query, method.before_fall),
    )
