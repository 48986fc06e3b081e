"""The initial states and disturbances of a method's rollouts, and the rules for keeping frames.

`expert_rollouts` is behavior cloning's data (paper, II-A), `pretraining_rollouts` the data that the
iterative methods begin with; `draw_starts` draws the initial states of their later iterations
(IV-E). `expert_frames` and `keep_unless_failed` are the rules that decide which frames enter D.
Read `runs.episode_ids` for the ids and `rollouts.jobs` for how a job is run.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from surefoot.config import (
    Config,
    DisturbanceConfig,
    ExpertData,
    IterativeConfig,
    TeachingSplit,
)
from surefoot.config.checked import known
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.jobs import Job
from surefoot.runs.episode_ids import rollout_ids
from surefoot.scenarios.gait_switches import draw_switches
from surefoot.scenarios.gaits import all_starts_of
from surefoot.scenarios.seeds import seed_of
from surefoot.scenarios.starts import Starts, StartSet, at_rest, join_starts
from surefoot.types import BoolArray, IntArray, PlanFunction


def rising_share(first: float, i: int, iterations: int) -> float:
    """A share that rises evenly from `first` to 1 in the last iteration; `first` if there is one.

    Args:
        first: Share in the first iteration.
        i: The iteration, from 1 on.
        iterations: Number of iterations N.
    """
    return first + (1.0 - first) * (i - 1) / max(iterations - 1, 1)


def disturbance_in(config: Config, i: int, iterations: int) -> DisturbanceConfig:
    """The disturbance in iteration i of N: pushes grow from gentle to their full size.

    Args:
        config: Configuration of the run.
        i: The iteration, from 1 on.
        iterations: Number of iterations N.
    """
    collection = config.collection
    share = rising_share(collection.gentle, i, iterations)
    low, high = known(collection.impulse, "collection.impulse")
    return replace(collection, impulse=(share * low, share * high))


def expert_rollouts(
    config: Config,
    data: ExpertData,
    plan: PlanFunction | None = None,
    disturbance: DisturbanceConfig | None = None,
) -> Job:
    """Expert rollouts to clone, from the configured starts; failed rollouts are dropped whole.

    Args:
        config: Configuration of the run.
        data: Number and length of the rollouts.
        plan: The expert's MPC, any plain function; None for the BiConMP-style planner.
        disturbance: The disturbance of the rollouts; None for no disturbance.

    Raises:
        ValueError: The stored set has too few initial states.
    """
    stored = all_starts_of(config)
    starts = stored.join([_expert_starts(config, each, data) for each in stored.sets])
    rng = np.random.default_rng(seed_of(config.seed, "series", 0))
    starts = _in_order(config, starts, rng)
    return Job(
        config,
        episodes_from(config, starts, 0, data.duration),
        ExpertOnly(),
        keep=keep_unless_failed,
        plan=plan,
        disturbance=disturbance or DisturbanceConfig(),
    )


def _expert_starts(config: Config, stored: StartSet, data: ExpertData) -> Starts:
    """The initial states of the expert's rollouts in one gait.

    Raises:
        ValueError: The stored set has too few initial states.
    """
    split = config.starts
    starts = stored[split][expert_rows(stored, split, data)]
    if not data.nominal:
        return starts
    # Also start from standing still, as when a robot is switched on: no stored state teaches that.
    first = stored.rows(split)[0, 0, stored.velocities(split, data.velocities)]
    speeds = np.unique(stored[split].command[first], axis=0)
    return join_starts([at_rest(standing(load_robot(config.robot)), speeds), starts])


def episodes_from(
    config: Config, starts: Starts, i: int, duration: float, tail: float = 0.0
) -> Episodes:
    """The episodes of an iteration; with several gaits, robots change theirs at random times.

    Args:
        config: Configuration of the run.
        starts: Initial states of the episodes.
        i: The iteration; 0 is the pre-training.
        duration: Duration of the episodes before their tails [s].
        tail: Duration of the expert's tail after that [s].
    """
    ids = rollout_ids(i, len(starts))
    switches = draw_switches(config, starts, duration, ids)
    return Episodes(starts, duration, tail=tail, id=ids, switches=switches)


def pretraining_rollouts(
    config: Config, method: IterativeConfig, plan: PlanFunction | None = None
) -> Job:
    """The expert rollouts that an iterative method begins with, as in `expert_rollouts`."""
    return expert_rollouts(config, method.pretraining, plan, config.pretraining)


def expert_rows(stored: StartSet, split: TeachingSplit, data: ExpertData) -> IntArray:
    """Rows of a split to clone from: velocities x all phases x perturbations.

    Args:
        stored: The set of initial states.
        split: The split.
        data: Numbers of velocities and perturbations; without perturbations there are no rows.

    Raises:
        ValueError: The stored set has too few initial states.
    """
    grid = stored.rows(split)
    if data.perturbations > grid.shape[0]:
        raise ValueError(
            f"{data.perturbations} perturbations asked for, the starts {stored.name!r} hold "
            f"{grid.shape[0]} of each velocity and phase in {split!r}; use 0 to {grid.shape[0]}, "
            "and longer rollouts where that is too little data"
        )
    velocities = stored.velocities(split, data.velocities)
    return grid[: data.perturbations, :, velocities].ravel()


def order_of_series(config: Config, start: IntArray) -> IntArray:
    """``(n,)`` the order in which a series of dataset sizes takes the episodes of the first data.

    Args:
        config: Configuration of the run.
        start: ``(n,)`` ids of the initial states of the episodes, in the order of their ids.
    """
    phase = all_starts_of(config).phases(start)
    return series_order(phase, np.random.default_rng(seed_of(config.seed, "series", 0)))


def series_order(stratum: IntArray, rng: np.random.Generator) -> IntArray:
    """``(n,)`` a random order in which any first part has each stratum in its share.

    Args:
        stratum: ``(n,)`` the stratum of each of n items, as a number.
        rng: Random generator.
    """
    position = np.empty(len(stratum))
    for value in np.unique(stratum):
        rows = np.flatnonzero(stratum == value)
        position[rows] = (rng.permutation(len(rows)) + rng.random()) / len(rows)
    return np.argsort(position)


def draw_starts(config: Config, method: IterativeConfig, i: int) -> Starts:
    """The initial states of an iteration in each gait, drawn with the iteration's own seed.

    With perturbed states, one random phase is drawn for each velocity, and random perturbations
    among those that the pre-training has not used. The `nominal` split has only one state at each
    phase of a settled gait cycle, so random phases are drawn for each velocity, among all phases.
    The pre-training used the same states, but the rollouts differ: another policy drives, and the
    disturbances are different.

    Args:
        config: Configuration of the run: its seed, and the split.
        method: Parameters of its method.
        i: The iteration, from 1 on.

    Raises:
        ValueError: The stored set has too few initial states.
    """
    rng = np.random.default_rng(seed_of(config.seed, "starts", i))
    split = config.starts
    rows = _phases_of_the_cycle if split == "nominal" else _perturbed_states
    stored = all_starts_of(config)
    starts = stored.join([each[split][rows(each, method, rng)] for each in stored.sets])
    return _in_order(config, starts, rng)


def _in_order(config: Config, starts: Starts, rng: np.random.Generator) -> Starts:
    """Initial states as they are, or in random order if a budget may end their rollouts early."""
    if config.budget.expert_seconds is None:
        return starts
    return starts[series_order(all_starts_of(config).phases(starts.id), rng)]


def _phases_of_the_cycle(
    stored: StartSet, method: IterativeConfig, rng: np.random.Generator
) -> IntArray:
    """Rows of the `nominal` split: random phases of each velocity.

    Raises:
        ValueError: The split has too few phases.
    """
    grid = stored.rows("nominal")
    phases = grid.shape[1]
    if method.perturbations > phases:
        raise ValueError(
            f"{method.perturbations} perturbations asked for, but the split 'nominal' of the "
            f"starts {stored.name!r} is one gait cycle of {phases} phases at each velocity; use 1 "
            f"to {phases}, and a longer T where that is too little"
        )
    rows = []
    for velocity in stored.velocities("nominal", method.velocities):
        drawn = rng.choice(phases, method.perturbations, replace=False)
        rows.extend(grid[0, drawn, velocity])
    return np.array(rows)


def _perturbed_states(
    stored: StartSet, method: IterativeConfig, rng: np.random.Generator
) -> IntArray:
    """Rows of the `train` split: one random phase of each velocity, and random perturbations.

    Raises:
        ValueError: The pre-training leaves too few perturbations.
    """
    grid = stored.rows("train")[method.pretraining.perturbations :]
    perturbations, phases, _ = grid.shape
    if method.perturbations > perturbations:
        raise ValueError(
            f"{method.perturbations} perturbations asked for, the starts {stored.name!r} hold "
            f"{perturbations} of each velocity and phase beyond those of the pre-training"
        )
    rows = []
    for velocity in stored.velocities("train", method.velocities):
        phase = rng.integers(phases)
        drawn = rng.choice(perturbations, method.perturbations, replace=False)
        rows.extend(grid[drawn, phase, velocity])
    return np.array(rows)


def keep_unless_failed(rollouts: Rollout) -> BoolArray:
    """``(B, T)`` True for all frames of rollouts that neither fell nor diverged."""
    return rollouts.happened & ~rollouts.failed[:, None]


def expert_frames(rollouts: Rollout) -> BoolArray:
    """``(B, T)`` True for the frames in which the expert drove, except a block that ended badly.

    A block of the expert that ends in a fall or a divergence is dropped whole, because it teaches
    how to fall. Earlier blocks of that rollout ended well and are kept. The tail is a block too.
    """
    keep = rollouts.expert_drove & rollouts.happened
    for robot in np.flatnonzero(rollouts.failed):
        tick = rollouts.length[robot] - 1
        while tick >= 0 and keep[robot, tick]:
            keep[robot, tick] = False
            tick -= 1
    return keep
