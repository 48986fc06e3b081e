"""DART (Laskey et al., 2017): noise on the expert's torques, as large as the learner's error.

Pre-training: D <- expert rollouts; train pi_0 on D
for i = 1 .. N:
    Sigma <- covariance of pi_{i-1}(s) - pi*(s) over held-out (s, pi*(s)) of D, times a scale
    the expert drives for T under torque noise from N(0, Sigma); D <- D u {(s, pi*(s))}
    train pi_i on D
return the best pi_i on validation

The expert visits the states that errors of the learner's size lead to, but the learner never
drives. The labels are the expert's commands without the noise. Sigma is the maximum-likelihood
estimate (their equation 5); `noise_scale` replaces their scaling by a guess of the final error.
Their controller is slow, and they draw noise at each of its steps; at 1 kHz that would average out,
so each draw is held here, for 50 ms by default.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from surefoot.config import DartConfig
from surefoot.learning.frames import concatenate, sorted_by_episode
from surefoot.learning.samples import derive, held_out
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.jobs import Job, disturbance_of
from surefoot.runs.budget import iterations_within_budget
from surefoot.runs.checks import check_config
from surefoot.runs.layout import RunError
from surefoot.runs.policies import load_policy
from surefoot.runs.run import Run
from surefoot.runs.sampling import (
    disturbance_in,
    draw_starts,
    episodes_from,
    keep_unless_failed,
    pretraining_rollouts,
)
from surefoot.runs.stages import (
    choose_best_policy,
    collect_data,
    dataset_of,
    pretrain,
    train_policy,
    validate_policy,
)
from surefoot.scenarios.torque_noise import make_torque_noise
from surefoot.types import JOINTS, Array, PlanFunction, to_ticks
from surefoot.workers import Workers

logger = logging.getLogger(__name__)


def dart(run: Run, workers: Workers, plan: PlanFunction | None = None) -> Path:
    """Train a policy with DART; the run's folder gets data, policies and metrics.

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
    method = run.parameters(DartConfig)
    check_config(run.config)

    pretrain(run, method, workers, plan)
    validate_policy(run, 0, workers)

    last = 0
    for i in iterations_within_budget(run, method.iterations):
        # Fit the noise, and collect under it
        collect_data(run, i, collection(run, i, plan), workers)
        # Train pi_i on D
        train_policy(run, i, method.training_in(i))
        validate_policy(run, i, workers)
        last = i

    choose_best_policy(run, last)
    return run.best_policy_path


def collection(run: Run, i: int, plan: PlanFunction | None = None) -> Job:
    """The rollouts of iteration i, which the run's seed and the previous policy fix."""
    config = run.config
    method = run.parameters(DartConfig)
    if i == 0:
        return pretraining_rollouts(config, method, plan)
    starts = draw_starts(config, method, i)
    job = Job(
        config,
        episodes_from(config, starts, i, method.T),
        ExpertOnly(),
        keep=keep_unless_failed,
        plan=plan,
        disturbance=disturbance_in(config, i, method.iterations),
    )
    covariance = method.noise_scale * learner_error(run, i - 1)
    hold = max(to_ticks(method.noise_hold), 1)
    noise = make_torque_noise(covariance, hold, config.seed, job.episode)
    noisy = replace(disturbance_of(job), torque_noise=noise)
    return replace(job, episodes=replace(job.episodes, disturbance=noisy))


def learner_error(run: Run, i: int) -> Array:
    """``(12, 12)`` second moments of pi_i(s) - pi*(s) as torques over held-out frames [N^2 m^2].

    The moments are about zero, not about the mean, so that a constant error counts in full.

    Args:
        run: The run, which has trained pi_i.
        i: The iteration.

    Raises:
        RunError: No frame of D is held out.
    """
    policy = load_policy(run, i)
    share = run.config.training.validation
    parts = dataset_of(run, i).parts(all_ticks=policy.spec.remembers)
    held = [frames[held_out(frames.episode, share)] for frames in parts]
    # Sorted, because the last digits of a sum depend on its order, and that on the shards of D.
    frames = sorted_by_episode(concatenate(held))
    if not len(frames):
        raise RunError(
            f"{run.folder} has no frame held out to fit the noise to; use a larger "
            "training.validation, or more rollouts"
        )
    inputs, targets = np.split(
        derive(frames, policy.spec), [policy.spec.observation.input_size], axis=1
    )
    # The torques of two PD laws with the same gains differ by kp times the difference in targets.
    error = policy.spec.kp * (policy.answers(inputs) - targets).astype(np.float64)
    moments = error.T @ error / len(error)
    deviation = np.sqrt(np.trace(moments) / len(JOINTS))
    logger.info(f"iteration {i + 1}: the learner's error is {deviation:.3f} N m a joint")
    return moments
