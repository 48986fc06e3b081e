"""Push recovery: the largest impulse on the base that a robot withstands from each direction.

A push lasts 10 ms and comes from one of eight directions in the robot's heading frame, two seconds
after a perturbed start; a level is survived if at least 80 % of the robots neither fall nor stop
stepping (paper, IV-F). Those two seconds are the same for every push: they are simulated once, and
each push branches off from the states in which they end. The levels tried are bisected; a monotone
curve is fitted over all of them and read at 80 %. Its interval draws the robots anew. Next:
`push_fit`, the curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surefoot.config import Config, PushConfig
from surefoot.evaluation.push_fit import fitted_level, resampled_impulses, robots_needed
from surefoot.evaluation.robustness import controller_title
from surefoot.evaluation.statistics import Interval, percentiles
from surefoot.files import as_digits
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes, join_episodes
from surefoot.rollouts.jobs import Job, chunks_of, disturbance_of, play_out, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.disturbance import Pushes
from surefoot.scenarios.starts import Starts, StartSet, load_starts
from surefoot.types import Array, BoolArray, PlanFunction, to_ticks
from surefoot.workers import Workers, map_chunks


@dataclass(frozen=True)
class PushLimits:
    """What was tried from each of D directions, and the impulses that a controller withstands.

    Where robots fail even unpushed the impulse is 0; where they survive the strongest level it is
    that level.

    Attributes:
        starts: Name of the set of initial states.
        starts_hash: SHA-256 of that set.
        episodes: Number of robots pushed at each level.
        direction_deg: ``(D,)`` directions of the pushes [deg]; 0 is forward, 90 to the left.
        max_impulse: ``(D,)`` largest level survived [N s].
        mean_max_impulse: Mean of `max_impulse` over the directions [N s].
        fitted_impulse: ``(D,)`` impulse at which the monotone fit meets the share of robots that
            have to survive [N s].
        mean_fitted_impulse: Mean of `fitted_impulse` over the directions [N s].
        levels: For each direction, the levels tried, rising [N s]; 0 is the unpushed control.
        successes: For each direction, the number of robots that survived each of its levels.
    """

    starts: str
    starts_hash: str
    episodes: int
    direction_deg: tuple[float, ...]
    max_impulse: tuple[float, ...]
    mean_max_impulse: float
    fitted_impulse: tuple[float, ...]
    mean_fitted_impulse: float
    levels: tuple[tuple[float, ...], ...]
    successes: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class PushResult(PushLimits):
    """The push limits of a controller, with intervals and with the outcome of every robot.

    Intervals are 95 % percentile bootstrap intervals over robots, given the levels tried. For
    robots with normally distributed limits, they covered the true limit in 91 to 95 of 100 trials.
    Where robots survive the strongest level, the interval ends there too.

    Attributes:
        split: Split of the initial states.
        lost_before: Number of robots that fell before the push; they fail at every level.
        share: Share of the robots that has to survive a level.
        survived: For each direction and each of its levels, one digit per robot: 1 if it survived.
        interval: ``(D,)`` intervals of `fitted_impulse` [N s].
        mean_interval: Interval of `mean_fitted_impulse` [N s].
    """

    split: str
    lost_before: int
    share: float
    survived: tuple[tuple[str, ...], ...]
    interval: tuple[Interval, ...]
    mean_interval: Interval


@dataclass(frozen=True)
class PushDifference:
    """How much more impulse one controller withstands than another.

    Attributes:
        difference: Difference of the mean fitted impulses [N s].
        interval: Its 95 % bootstrap interval [N s]; each draw takes the same robots in both arms,
            in all directions and at all levels.
    """

    difference: float
    interval: Interval


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
    stored: StartSet | None = None,
) -> PushResult:
    """Largest impulse that a policy, or the expert, withstands from each direction.

    Args:
        config: Robot, simulator, expert, and the pushes; also what else disturbs the robots
            (`evaluation.disturbance`, without its own pushes and fall angle).
        policy: File of the policy; None pushes the expert.
        workers: Processes that run the episodes.
        plan: The expert's MPC; without it the BiConMP-style planner.
        stored: The set of initial states; without it the package's first.

    Raises:
        ValueError: The configuration asks for more speeds than the split has.
    """
    stored = stored or load_starts()
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
    )
    title = controller_title(config, policy)
    branch = branch_at_push(begin, workers, f"{title}: before the push")
    angles = 2 * np.pi * np.arange(push.directions) / push.directions
    tried = search_levels(branch, angles, workers, title)
    return push_result(stored, push, branch.up, angles, tried)


def push_difference(a: PushResult, b: PushResult) -> PushDifference:
    """How much more impulse one controller withstands than another from the same initial states.

    Args:
        a: The pushes of one controller.
        b: The pushes of the other, which is subtracted.

    Raises:
        ValueError: The two differ in initial states, directions or share.
    """
    for name, of_a, of_b in (
        ("starts_hash", a.starts_hash, b.starts_hash),
        ("split", a.split, b.split),
        ("episodes", a.episodes, b.episodes),
        ("direction_deg", a.direction_deg, b.direction_deg),
        ("share", a.share, b.share),
    ):
        if of_a != of_b:
            raise ValueError(
                f"pushes of different {name}, {of_a} and {of_b}: only robots from the same "
                "starts, pushed the same way, can be compared in pairs"
            )
    needed = robots_needed(a.share, a.episodes)
    drawn_a = resampled_impulses(a.levels, a.survived, needed)
    drawn_b = resampled_impulses(b.levels, b.survived, needed)
    return PushDifference(
        difference=a.mean_fitted_impulse - b.mean_fitted_impulse,
        interval=percentiles((drawn_a - drawn_b).mean(axis=1)),
    )


def pushed_starts(push: PushConfig, stored: StartSet) -> Starts:
    """All phases of the first perturbation of a split, at equally spaced speeds.

    Raises:
        ValueError: The split has fewer speeds than asked for.
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
    # Falls are tested at once: the grace is for initial states that no robot walked into.
    config = replace(begin.config, safety=replace(begin.config.safety, grace=0.0))
    # The ids stay, and so do friction, load, noise and late torques, for every push.
    episodes = join_episodes([chunk for chunk, _ in parts])
    return Branch(replace(begin, config=config, episodes=episodes), up)


