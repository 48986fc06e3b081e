"""DAGGER (Ross et al., 2011; paper, Algorithm 1): visit the policy's states, ask the expert there.

D <- {}
for i = 1 .. N + 1:
    sample trajectories with pi_i = beta_i pi* + (1 - beta_i) pi_i: a coin at every step
    D <- D u {(s, pi*(s))}, all visited states with the expert's actions
    train pi_{i+1} on D
return the best pi_i on validation

Since beta_1 = 1, the expert alone drives in the first iteration, in the same rollouts that the
other methods use for pre-training. N more iterations follow, as in those methods; Algorithm 1
counts N in all. A run counts from 0: its iteration k is i = k + 1, so beta = p^k.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import DaggerConfig
from surefoot.rollouts.arbiters import RandomMix
from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.jobs import Job
from surefoot.runs.budget import iterations_within_budget
from surefoot.runs.checks import check_config
from surefoot.runs.run import Run
from surefoot.runs.sampling import (
    disturbance_in,
    draw_starts,
    episodes_from,
    pretraining_rollouts,
)
from surefoot.runs.stages import choose_best_policy, collect_data, train_policy, validate_policy
from surefoot.types import BoolArray, PlanFunction
from surefoot.workers import Workers


def dagger(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with DAGGER; the run's folder gets data, policies and metrics.

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
    method = run.parameters(DaggerConfig)
    check_config(run.config)

    last = 0
    for k in iterations_within_budget(run, method.iterations, first=0):
        # Sample trajectories, D <- D u {(s, pi*(s))}
        collect_data(run, k, collection(run, k, plan), workers)
        # Train pi_{i+1} on D
        train_policy(run, k, method.training_in(k))
        validate_policy(run, k, workers)
        last = k

    choose_best_policy(run, last)
    return run.best_policy_path


def collection(run: Run, k: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration k, which the run's seed fixes."""
    config = run.config
    method = run.parameters(DaggerConfig)
    if k == 0:
        return pretraining_rollouts(config, method, plan)
    beta = method.p**k
    starts = draw_starts(config, method, k)
    return Job(
        config,
        episodes_from(config, starts, k, method.T),
        RandomMix(beta, 1, config.seed),
        policy=run.policy_path(k - 1),
        keep=visited_frames,
        plan=plan,
        disturbance=disturbance_in(config, k, method.iterations),
        ask_always=True,
    )


def visited_frames(rollouts: Rollout) -> BoolArray:
    """``(B, T)`` True for the frames of all visited states for which the expert has an answer.

    The expert pi* is an MPC: it plans from the visited states every 50 ms, and the ticks up to the
    next plan are labeled with the torque law of this plan, evaluated at the visited states.
    """
    return rollouts.expert_asked
