"""Push recovery: the largest impulse on the base that a robot takes from each direction.

A push lasts 10 ms, from one of eight directions in the robot's heading frame, two seconds after a
perturbed start; a level is survived if at least 80 % of the robots neither fall nor stop stepping
(paper, IV-F). Those two seconds are the same for every push: they are simulated once, and each
push branches off from the states they end in. The levels tried are bisected; over all of them a
monotone curve is fitted, and read at 80 %. Robots are drawn anew for its interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import isotonic_regression

from surefoot.config import Config, PushConfig
from surefoot.evaluation.statistics import percentiles, resamples
from surefoot.files import as_digits, from_digits
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job, chunks_of, disturbance_of, play_out, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.disturbance import Pushes
from surefoot.scenarios.starts import Starts, StartSet, join_starts, load_starts
from surefoot.types import Array, BoolArray, PlanFunction, to_ticks
from surefoot.workers import Workers, map_chunks


def push_recovery(
    config: Config,
    policy: Path | None,
    workers: Workers,
    label: str,
    plan: PlanFunction | None = None,
    stored: StartSet | None = None,
) -> dict[str, Any]:
    """Largest impulse survived by a policy, or by the expert, from each direction.

    Args:
        config: of robot, simulator, expert, of the pushes, and of what else disturbs the robots
            (`evaluation.disturbance`; its own pushes and fall angle are left out).
        policy: file of the policy; None pushes the expert.
        workers: who runs the episodes.
        label: of the progress bars.
        plan: the expert's MPC; without it the BiConMP-style planner.
        stored: the set of starts; without it the package's first.

    Returns:
        ``direction_deg`` (0 is forward, 90 to the left), and for each of them ``max_impulse`` [Ns],
        the largest level survived, and ``fitted_impulse`` [Ns], where a monotone fit meets the
        ``share`` asked for, with its ``interval``; their means ``mean_max_impulse`` and
        ``mean_fitted_impulse``, with ``mean_interval``. All that was tried: ``levels`` [Ns], 0 the
        unpushed control arm; at each ``successes`` of ``episodes``, and ``survived``, a string of
        1 and 0, robot by robot. ``lost_before`` fell before the push, and fail at every level.
        Intervals are 95 % percentile bootstrap intervals over robots, given the levels tried; of
        simulated robots with normal limits they held the true limit 91 to 95 times in a hundred.
        Where robots fail even unpushed the impulse is 0; where they survive the strongest level it
        is that, and so is the end of its interval.

    Raises:
        ValueError: more speeds asked for than the split has.
    """
    push, stored = config.push, stored or load_starts()
    starts = pushed_starts(push, stored)
    begin = Job(
        replace(config, safety=replace(config.safety, fall_angle=push.fall_angle)),
        Episodes(starts, push.before),
        ExpertOnly() if policy is None else PolicyOnly(),
        policy=policy,
        plan=plan,
        disturbance=replace(config.evaluation.disturbance, pushes=0, fall_angle=0.0),
    )
    branch, up = branched(begin, workers, f"{label}: before the push")
    needed = enough(push.success, len(starts))

    def survivors(angles: Array, impulse: Array) -> BoolArray:
        """``(directions, robots)`` True for those up and stepping after their pushes."""
        result = np.zeros((len(angles), len(starts)), bool)
        if up.any():
            text = f"{label}: {np.count_nonzero(impulse)} pushes"
            outcome = run_episodes(pushed(branch, angles, impulse), workers, text).outcome
            result[:, up] = (outcome == Outcome.SUCCESS).reshape(len(angles), -1)
        return result

    angles = 2 * np.pi * np.arange(push.directions) / push.directions
    control = survivors(np.zeros(1), np.zeros(1))[0]
    # Level k is k * resolution; the search keeps a level that passed and one that failed.
    passed = np.zeros(len(angles), int)
    failed = np.full(len(angles), push.levels + 1 if control.sum() >= needed else 0)
    tried: list[dict[int, BoolArray]] = [{0: control} for _ in angles]
    while (open_ := np.flatnonzero(failed - passed > 1)).size:
        level = (passed + failed)[open_] // 2
        stand = survivors(angles[open_], level * push.resolution)
        for direction, k, robots in zip(open_, level.tolist(), stand, strict=True):
            tried[direction][k] = robots
            side = passed if robots.sum() >= needed else failed
            side[direction] = k
    figures: dict[str, Any] = {
        "starts": stored.name,
        "starts_hash": stored.hash,
        "split": push.split,
        "episodes": len(starts),
        "lost_before": int((~up).sum()),
        "share": push.success,
        "direction_deg": np.degrees(angles).round(6).tolist(),
        "max_impulse": (passed * push.resolution).tolist(),
        "mean_max_impulse": float(passed.mean() * push.resolution),
        "levels": [[k * push.resolution for k in sorted(record)] for record in tried],
        "successes": [[int(record[k].sum()) for k in sorted(record)] for record in tried],
        "survived": [[as_digits(record[k]) for k in sorted(record)] for record in tried],
    }
    fitted = [
        level_at(levels, counts, needed)
        for levels, counts in zip(figures["levels"], figures["successes"], strict=True)
    ]
    drawn = resampled(figures)
    return {
        **figures,
        "fitted_impulse": fitted,
        "interval": [percentiles(column) for column in drawn.T],
        "mean_fitted_impulse": float(np.mean(fitted)),
        "mean_interval": percentiles(drawn.mean(axis=1)),
    }


def push_difference(a: dict[str, Any], b: dict[str, Any]) -> dict[str, Any]:
    """How much more impulse one controller takes than another from the same starts.

    Args:
        a: what `push_recovery` returned.
        b: the same of the other.

    Returns:
        ``difference`` [Ns] of the mean fitted impulses, a minus b, and ``interval``, its 95 %
        bootstrap interval: a robot is drawn together in both, in all directions and levels.

    Raises:
        ValueError: the two were not taken on the same starts, directions and share.
    """
    for key in ("starts_hash", "split", "episodes", "direction_deg", "share"):
        if a[key] != b[key]:
            raise ValueError(
                f"pushes of different {key}, {a[key]} and {b[key]}: only robots from the same "
                "starts, pushed the same way, can be compared in pairs"
            )
    return {
        "difference": a["mean_fitted_impulse"] - b["mean_fitted_impulse"],
        "interval": percentiles((resampled(a) - resampled(b)).mean(axis=1)),
    }


def pushed_starts(push: PushConfig, stored: StartSet) -> Starts:
    """All phases of the first perturbation of a split, at equally spaced speeds.

    Raises:
        ValueError: there are not so many speeds.
    """
    speeds = stored.velocities(push.split, push.speeds)
    grid = stored.rows(push.split)[0]
    return stored[push.split][grid[:, speeds].ravel()]


def branched(begin: Job, workers: Workers, label: str) -> tuple[Job, BoolArray]:
    """The episodes of a job from the time of the push on, unpushed; and who is up by then.

    Returns:
        The job of those that are up, and ``(n,)`` True for them among the job's starts.
    """
    parts = map_chunks(states_at_the_end, chunks_of(begin), workers, label)
    up = np.concatenate([up for _, up in parts])
    states = join_starts([states for states, _ in parts])[up]
    # Falls are tested at once: the grace is for starts that no robot walked into.
    config = replace(begin.config, safety=replace(begin.config.safety, grace=0.0))
    # The ids stay: each robot keeps its floor and its load, in every direction and level.
    episodes = Episodes(states, config.push.after, id=begin.episode[up])
    return replace(begin, config=config, episodes=episodes), up


def states_at_the_end(job: Job) -> tuple[Starts, BoolArray]:
    """Starts at the states in which the episodes of one chunk end, and who is up by then."""
    ticks = to_ticks(job.episodes.duration)
    # A state is recorded before its tick is made: one tick more records the last.
    longer = replace(job.episodes, duration=job.episodes.duration + 1e-3)
    record, _ = play_out(replace(job, episodes=longer))
    tick = job.starts.tick + ticks
    states = replace(job.starts, q=record.q[:, ticks], v=record.v[:, ticks], tick=tick)
    return states, record.length > ticks


def pushed(branch: Job, angles: Array, impulse: Array) -> Job:
    """The episodes of a job once for each direction and its impulse [Ns], pushed at once."""
    n = len(branch.starts)
    rows = np.tile(np.arange(n), len(angles))
    vectors = impulse[:, None] * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    at, duration = np.zeros((len(rows), 1), int), to_ticks(branch.config.push.duration)
    pushes = Pushes(np.repeat(vectors, n, axis=0)[:, None], at, duration)
    job = branch[rows]
    disturbance = replace(disturbance_of(job), pushes=pushes)
    return replace(job, episodes=replace(job.episodes, disturbance=disturbance))


def enough(share: float, n: int) -> float:
    """Robots that have to survive: a share of n, rounded, since 0.7 * 10 is above 7."""
    return round(share * n, 9)


def level_at(levels: Sequence[float], successes: ArrayLike, needed: float) -> float:
    """Impulse [Ns] at which a falling curve, fitted to the successes of each level, meets a number.

    Args:
        levels: rising [Ns].
        successes: robots that survived each.
        needed: robots that have to.
    """
    curve = isotonic_regression(np.asarray(successes), increasing=False).x.round(9)
    below = np.flatnonzero(curve < needed)
    if not below.size:
        return float(levels[-1])
    k = int(below[0])
    if k == 0:
        return 0.0
    part = (curve[k - 1] - needed) / (curve[k - 1] - curve[k])
    return float(levels[k - 1] + part * (levels[k] - levels[k - 1]))


def resampled(figures: dict[str, Any]) -> Array:
    """``(resamples, directions)`` fitted impulses [Ns] of robots drawn anew."""
    n = figures["episodes"]
    needed, draws, columns = enough(figures["share"], n), resamples(n), []
    for levels, texts in zip(figures["levels"], figures["survived"], strict=True):
        counts = draws @ np.array([from_digits(text) for text in texts]).T
        columns.append([level_at(levels, row, needed) for row in counts])
    return np.array(columns).T
