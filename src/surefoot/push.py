"""Push recovery: the largest impulse on the base that a robot takes from each direction.

A push lasts 10 ms, from one of eight directions in the robot's heading frame, while it trots; a
level is survived if at least 80 % of the robots neither fall nor stop stepping (paper, IV-F). The
levels tried are bisected; over all of them a monotone curve is fitted, and read at 80 %.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression

from surefoot.arbiters import ExpertOnly, PolicyOnly
from surefoot.config import Config, PushConfig
from surefoot.disturbance import Pushes
from surefoot.episodes import Job, run_episodes
from surefoot.safety import Outcome
from surefoot.starts import Starts, StartSet, load_starts
from surefoot.types import Array, BoolArray, IntArray, PlanFunction, to_ticks
from surefoot.workers import Workers


def push_recovery(
    config: Config,
    policy: Path | None,
    workers: Workers,
    label: str,
    plan: PlanFunction | None = None,
) -> dict[str, Any]:
    """Largest impulse survived by a policy, or by the expert, from each direction.

    Args:
        config: of robot, simulator, expert, and of the pushes.
        policy: file of the policy; None pushes the expert.
        workers: who runs the episodes.
        label: of the progress bars.
        plan: the expert's MPC; without it the BiConMP-style planner.

    Returns:
        ``direction_deg`` (0 is forward, 90 to the left), and for each of them ``max_impulse`` [Ns],
        the largest level survived, and ``fitted_impulse`` [Ns], where a monotone fit meets the
        share asked for; their means; ``levels``, ``episodes`` and ``successes`` of all that was
        tried, ``unpushed_successes`` among them. Robots that fail even
        unpushed get 0; those that survive the strongest level get that.
    """
    push, stored = config.push, load_starts()
    starts = pushed_starts(push, stored)
    safety = replace(config.safety, fall_angle=push.fall_angle)
    base = Job(
        replace(config, safety=safety),
        starts,
        np.arange(len(starts)),
        ExpertOnly() if policy is None else PolicyOnly(),
        push.before + push.after,
        policy=policy,
        plan=plan,
    )
    unpushed = run_episodes(base, workers, f"{label}: unpushed")
    angles = 2 * np.pi * np.arange(push.directions) / push.directions
    # Level k is k * resolution; the search keeps a level that passed and one that failed.
    unpushed_successes = int(success(unpushed.outcome).sum())
    stands = unpushed_successes >= push.success * len(starts)
    passed = np.zeros(len(angles), int)
    failed = np.full(len(angles), push.levels + 1 if stands else 0)
    tried: list[dict[int, int]] = [{0: unpushed_successes} for _ in angles]
    while (open_ := np.flatnonzero(failed - passed > 1)).size:
        level = (passed + failed)[open_] // 2
        job = pushed(base, angles[open_], level * push.resolution)
        summary = run_episodes(job, workers, f"{label}: pushes, {len(open_)} directions")
        survived = success(summary.outcome).reshape(len(open_), len(starts)).sum(axis=1)
        for direction, k, count in zip(open_, level, survived, strict=True):
            tried[direction][int(k)] = int(count)
            side = passed if count >= push.success * len(starts) else failed
            side[direction] = k
    fitted = [level_at(record, len(starts), push) for record in tried]
    return {
        "starts": stored.name,
        "starts_hash": stored.hash,
        "direction_deg": np.degrees(angles).round(6).tolist(),
        "max_impulse": (passed * push.resolution).tolist(),
        "mean_max_impulse": float(passed.mean() * push.resolution),
        "fitted_impulse": fitted,
        "mean_fitted_impulse": float(np.mean(fitted)),
        "episodes": len(starts),
        "levels": [[k * push.resolution for k in sorted(record)] for record in tried],
        "successes": [[record[k] for k in sorted(record)] for record in tried],
        "unpushed_successes": unpushed_successes,
    }


def pushed_starts(push: PushConfig, stored: StartSet) -> Starts:
    """All phases of a settled gait cycle, at equally spaced speeds."""
    grid = stored.rows("nominal")[0]
    speeds = np.round(np.linspace(0, grid.shape[1] - 1, push.speeds)).astype(int)
    return stored["nominal"][grid[:, speeds].ravel()]


def pushed(base: Job, angles: Array, impulse: Array) -> Job:
    """The episodes of a job once for each direction and its impulse [Ns]."""
    n = len(base.starts)
    rows = np.tile(np.arange(n), len(angles))
    push = base.config.push
    vectors = impulse[:, None] * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    at = np.full(len(rows), to_ticks(push.before))
    pushes = Pushes(np.repeat(vectors, n, axis=0), at, to_ticks(push.duration))
    return replace(base[rows], episode=np.arange(len(rows)), pushes=pushes)


def success(outcome: IntArray) -> BoolArray:
    """True where a robot neither fell nor stopped stepping."""
    return outcome == Outcome.SUCCESS


def level_at(successes: dict[int, int], episodes: int, push: PushConfig) -> float:
    """Impulse [Ns] at which a falling curve, fitted to the successes of each level, meets 80 %."""
    levels = np.array(sorted(successes))
    share = np.array([successes[k] for k in levels]) / episodes
    curve = isotonic_regression(share, increasing=False).x
    below = np.flatnonzero(curve < push.success)
    if not below.size:
        return float(levels[-1] * push.resolution)
    if below[0] == 0:
        return 0.0
    k = below[0]
    part = (curve[k - 1] - push.success) / (curve[k - 1] - curve[k])
    return float((levels[k - 1] + part * (levels[k] - levels[k - 1])) * push.resolution)
