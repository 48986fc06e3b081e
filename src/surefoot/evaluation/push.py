"""Push recovery: the largest impulse on the base that a robot withstands from each direction.

A push lasts 10 ms and comes from one of eight directions in the robot's heading frame, two seconds
after a perturbed start; a level is survived if at least 80 % of the robots neither fall nor stop
stepping (paper, IV-F). These two seconds are the same for every push, so they are simulated once,
and each push branches off from the states at their end. The search bisects the levels; a monotone
curve is fitted to all levels tried and read at 80 %. Its interval comes from resampled robots, and
is no narrower than the levels and the number of robots allow. Next: `push_limits`, the records, and
`push_fit`, the curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surefoot.config import Config, PushConfig
from surefoot.config.checked import known
from surefoot.evaluation.push_fit import refuting_counts, robots_needed
from surefoot.evaluation.push_limits import PushResult, result_of_search
from surefoot.evaluation.robustness import controller_title
from surefoot.learning.policy import Policy
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes, join_episodes
from surefoot.rollouts.jobs import Job, chunks_of, disturbance_of, play_out, run_episodes
from surefoot.rollouts.outcome import Outcome, judged_from
from surefoot.scenarios.disturbance import Pushes
from surefoot.scenarios.starts import Starts, StartSet, starts_of
from surefoot.types import Array, BoolArray, IntArray, PlanFunction, to_ticks
from surefoot.workers import Workers, map_chunks


@dataclass(frozen=True)
class Branch:
    """The robots at the time of the push, from which every push branches off.

    Attributes:
        job: The episodes from the push on, unpushed, of the robots that are still up.
        up: ``(n,)`` True for those robots among all n.
    """

    job: Job
    up: BoolArray

    def survivors(self, angles: Array, impulses: Array, workers: Workers, title: str) -> BoolArray:
        """Push every robot once from each direction.

        Args:
            angles: ``(D,)`` directions [rad].
            impulses: ``(D,)`` impulse from each of them [N s].
            workers: Processes that run the episodes.
            title: Text of the progress bar.

        Returns:
            ``(D, n)`` True for the robots that are up and stepping after their pushes.
        """
        survived = np.zeros((len(angles), len(self.up)), bool)
        if self.up.any():
            summary = run_episodes(pushed_job(self.job, angles, impulses), workers, title)
            success = summary.outcome == Outcome.SUCCESS
            survived[:, self.up] = success.reshape(len(angles), -1)
        return survived


def push_recovery(
    config: Config,
    policy: Path | None,
    workers: Workers,
    plan: PlanFunction | None = None,
) -> PushResult:
    """Largest impulse that a policy, or the expert, withstands from each direction.

    Args:
        config: Robot, simulator, expert, and the pushes; also the other disturbances
            (`evaluation.disturbance`, without its own pushes and fall angle).
        policy: File of the policy; None pushes the expert.
        workers: Processes that run the episodes.
        plan: The expert's MPC; None for the BiConMP-style planner.

    Raises:
        ValueError: The configuration has more speeds than the split.
    """
    config = with_own_values(config)
    stored = starts_of(config)
    push = config.push
    starts = pushed_starts(push, stored)
    begin = Job(
        replace(
            config, seed=stored.seed, safety=replace(config.safety, fall_angle=push.fall_angle)
        ),
        Episodes(starts, push.before, id=starts.id),
        ExpertOnly() if policy is None else PolicyOnly(),
        policy=policy,
        plan=plan,
        disturbance=replace(config.evaluation.disturbance, pushes=0, fall_angle=0.0),
        privileged=False,
    )
    title = controller_title(config, policy)
    branch = branch_at_push(begin, workers, f"{title}: before the push")
    angles = 2 * np.pi * np.arange(push.directions) / push.directions
    tried = search_levels(branch, angles, workers, title)
    return result_of_search(stored, push, branch.up, angles, tried)


def pushed_starts(push: PushConfig, stored: StartSet) -> Starts:
    """All phases of the first perturbation of a split, at equally spaced speeds.

    Raises:
        ValueError: The split has fewer speeds than `push.speeds`.
    """
    speeds = stored.velocities(push.split, push.speeds)
    grid = stored.rows(push.split)[0]
    return stored[push.split][grid[:, speeds].ravel()]


def branch_at_push(begin: Job, workers: Workers, title: str) -> Branch:
    """Run the episodes of a job, unpushed, up to the time of the push.

    Args:
        begin: The episodes before the push.
        workers: Processes that run them.
        title: Text of the progress bar.
    """
    parts = map_chunks(branch_at_the_end, chunks_of(begin), workers, title)
    up = np.concatenate([chunk_up for _, chunk_up in parts])
    # Falls count at once: the grace is only for initial states that no robot has walked into.
    config = replace(begin.config, safety=replace(begin.config.safety, grace=0.0))
    # Every push keeps the ids, and with them friction, load, noise and delayed torques.
    episodes = join_episodes([chunk for chunk, _ in parts])
    return Branch(replace(begin, config=config, episodes=episodes), up)


def branch_at_the_end(job: Job) -> tuple[Episodes, BoolArray]:
    """Run the episodes of one chunk.

    Returns:
        The episodes that continue where these end, for the robots that are still up; and ``(B,)``
        True for these robots.
    """
    ticks = to_ticks(job.episodes.duration)
    # A state is recorded at the beginning of its tick, so the last state needs one more tick.
    longer = replace(job.episodes, duration=job.episodes.duration + 1e-3)
    rollouts, _ = play_out(replace(job, episodes=longer))
    up = rollouts.length > ticks
    robot = np.flatnonzero(up)
    elapsed = np.full(len(robot), ticks)
    episodes = rollouts.branch(robot, elapsed, seconds_after(job.config), job.episode[up])
    if not (isinstance(job.policy, Policy) and job.policy.spec.remembers):
        # Otherwise every push would carry a past that nobody uses, 0.1 MB for each robot.
        episodes = replace(episodes, past=None)
    return episodes, up


def seconds_after(config: Config) -> float:
    """How long robots are watched after a push [s]: long enough to judge the steps of slow gaits.

    Args:
        config: Its `push.after` counts as it is where it is too short for any judgment.
    """
    shortest = config.safety.stepping_from
    judged = judged_from(config.safety, *config.gaits)
    if shortest is None or judged is None or config.push.after < shortest:
        return config.push.after
    return max(config.push.after, judged)


def pushed_job(job: Job, angles: Array, impulses: Array) -> Job:
    """The episodes of a job, once for each direction, pushed in their first tick.

    Args:
        job: n episodes.
        angles: ``(D,)`` directions [rad].
        impulses: ``(D,)`` impulse from each of them [N s].

    Returns:
        D * n episodes, direction by direction.
    """
    n = len(job.starts)
    rows = np.tile(np.arange(n), len(angles))
    directions = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    vectors = impulses[:, None] * directions
    tick = np.zeros((len(rows), 1), int)
    duration = to_ticks(job.config.push.duration)
    pushes = Pushes(np.repeat(vectors, n, axis=0)[:, None], tick, duration)
    pushed = job[rows]
    disturbance = replace(disturbance_of(pushed), pushes=pushes)
    return replace(pushed, episodes=replace(pushed.episodes, disturbance=disturbance))


def search_levels(
    branch: Branch, angles: Array, workers: Workers, title: str
) -> list[dict[int, BoolArray]]:
    """Bisect the levels of every direction, all directions together in each round.

    Level k is the impulse k * resolution. The search keeps a level that passed and one that failed;
    if robots fail without a push, no level is bisected. If even the strongest level tried does not
    clearly fail, stronger ones follow: without them the limit would have no upper bound.

    Args:
        branch: The n robots at the time of the push.
        angles: ``(D,)`` directions [rad].
        workers: Processes that run the episodes.
        title: The name of the controller in the progress bars.

    Returns:
        For each direction, level -> ``(n,)`` True for the robots that survived it.
    """
    push = branch.job.config.push
    needed = robots_needed(push.success, len(branch.up))
    nothing = np.zeros(1)
    control = branch.survivors(nothing, nothing, workers, f"{title}: no push")[0]
    passed = np.zeros(len(angles), int)
    failed = np.full(len(angles), push.levels + 1 if control.sum() >= needed else 0)
    tried: list[dict[int, BoolArray]] = [{0: control} for _ in angles]

    def push_them(which: IntArray, level: IntArray) -> None:
        impulses = level.astype(float) * known(push.resolution, "push.resolution")
        name = f"{title}: {len(which)} pushes"
        survived = branch.survivors(angles[which], impulses, workers, name)
        for direction, k, robots in zip(which, level.tolist(), survived, strict=True):
            tried[direction][k] = robots

    while (failed - passed > 1).any():
        unsettled = np.flatnonzero(failed - passed > 1)
        level = (passed + failed)[unsettled] // 2
        push_them(unsettled, level)
        for direction, k in zip(unsettled, level.tolist(), strict=True):
            if tried[direction][k].sum() >= needed:
                passed[direction] = k
            else:
                failed[direction] = k
    few, _ = refuting_counts(push.success, len(branch.up))
    while True:
        top = np.array([max(each) for each in tried])
        survivors = np.array([each[k].sum() for each, k in zip(tried, top, strict=True)])
        unclear = np.flatnonzero((survivors >= few) & (few > 0) & (top < push.levels))
        if not unclear.size:
            return tried
        push_them(unclear, (top[unclear] + push.levels + 1) // 2)
