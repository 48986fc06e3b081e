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

import numpy as np

from surefoot.config import LocoDaggerConfig
from surefoot.rollouts.arbiters import RandomMix
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job
from surefoot.runs.checks import check_config, parameters
from surefoot.runs.query import Query
from surefoot.runs.run import Run
from surefoot.runs.sampling import disturbance_in, draw_starts, episode_ids, expert_rollouts
from surefoot.runs.stages import best, collect, train, validate
from surefoot.types import GRID, PlanFunction
from surefoot.workers import Workers


def loco_dagger(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with LocoDAGGER; the run's folder gets data, policies and metrics.

    Args:
        run: an open run, new or to be resumed.
        workers: who runs the rollouts; the result does not depend on it.
        plan: the expert's MPC, any plain function; without it the BiConMP-style planner.

    Returns:
        File of the policy that did best on the `select` starts.

    Raises:
        TypeError: the run was configured for another method.
        ValueError: a parameter cannot be had.
    """
    method = parameters(run, LocoDaggerConfig)
    check_config(run.config)

    # Pre-training (behaviour cloning)
    collect(run, 0, collection(run, 0, plan), workers)
    train(run, 0, method.pretraining_epochs)
    validate(run, 0, workers)

    for i in range(1, method.iterations + 1):
        # Policy rollout, and data collection from its states
        collect(run, i, collection(run, i, plan), workers)
        train(run, i, method.epochs)
        validate(run, i, workers)

    best(run, method.iterations)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i, and what follows from them; fixed by the run's seed."""
    config, method = run.config, parameters(run, LocoDaggerConfig)
    if i == 0:
        return expert_rollouts(config, method.pretraining, plan)
    starts = draw_starts(method, np.random.default_rng(run.seed("starts", i)))
    return Job(
        config,
        Episodes(starts, method.T, id=episode_ids(i, len(starts))),
        RandomMix(method.alpha ** (i - 1), GRID, config.seed),
        policy=run.policy_path(i - 1),
        plan=plan,
        disturbance=disturbance_in(config, i, method.iterations),
        then=Query(method.N_query, method.T_query, method.before_fall),
    )
