"""What there is to play: a run's policy from standing, or one of its episodes, bit for bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.learning.frames import concatenate
from surefoot.methods import METHODS
from surefoot.mpc.expert import Expert
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.engine import Rollout
from surefoot.rollouts.jobs import Job, disturbance_of, expert_name, play_out, summarize_job
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.query import QUERIES, Query
from surefoot.runs.run import open_run, warn_of_versions
from surefoot.runs.sampling import EPISODES_PER_ITERATION
from surefoot.scenarios.starts import Starts, at_rest
from surefoot.types import TICKS_PER_SECOND, Command


def standing_start(command: Command) -> Starts:
    """One robot at rest in its nominal pose, at the beginning of the gait cycle."""
    return at_rest(standing(solo12()), np.array([command]))


def recorded_episode(folder: Path, episode: int, iteration: int | None = None) -> Job:
    """The job that repeats one episode of a run's collection, alone, to the same bits.

    A query of LocoDAGGER starts from a state of another rollout, which is played first for that.
    Warns if the run was begun with other versions than these.

    Args:
        folder: of the run.
        episode: its id; with an iteration its index there.
        iteration: that collected it.

    Raises:
        RunError: there is no run.
        FileNotFoundError: the policy or gate that drove is lost.
        ValueError: the run has no such episode, or the expert was the user's own.
    """
    run = open_run(folder)
    if iteration is not None:
        if not 0 <= episode < EPISODES_PER_ITERATION:
            raise ValueError(
                f"episode {episode} of iteration {iteration}: with an iteration, an episode is an "
                f"index from 0 on; the id {episode} is given without an iteration"
            )
        episode += iteration * EPISODES_PER_ITERATION
    iteration = episode // EPISODES_PER_ITERATION
    if (done := run.done("collect", iteration)) is None:
        collected = [line["iteration"] for line in run.metrics if line["stage"] == "collect"]
        there = f"iterations 0 to {max(collected)}" if collected else "nothing yet"
        raise ValueError(
            f"{folder} has collected nothing in iteration {iteration}, so there is no episode "
            f"{episode}; it has collected {there}"
        )
    job = METHODS[run.method].collection(run, iteration, None)
    if done["expert"] != expert_name(job):
        raise ValueError(
            f"the expert of {folder} was your own {done['expert']}: replay it from Python, with "
            "methods...collection(run, iteration, plan) and episodes.play_out"
        )
    warn_of_versions(run)
    found: Job | None = job[job.episode == _parent(job, episode)]
    if found.then is not None and len(found.episode) and found.episode[0] != episode:
        found = found.then(found, play_out(found)[0])
        found = found and found[found.episode == episode]
    if found is None or not len(found.episode):
        raise ValueError(f"{folder} has no episode {episode}; {_range(job, iteration)}")
    return replace(found, then=None)


def _parent(job: Job, episode: int) -> int:
    """The episode of the job that this one is, or follows from."""
    return job.then.parent(episode) if isinstance(job.then, Query) else episode


def _range(job: Job, iteration: int) -> str:
    """Which episodes an iteration has, in words."""
    count, base = len(job.episode), iteration * EPISODES_PER_ITERATION
    words = f"iteration {iteration} has 0 to {count - 1}, ids {base} to {base + count - 1}"
    if isinstance(job.then, Query):
        first, last = QUERIES, QUERIES + count * job.then.N_query - 1
        words += (
            f", and queries {first} to {last}, ids {base + first} to {base + last}, of rollouts "
            "that lasted long enough"
        )
    return words


def episode_figures(job: Job, record: Rollout, expert: Expert) -> dict[str, Any]:
    """How the first episode of a job that was played out ended, and who drove.

    ``outcome``; ``command`` [m/s, m/s, rad/s]; ``seconds`` it lasted; ``max_torque`` [Nm];
    ``drove_last`` is who drove the last tick; ``takeovers`` and ``expert_share`` are before the
    tail; ``pushes`` are the times at which one began [s].
    """
    summary, length = summarize_job(job, record, expert, concatenate([])), int(record.length[0])
    return {
        "outcome": Outcome(int(record.outcome[0])).name,
        "command": job.starts.command[0].tolist(),
        "seconds": length / TICKS_PER_SECOND,
        "max_torque": float(np.abs(record.torque[0, :length]).max(initial=0.0)),
        "drove_last": "expert" if record.expert_drove[0, max(length - 1, 0)] else "policy",
        "takeovers": int(summary.takeovers[0]),
        "expert_share": float(summary.expert_ticks[0] / max(summary.proper_ticks[0], 1)),
        "pushes": [tick / TICKS_PER_SECOND for tick in pushes_of(job, record)],
    }


def pushes_of(job: Job, record: Rollout) -> tuple[int, ...]:
    """Ticks at which pushes began in the first episode of a job that was played out."""
    pushes = disturbance_of(job).pushes
    return () if pushes is None else pushes.begun(0, int(record.length[0]))
