"""End-to-end speed: an evaluation and a training run, compared with lower bounds.

The lower bound of a stage is the time for its plans, robot-milliseconds and training steps at the
bare rates that `plan`, `engine` and `train` measure in the same run. Plans and rollouts are spread
evenly over the processes; training has one process. The figures depend on the machine and the
moment: trust the ratios.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surefoot.bench.engine import bare_rate, standing_policy
from surefoot.bench.plan import cold_plans, times_of
from surefoot.bench.train import bench_train
from surefoot.config import Config
from surefoot.learning.policy import save
from surefoot.methods import METHODS
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, run_episodes
from surefoot.runs.metrics import Collected, Trained, Validated
from surefoot.runs.run import Run, create
from surefoot.scenarios.starts import starts_of
from surefoot.types import TICKS_PER_SECOND
from surefoot.workers import Workers


@dataclass(frozen=True)
class EvaluationSpeed:
    """Wall time of the paper's evaluation.

    Attributes:
        episodes: Number of episodes.
        workers: Number of processes.
        seconds: Wall time [s].
        floor_seconds: Lower bound: bare steps and bare network, spread over the processes [s].
        ratio: ``seconds`` over ``floor_seconds``; 1 at best.
    """

    episodes: int
    workers: int
    seconds: float
    floor_seconds: float
    ratio: float


@dataclass(frozen=True)
class BoundedTime:
    """Wall time of all stages of a kind in a run, and its lower bound.

    Attributes:
        seconds: Wall time [s].
        floor_seconds: Lower bound: what the parts of these stages take at best [s].
    """

    seconds: float
    floor_seconds: float


@dataclass(frozen=True)
class BareRates:
    """What the parts of a run cost at best.

    Attributes:
        plan_ms: Time of a plan [ms].
        robot_ms_per_s: Robot-milliseconds that a process simulates in a second.
        step_ms: Time of the matrix products of a training step [ms].
    """

    plan_ms: float
    robot_ms_per_s: float
    step_ms: float


@dataclass(frozen=True)
class EndToEndSpeed:
    """Wall time of a training run, from nothing to the best policy.

    Attributes:
        method: Name of the method.
        workers: Number of processes.
        seconds: Wall time [s].
        collect: Time of collecting data.
        train: Time of training the policies.
        validate: Time of validating them.
        other_seconds: Time of everything else [s].
        plan_ms: Median time of a cold plan, for the lower bounds [ms].
        floor_robot_ms_per_s: Bare robot-milliseconds that a process simulates in a second, for the
            lower bounds.
        floor_step_ms: Time of the matrix products of a training step, for the lower bounds [ms].
        select_successes: Number of `select` episodes in which the best policy succeeds.
    """

    method: str
    workers: int
    seconds: float
    collect: BoundedTime
    train: BoundedTime
    validate: BoundedTime
    other_seconds: float
    plan_ms: float
    floor_robot_ms_per_s: float
    floor_step_ms: float
    select_successes: int


@dataclass(frozen=True)
class StageWork:
    """What a stage of a run had to do, and how long it took.

    Attributes:
        stage: Kind of the stage: collect, train, validate or another.
        seconds: Wall time [s].
        robot_seconds: Simulated time of all robots [s].
        plans: Number of MPC solves.
        steps: Number of training steps.
    """

    stage: str
    seconds: float
    robot_seconds: float = 0.0
    plans: int = 0
    steps: int = 0


def bench_evaluation(config: Config, workers: Workers) -> EvaluationSpeed:
    """Measure the paper's evaluation, 100 episodes of 5 s, with a policy that stands.

    Args:
        config: Configuration of robot, simulator, policy and evaluation.
        workers: Processes that share the episodes.
    """
    episodes = config.evaluation.episodes
    stored = starts_of(config)["nominal"]
    starts = stored[np.arange(episodes) % len(stored)]
    rate = bare_rate(config)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "standing.safetensors"
        save(standing_policy(config), file)
        episodes = Episodes(starts, config.evaluation.duration, id=starts.id)
        job = Job(config, episodes, PolicyOnly(), policy=file)
        run_episodes(job[: workers.count], workers, "warming up")
        began = time.perf_counter()
        summary = run_episodes(job, workers, "evaluation")
        seconds = time.perf_counter() - began
    floor_seconds = float(summary.ticks.sum()) / rate / workers.count
    return EvaluationSpeed(
        episodes=len(starts),
        workers=workers.count,
        seconds=seconds,
        floor_seconds=floor_seconds,
        ratio=seconds / floor_seconds,
    )


def bench_end_to_end(config: Config, workers: Workers, folder: Path | None = None) -> EndToEndSpeed:
    """Train once, from nothing to the best policy, and say where the time went.

    Args:
        config: Configuration of the run.
        workers: Processes that share the rollouts.
        folder: Folder of the run, which is kept; None uses a temporary one.
    """
    rates = BareRates(
        plan_ms=times_of(cold_plans(config, 100)).median,
        robot_ms_per_s=bare_rate(config),
        step_ms=bench_train(config).floor_step_ms,
    )
    with tempfile.TemporaryDirectory() as temporary:
        run = create(folder or Path(temporary) / "run", config)
        name = config.method.name
        began = time.perf_counter()
        METHODS[name].train(run, workers, None)
        seconds = time.perf_counter() - began
        work = _work_of(run)
        successes = _select_successes(run)
    collect = stage_time(work, "collect", workers.count, rates)
    train = stage_time(work, "train", workers.count, rates)
    validate = stage_time(work, "validate", workers.count, rates)
    return EndToEndSpeed(
        method=name,
        workers=workers.count,
        seconds=seconds,
        collect=collect,
        train=train,
        validate=validate,
        other_seconds=seconds - collect.seconds - train.seconds - validate.seconds,
        plan_ms=rates.plan_ms,
        floor_robot_ms_per_s=rates.robot_ms_per_s,
        floor_step_ms=rates.step_ms,
        select_successes=successes,
    )


def stage_time(work: list[StageWork], stage: str, workers: int, rates: BareRates) -> BoundedTime:
    """Wall time of the stages of one kind, and what their parts cost at best.

    Args:
        work: Work of all stages of a run.
        stage: Kind of the stages to sum up.
        workers: Number of processes that the run had.
        rates: Costs of the parts.
    """
    seconds = 0.0
    floor_seconds = 0.0
    for part in work:
        if part.stage == stage:
            rollouts = part.robot_seconds * TICKS_PER_SECOND / rates.robot_ms_per_s
            plans = part.plans * rates.plan_ms / 1e3
            seconds += part.seconds
            floor_seconds += (rollouts + plans) / workers
            floor_seconds += part.steps * rates.step_ms / 1e3
    return BoundedTime(seconds, floor_seconds)


def end_to_end_table(speed: EndToEndSpeed) -> str:
    """The times of a training run as a table for people."""
    lines = [f"{'stage':<10}{'s':>9}{'lower bound, s':>16}{'ratio':>7}"]
    stages = (("collect", speed.collect), ("train", speed.train), ("validate", speed.validate))
    for name, times in stages:
        ratio = times.seconds / times.floor_seconds
        lines.append(f"{name:<10}{times.seconds:>9.1f}{times.floor_seconds:>16.1f}{ratio:>7.2f}")
    lines.append(f"{'other':<10}{speed.other_seconds:>9.1f}")
    lines.append(f"{'all':<10}{speed.seconds:>9.1f}")
    return "\n".join(lines)


def _work_of(run: Run) -> list[StageWork]:
    """What each stage of a run had to do, from its metrics."""
    work = []
    for record in run.metrics:
        if isinstance(record, Collected):
            work.append(
                StageWork("collect", record.seconds, record.robot_seconds, plans=record.plans)
            )
        elif isinstance(record, Trained):
            work.append(StageWork("train", record.seconds, steps=record.steps))
        elif isinstance(record, Validated):
            work.append(
                StageWork("validate", record.seconds, record.robot_seconds, plans=record.plans)
            )
    return work


def _select_successes(run: Run) -> int:
    """Number of `select` episodes in which a finished run's best policy succeeds."""
    best = run.best
    if best is None:
        raise ValueError(f"{run.folder} has no best policy: the run is not finished")
    validated = run.validated(best.best_iteration)
    if validated is None:
        raise ValueError(f"{run.folder} has not validated iteration {best.best_iteration}")
    return validated.successes
