"""Evaluation as in the paper (IV-F): robustness from perturbed starts, velocity tracking.

A rollout succeeds if the robot does not fall and steps constantly for two thirds of it. Every
policy and the expert are run on the same stored starts, so that comparisons are paired.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from surefoot.config import Config
from surefoot.evaluation.statistics import wilson
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.scenarios.starts import StartSet, load_starts
from surefoot.types import TICKS_PER_SECOND, PlanFunction
from surefoot.workers import Workers


def evaluate(
    config: Config,
    policy: Path | None,
    split: str,
    workers: Workers,
    label: str,
    plan: PlanFunction | None = None,
    stored: StartSet | None = None,
) -> tuple[dict[str, Any], Summary]:
    """Run a policy, or the expert, from stored starts.

    Args:
        config: of robot, simulator, expert; duration and number of episodes.
        policy: file of the policy; None evaluates the expert.
        split: `select` to choose a policy, `test` to report.
        workers: who runs the episodes.
        label: of the progress bar.
        plan: the expert's MPC; without it the BiConMP-style planner.
        stored: the set of starts; without it the package's first.

    Returns:
        The figures (see `figures_of`), and the episodes they sum up.

    Raises:
        FileNotFoundError: there is no such policy.
        KeyError: there is no such split.
        ValueError: the split holds fewer starts than the episodes asked for.
    """
    stored = stored or load_starts()
    starts = stored.first(split, config.evaluation.episodes)
    job = Job(
        config,
        Episodes(starts, config.evaluation.duration, id=starts.id),
        ExpertOnly() if policy is None else PolicyOnly(),
        policy=policy,
        plan=plan,
        disturbance=config.evaluation.disturbance,
    )
    summary = run_episodes(job, workers, label)
    figures = {"starts": stored.name, "starts_hash": stored.hash, "split": split}
    return {**figures, **figures_of(summary)}, summary


def figures_of(summary: Summary) -> dict[str, Any]:
    """The paper's figures of n episodes, flat.

    ``episodes``, ``successes``, ``falls``, ``stalls``, ``diverged`` count them; ``success_rate``
    has its Wilson 95 % interval, ``success_interval``; ``strict_successes`` also step in every
    window of 1.5 periods; ``mse`` is over the successes and the whole episode (paper),
    ``settled_mse`` from 1 s on over all episodes that lasted so long, each with the same weight;
    both ``[vx, vy, yaw_rate]`` in m^2/s^2 and rad^2/s^2; ``max_torque`` in Nm; ``plans`` counts MPC
    solves, ``invalid_plans`` those that were not valid; ``robot_seconds`` is simulated time.
    """
    n, success = len(summary.outcome), summary.outcome == Outcome.SUCCESS
    successes = int(success.sum())
    return {
        "episodes": n,
        "successes": successes,
        "success_rate": successes / n,
        "success_interval": wilson(successes, n),
        "falls": int((summary.outcome == Outcome.FELL).sum()),
        "stalls": int((summary.outcome == Outcome.STALLED).sum()),
        "diverged": int((summary.outcome == Outcome.DIVERGED).sum()),
        "strict_successes": int((success & summary.strict).sum()),
        "mse": mean_rows(summary.mse[success]),
        "settled_mse": mean_rows(summary.settled_mse),
        "max_torque": float(summary.max_torque.max()),
        "robot_seconds": float(summary.ticks.sum() / TICKS_PER_SECOND),
        "plans": int(summary.plans.sum()),
        "invalid_plans": int(summary.invalid_plans.sum()),
    }


def mean_rows(rows: np.ndarray) -> list[float | None]:
    """Mean over the rows that are numbers, None for columns without any."""
    return [
        float(column[np.isfinite(column)].mean()) if np.isfinite(column).any() else None
        for column in rows.T
    ]
