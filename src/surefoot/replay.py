"""What there is to play: a run's policy from standing, or one of its episodes, bit for bit."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from surefoot.config import Config
from surefoot.episodes import Job, expert_name
from surefoot.methods.rollouts import EPISODES_PER_ITERATION
from surefoot.policy import load
from surefoot.robot import solo12, standing
from surefoot.run import open_run
from surefoot.starts import Starts, at_rest
from surefoot.types import Command, to_ticks


def method_module(name: str) -> ModuleType:
    """The method's file; it holds a function of the same name, and `collection`."""
    return import_module(f"surefoot.methods.{name}")


def standing_start(command: Command) -> Starts:
    """One robot at rest in its nominal pose, at the beginning of the gait cycle."""
    return at_rest(standing(solo12()), np.array([command]))


def find_policy(target: Path) -> tuple[Path, Config]:
    """A run's best policy and config; or a policy file, and the config of the run it lies in.

    Raises:
        RunError: the folder holds no finished run.
        FileNotFoundError: there is neither a folder nor a file.
        PolicyFileError: the file is damaged, or of another robot, layout or version.
    """
    if target.is_dir():
        run = open_run(target)
        policy, config = run.best_policy, run.config
    elif target.exists():
        policy = target.resolve()
        folder = policy.parent.parent
        if (folder / "config.json").exists():
            config = open_run(folder).config
        else:
            config = Config()
            print(f"{target} lies in no run: simulator and expert as by default")
    else:
        raise FileNotFoundError(f"{target}: there is no such run folder or policy file")
    loaded = load(policy, solo12(config.robot).name)  # fails here, not later in a worker
    if loaded.period_ticks != to_ticks(config.gait.period):
        raise ValueError(
            f"{policy} was trained for a gait period of {loaded.period_ticks} ms, the "
            f"configuration has {to_ticks(config.gait.period)} ms"
        )
    return policy, config


def recorded_episode(folder: Path, episode: int) -> Job:
    """The job that repeats one episode of a run's collection.

    Raises:
        RunError: there is no run.
        ValueError: the run has no such episode.
    """
    run = open_run(folder)
    iteration = episode // EPISODES_PER_ITERATION
    if (done := run.done("collect", iteration)) is None:
        raise ValueError(
            f"{folder} has collected nothing in iteration {iteration}, so no episode {episode}"
        )
    job: Job = method_module(run.method).collection(run, iteration)
    row = np.flatnonzero(job.episode == episode)
    if not len(row):
        raise ValueError(
            f"{folder} has no episode {episode}; iteration {iteration} has {job.episode[0]} to "
            f"{job.episode[-1]}"
        )
    if done["expert"] != expert_name(job):
        raise ValueError(
            f"the expert of {folder} was your own {done['expert']}: replay it from Python, with "
            "methods...collection(run, iteration, plan) and episodes.play_out"
        )
    return job[row]