def branch_at_the_end(job: Job) -> tuple[Episodes, BoolArray]:
    """Run the episodes of one chunk.

    Returns:
        The episodes that go on where they end, of the robots that are still up; and ``(B,)`` True
        for these robots.
    """
    ticks = to_ticks(job.episodes.duration)
    # A state is recorded before its tick is made: one tick more records the last.
    longer = replace(job.episodes, duration=job.episodes.duration + 1e-3)
    rollouts, _ = play_out(replace(job, episodes=longer))
    up = rollouts.length > ticks
    robot = np.flatnonzero(up)
    elapsed = np.full(len(robot), ticks)
    return rollouts.branch(robot, elapsed, job.config.push.after, job.episode[up]), up


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
    robots that fail unpushed are not pushed.

    Args:
        branch: The n robots at the time of the push.
        angles: ``(D,)`` directions [rad].
        workers: Processes that run the episodes.
        title: What the progress bars call the controller.

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
    while (failed - passed > 1).any():
        unsettled = np.flatnonzero(failed - passed > 1)
        level = (passed + failed)[unsettled] // 2
        survived = branch.survivors(
            angles[unsettled],
            level * push.resolution,
            workers,
            f"{title}: {len(unsettled)} pushes",
        )
        for direction, k, robots in zip(unsettled, level.tolist(), survived, strict=True):
            tried[direction][k] = robots
            if robots.sum() >= needed:
                passed[direction] = k
            else:
                failed[direction] = k
    return tried


def push_result(
    stored: StartSet,
    push: PushConfig,
    up: BoolArray,
    angles: Array,
    tried: Sequence[dict[int, BoolArray]],
) -> PushResult:
    """The result of a search.

    Args:
        stored: The set of initial states.
        push: The pushes.
        up: ``(n,)`` True for the robots that were up at the time of the push.
        angles: ``(D,)`` directions [rad].
        tried: For each direction, level -> ``(n,)`` True for the robots that survived it.
    """
    n = len(up)
    needed = robots_needed(push.success, n)
    levels = tuple(tuple(k * push.resolution for k in sorted(each)) for each in tried)
    successes = tuple(tuple(int(each[k].sum()) for k in sorted(each)) for each in tried)
    survived = tuple(tuple(as_digits(each[k]) for k in sorted(each)) for each in tried)
    passed = np.array(
        [max((k for k in each if each[k].sum() >= needed), default=0) for each in tried]
    )
    fitted = tuple(
        fitted_level(levels_tried, counts, needed)
        for levels_tried, counts in zip(levels, successes, strict=True)
    )
    drawn = resampled_impulses(levels, survived, needed)
    return PushResult(
        starts=stored.name,
        starts_hash=stored.hash,
        episodes=n,
        direction_deg=tuple(np.degrees(angles).round(6).tolist()),
        max_impulse=tuple((passed * push.resolution).tolist()),
        mean_max_impulse=float(passed.mean() * push.resolution),
        fitted_impulse=fitted,
        mean_fitted_impulse=float(np.mean(fitted)),
        levels=levels,
        successes=successes,
        split=push.split,
        lost_before=int((~up).sum()),
        share=push.success,
        survived=survived,
        interval=tuple(percentiles(impulses) for impulses in drawn.T),
        mean_interval=percentiles(drawn.mean(axis=1)),
    )
