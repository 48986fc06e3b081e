"""DAGGER (Ross et al., 2011; paper, Algorithm 1): visit the policy's states, ask the expert there.

D <- {}
for i = 1 .. N:
    sample trajectories with pi_i = beta_i pi* + (1 - beta_i) pi_i: a coin at every step
    D <- D u {(s, pi*(s))}, all visited states with the expert's actions
    train pi_{i+1} on D
return the best pi_i on validation

beta_1 = 1: the first iteration is the expert alone, on the rollouts with which the other methods
pre-train. A run numbers from 0: its iteration k is i = k + 1, so beta = p^k.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surefoot.config import DaggerConfig
from surefoot.rollouts.arbiters import RandomMix
from surefoot.rollouts.engine import Episodes, Rollout
from surefoot.rollouts.jobs import Job
from surefoot.runs.checks import check_config, parameters
from surefoot.runs.run import Run
from surefoot.runs.sampling import disturbance_in, draw_starts, episode_ids, expert_rollouts
from surefoot.runs.stages import best, collect, train, validate
from surefoot.types import BoolArray, PlanFunction
from surefoot.workers import Workers


def dagger(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with DAGGER; the run's folder gets data, policies and metrics.

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
    method = parameters(run, DaggerConfig)
    check_config(run.config)

    for k in range(method.iterations + 1):
        collect(run, k, collection(run, k, plan), workers)
        train(run, k, method.epochs if k else method.pretraining_epochs)
        validate(run, k, workers)

    best(run, method.iterations)
    return run.best_policy_path


def collection(run: Run, k: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration k; fixed by the run's seed."""
    config, method = run.config, parameters(run, DaggerConfig)
    if k == 0:
        return expert_rollouts(config, method.pretraining, plan)
    starts = draw_starts(method, np.random.default_rng(run.seed("starts", k)))
    return Job(
        config,
        Episodes(starts, method.T, id=episode_ids(k, len(starts))),
        RandomMix(method.p**k, 1, config.seed),
        policy=run.policy_path(k - 1),
        keep=visited,
        plan=plan,
        disturbance=disturbance_in(config, k, method.iterations),
        ask_always=True,
    )


def visited(record: Rollout) -> BoolArray:
    """``(B, T)`` every visited state that the expert has an answer for.

    An MPC as pi* plans on its grid of 50 ms at the states visited; the ticks up to the next plan
    are labelled with this plan's torque law at the states visited.
    """
    return record.expert_asked
