"""What can be played: a run's policy from standing, or one of its episodes, bit for bit.

An episode is fixed by the run's configuration, its seed and the episode's id (`runs.episode_ids`),
so nothing more has to be stored to see it again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from surefoot.config import RobotConfig
from surefoot.learning.frames import concatenate
from surefoot.methods import METHODS
from surefoot.mpc.expert import Expert
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.jobs import Job, expert_name, play_out, summarize_job
from surefoot.rollouts.latching import latched_in_words
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import settled_part, velocities
from surefoot.runs.episode_ids import EpisodeId
from surefoot.runs.layout import ATTEMPTS_FILE
from surefoot.runs.metrics import Collected
from surefoot.runs.own_expert import check_expert
from surefoot.runs.query import Query
from surefoot.runs.run import Run, open_run
from surefoot.runs.versions import warn_of_versions
from surefoot.scenarios.starts import Starts, at_rest
from surefoot.types import TICKS_PER_SECOND, Command, PlanFunction


@dataclass(frozen=True)
class EpisodeReport:
    """How an episode that was played out ended, and who drove.

    Attributes:
        outcome: Name of the `Outcome`.
        command: Velocity command vx, vy [m/s] and yaw rate [rad/s].
        mean_velocity: Mean velocity in the heading frame from 1 s on, or over the second half of a
            shorter episode: vx, vy [m/s] and yaw rate [rad/s].
        max_torque: Largest joint torque [N m].
        seconds: Time that the episode lasted [s].
        episode: Id of the episode; None if no run recorded it.
        drove_last: Who drove the last tick.
        takeovers: Number of times that the expert took over before the tail.
        expert_share: Share of the time before the tail that the expert drove.
        pushes: Times at which a push began [s].
        latched: What would have switched off an actual robot, and when, in words; empty if nothing,
            None without a hardware profile.
    """

    outcome: str
    command: tuple[float, float, float]
    mean_velocity: tuple[float, float, float]
    max_torque: float
    seconds: float
    episode: int | None
    drove_last: Literal["expert", "policy"]
    takeovers: int
    expert_share: float
    pushes: tuple[float, ...]
    latched: str | None = None


def standing_start(command: Command, robot: RobotConfig | None = None) -> Starts:
    """One robot at rest in its nominal pose, at the beginning of the gait cycle.

    Args:
        command: The velocity that is commanded.
        robot: Which robot; None for Solo12.
    """
    return at_rest(standing(load_robot(robot or "solo12")), np.array([command]))


def recorded_episode(
    folder: Path, episode: int, iteration: int | None = None, plan: PlanFunction | None = None
) -> Job:
    """The job that repeats one episode of a run's collection, alone, to the same bits.

    A query of LocoDAGGER starts from a state of another rollout, so that rollout is played first.
    Warns if the run began with other versions than those installed.

    Args:
        folder: Folder of the run.
        episode: Id of the episode; with an iteration, its index there.
        iteration: Iteration that collected it; None if the episode is given by its id.
        plan: The expert's MPC if it was the user's own; None for the BiConMP-style planner.

    Raises:
        RunError: There is no run, or its expert's plans at the fixed states were different.
        FileNotFoundError: The policy or gate that drove is missing.
        ValueError: The run has no such episode, a robot recorded it, or its expert has another
            name.
    """
    run = open_run(folder)
    place = _place_of(episode, iteration)
    collected = _collected_by(run, place)
    if place.iteration > 0 and (folder / ATTEMPTS_FILE).exists():
        raise ValueError(
            f"episode {place.number} was recorded on a robot, and no simulation repeats it; if a "
            f"fault ended it, `surefoot play {folder}/flights/{place.number}.npz` films it"
        )
    job = METHODS[run.method].collection(run, place.iteration, plan)
    if collected.expert != expert_name(job):
        raise ValueError(
            f"the expert of {folder} was {collected.expert}, not {expert_name(job)}: replay an "
            "episode of your own expert from Python, with "
            "surefoot.viz.replay.recorded_episode(folder, episode, plan=your_plan) and "
            "surefoot.rollouts.jobs.play_out"
        )
    check_expert(run, plan)
    warn_of_versions(run)
    if run.config.budget.expert_seconds is not None:
        job = job[np.arange(collected.episodes)]  # those that it paid for
    alone = _alone(job, place)
    if alone is None:
        raise ValueError(f"{folder} has no episode {place.number}; {_range_of(job, place)}")
    return replace(alone, then=None)


def _place_of(episode: int, iteration: int | None) -> EpisodeId:
    """The place of an episode that is given by its id, or by an iteration and its index there."""
    place = EpisodeId.from_number(episode)
    if iteration is None:
        return place
    if place.iteration != 0:
        raise ValueError(
            f"episode {episode} of iteration {iteration}: with an iteration, an episode is an "
            f"index from 0 on; the id {episode} is given without an iteration"
        )
    return replace(place, iteration=iteration)


def _collected_by(run: Run, place: EpisodeId) -> Collected:
    """The record of the iteration that collected an episode.

    Raises:
        ValueError: That iteration has collected nothing.
    """
    collected = run.collected(place.iteration)
    if collected is None:
        iterations = [r.iteration for r in run.metrics if isinstance(r, Collected)]
        available = f"iterations 0 to {max(iterations)}" if iterations else "nothing yet"
        raise ValueError(
            f"{run.folder} has collected nothing in iteration {place.iteration}, so there is no "
            f"episode {place.number}; it has collected {available}"
        )
    return collected


def _alone(job: Job, place: EpisodeId) -> Job | None:
    """An episode of a job, or a query that follows it, as a separate job; None if there is none."""
    alone = job[job.episode == place.rollout.number]
    if len(alone.episode) == 0:
        return None
    if place.query is None:
        return alone
    if job.then is None:
        return None
    rollouts, _ = play_out(alone)
    queries = job.then(alone, rollouts)
    if queries is None:
        return None
    alone = queries[queries.episode == place.number]
    return alone if len(alone.episode) else None


def _range_of(job: Job, place: EpisodeId) -> str:
    """The episodes of the same iteration, in words."""
    i = place.iteration
    count = len(job.episode)
    first = EpisodeId(i, 0)
    last = EpisodeId(i, count - 1)
    text = f"iteration {i} has 0 to {last.index}, ids {first.number} to {last.number}"
    if isinstance(job.then, Query):
        first = replace(first, query=0)
        last = replace(first, query=job.then.N_query - 1)
        text += (
            f", and of rollout 0 at most {job.then.N_query} queries, ids {first.number} to "
            f"{last.number}"
        )
    return text


def report_episode(
    job: Job, rollouts: Rollout, expert: Expert, episode: int | None = None
) -> EpisodeReport:
    """How the first episode of a job that was played out ended, and who drove.

    Args:
        job: The job.
        rollouts: Its rollouts.
        expert: The expert that took part in them.
        episode: Id of the episode, if it is one that a run recorded.
    """
    summary = summarize_job(job, rollouts, expert, concatenate([]))
    length = int(rollouts.length[0])
    shown = max(length, 1)  # if the expert gives up at once, the start
    velocity = velocities(rollouts)[0, settled_part(shown)].mean(axis=0)
    profile = load_robot(job.config.robot).profile
    return EpisodeReport(
        outcome=Outcome(int(rollouts.outcome[0])).name,
        command=tuple(job.starts.command[0].tolist()),
        mean_velocity=tuple(velocity.tolist()),
        max_torque=float(np.abs(rollouts.torque[0, :length]).max(initial=0.0)),
        seconds=length / TICKS_PER_SECOND,
        episode=episode,
        drove_last="expert" if rollouts.expert_drove[0, shown - 1] else "policy",
        takeovers=int(summary.takeovers[0]),
        expert_share=float(summary.expert_ticks[0] / max(summary.proper_ticks[0], 1)),
        pushes=tuple(tick / TICKS_PER_SECOND for tick in push_ticks(rollouts)),
        latched=None if profile is None else latched_in_words(rollouts, profile),
    )


def push_ticks(rollouts: Rollout) -> tuple[int, ...]:
    """Ticks at which pushes began in the first of some episodes [ms]."""
    pushes = rollouts.disturbance.pushes
    return () if pushes is None else pushes.begun(0, int(rollouts.length[0]))
