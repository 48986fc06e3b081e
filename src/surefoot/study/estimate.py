"""How long a study will take: the work of each job by its configuration, times measured rates.

The work is counted in MPC solves, in simulated robot-seconds and in training steps, as if no robot
fell. The time for each of these is measured on this machine before the study begins; once jobs are
done, the time that they took corrects the estimate.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from tqdm import tqdm

from surefoot.bench.engine import rollout_times
from surefoot.bench.plan import cold_plans, times_of
from surefoot.bench.train import chosen_step_seconds
from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    DartConfig,
    ExpertData,
    IterativeConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    SafeDaggerConfig,
    Steps,
)
from surefoot.config.json_io import from_json, read_json
from surefoot.config.study import EXPERT, Measurement, StudyConfig, measured_config
from surefoot.evaluation import imitation
from surefoot.files import write_json
from surefoot.runs.budget import first_allowance, solves_of
from surefoot.runs.versions import processor
from surefoot.scenarios.make import cycle_instants
from surefoot.scenarios.prepare import completed
from surefoot.study.cells import StudyJob, cell_config, measurements_of
from surefoot.study.layout import ESTIMATE_FILE
from surefoot.study.queue import wall_seconds
from surefoot.study.state import JobStatus
from surefoot.types import GRID, TICKS_PER_SECOND

T = TypeVar("T")

PLANS_PER_SECOND = TICKS_PER_SECOND / GRID
"""MPC solves for each second that the expert drives or is asked."""
STARTING = 8.0
"""Time that a process takes to start: for imports, and for loading compiled code [s]."""
SHARE_OF_EXPERT = 0.1
"""Share of the time that the expert is assumed to drive under a monitor (paper, V-A)."""
TRIED_LEVELS = 1.2
"""Push levels tried in each direction, as a multiple of log2 of the number of levels."""


@dataclass(frozen=True)
class Work:
    """The amount of computation.

    Attributes:
        plans: Number of MPC solves.
        robot_seconds: Simulated time of all robots together [s].
        steps: Number of training steps.
    """

    plans: float = 0.0
    robot_seconds: float = 0.0
    steps: float = 0.0

    def __add__(self, other: Work) -> Work:
        """Both together."""
        return Work(
            self.plans + other.plans,
            self.robot_seconds + other.robot_seconds,
            self.steps + other.steps,
        )

    def __mul__(self, times: float) -> Work:
        """The same work, times a factor."""
        return Work(times * self.plans, times * self.robot_seconds, times * self.steps)


@dataclass(frozen=True)
class Rates:
    """How long each part of the work takes on one core of this machine.

    Attributes:
        plan: Time of an MPC solve [s].
        robot_second: Time of one simulated second of one robot that a policy drives [s].
        step: Time of a training step [s].
    """

    plan: float
    robot_second: float
    step: float

    def seconds(self, work: Work) -> float:
        """How long work takes on one core [s]."""
        return (
            work.plans * self.plan + work.robot_seconds * self.robot_second + work.steps * self.step
        )


def measure_rates(config: Config) -> Rates:
    """Measure how long each part of the work takes on one core of this machine.

    That takes half a minute, or some minutes if code must be compiled first. Only processor time
    counts, so the machine may compute other things in the meantime.

    Args:
        config: The configuration of a cell.
    """
    seconds_of_step, had = _with_share_of_core(lambda: chosen_step_seconds(config, 40))
    step = had * seconds_of_step
    seconds = 0.5
    times, had = _with_share_of_core(lambda: rollout_times(config, config.chunk, seconds))
    # A robot that does not stand has a rate all the same, that of the ticks until it fell.
    robot_second = had * times.rollout / times.robot_seconds
    plans, had = _with_share_of_core(lambda: cold_plans(config, 40))
    plan = had * times_of(plans).median / 1e3
    return Rates(plan, robot_second, step)


def _with_share_of_core(measure: Callable[[], T]) -> tuple[T, float]:
    """The result of a measurement on one thread, and the share of a core that it had meanwhile."""
    began = time.perf_counter()
    computed = time.process_time()
    measured = measure()
    share = (time.process_time() - computed) / (time.perf_counter() - began)
    return measured, min(share, 1.0)


def work_of(study: StudyConfig, job: StudyJob, config: Config) -> Work:
    """What a job has to compute, as if no robot fell.

    Args:
        study: The study.
        job: The job.
        config: The configuration of its cell's run.
    """
    if job.kind == "copy":
        return Work()
    if job.kind == "measure":
        return measuring_work(study, job, config)
    first = first_work(config)
    shared = {
        None: Work(),
        "data": Work(first.plans, first.robot_seconds),
        "policy": first,
    }[job.shared]
    return shared if job.kind == "share" else training_work(config) + shared * -1.0


def first_work(config: Config) -> Work:
    """The work of making the first data and of training the first policy on it."""
    method = config.method
    if isinstance(method, BehaviorCloningConfig):
        work = _first_data(config, method.data)
        most = work.robot_seconds * TICKS_PER_SECOND
        for size in [*method.frames, most] if method.all_frames else method.frames:
            work = work + _training_steps(config, min(size, most), method.training)
        return work
    data = _first_data(config, method.pretraining)
    frames = data.robot_seconds * TICKS_PER_SECOND
    return data + _training_steps(config, frames, method.first_training)


def _first_data(config: Config, data: ExpertData) -> Work:
    """The work of collecting the first data, as far as the budget pays for it."""
    return _paid_by(first_allowance(config), expert_work(config, data))


def training_work(config: Config) -> Work:
    """The work of a whole run, including the choice of the best policy."""
    method = config.method
    evaluation = config.evaluation
    validation = Work(robot_seconds=evaluation.episodes * evaluation.duration)
    work = first_work(config)
    if isinstance(method, BehaviorCloningConfig):
        return work + validation * method.sizes
    allowed = first_allowance(config)
    share = None  # solves of an iteration, as if the budget were split evenly
    if config.budget.expert_seconds is not None and allowed is not None:
        left = solves_of(config.budget.expert_seconds) - allowed
        share = left // max(method.iterations, 1)
    frames = _first_data(config, method.pretraining).robot_seconds * TICKS_PER_SECOND
    for i in range(1, method.iterations + 1):
        driven, kept = _iteration_work(method, i)
        paid = _paid_by(share, driven)
        frames += kept * TICKS_PER_SECOND * paid.plans / max(driven.plans, 1.0)
        work = work + paid + _training_steps(config, frames, method.training_in(i)) + validation
    return work + validation


def _iteration_work(method: IterativeConfig, i: int) -> tuple[Work, float]:
    """The work of the rollouts of iteration i, and the time of them that is learned from [s]."""
    rollouts = method.velocities * method.perturbations
    seconds = rollouts * method.T
    if isinstance(method, DaggerConfig | DartConfig):
        return Work(seconds * PLANS_PER_SECOND, seconds), seconds
    if isinstance(method, SafeDaggerConfig):
        kept = method.unsafe_share * seconds
        return Work(kept * PLANS_PER_SECOND, seconds), kept
    if isinstance(method, LocoDaggerConfig):
        queried = rollouts * method.N_query * method.T_query
        expert = method.alpha ** (i - 1) * seconds + queried
        return Work(expert * PLANS_PER_SECOND, seconds + queried), queried
    assert isinstance(method, LocoSafeDaggerConfig)
    tail = rollouts * method.T_end
    kept = SHARE_OF_EXPERT * seconds + tail
    return Work(kept * PLANS_PER_SECOND, seconds + tail), kept


def _paid_by(allowed: int | None, work: Work) -> Work:
    """The part of some rollouts' work that a number of MPC solves pays for; None pays for all."""
    if allowed is None or work.plans <= allowed:
        return work
    return work * (allowed / work.plans)


def measuring_work(study: StudyConfig, job: StudyJob, config: Config) -> Work:
    """The work of measuring the policies of a cell."""
    work = Work()
    is_expert = study.technique(job.cell.technique).method == EXPERT
    for name in measurements_of(study, job.cell):
        work = work + _measurement_work(study.measurement(name), config, is_expert)
    return work


def _measurement_work(measurement: Measurement, config: Config, is_expert: bool) -> Work:
    """The work of one measurement of a cell."""
    measured = measured_config(config, measurement)
    if measurement.measure == "imitation":
        seconds = imitation.ROLLOUTS * imitation.DURATION
        return Work(seconds * PLANS_PER_SECOND, seconds)
    if measurement.measure == "impulse":
        push = measured.push
        robots = push.speeds * _phases(config)
        levels = TRIED_LEVELS * np.log2(push.levels)
        seconds = robots * (push.before + push.after * (1 + push.directions * levels))
    else:
        seconds = measured.evaluation.episodes * measured.evaluation.duration
    if is_expert:
        return Work(seconds * PLANS_PER_SECOND, seconds)
    policies = 1
    if measurement.policies == "all":
        method = config.method
        is_cloning = isinstance(method, BehaviorCloningConfig)
        policies = method.sizes if is_cloning else 1 + method.iterations
    return Work(robot_seconds=seconds * policies)


def _phases(config: Config) -> int:
    """The number of phases of the gait at which stored initial states begin."""
    return len(cycle_instants(config.gait))


def expert_work(config: Config, data: ExpertData) -> Work:
    """The work of expert rollouts."""
    rollouts = data.velocities * (_phases(config) * data.perturbations + int(data.nominal))
    seconds = rollouts * data.duration
    return Work(seconds * PLANS_PER_SECOND, seconds)


def _training_steps(config: Config, frames: float, epochs: int | Steps) -> Work:
    """The steps of a training."""
    if isinstance(epochs, Steps):
        return Work(steps=epochs.count)
    kept = frames * (1.0 - config.training.validation)
    return Work(steps=epochs * kept / config.training.batch)


@dataclass(frozen=True)
class Estimate:
    """How long each job of a study takes on one core of this machine.

    Attributes:
        seconds: Job -> its total time [s].
        processor: Model of the processor.
    """

    seconds: dict[str, float]
    processor: str

    def left(self, statuses: Sequence[JobStatus], workers: int) -> float:
        """How long a study still takes [s].

        The rest is scaled by how long the jobs that this model of processor did took, compared with
        their estimate.

        Args:
            statuses: How far the jobs are.
            workers: Number of jobs that run at a time.
        """
        done = {status.job.name for status in statuses if status.state == "done"}
        here = [s for s in statuses if s.job.name in done and s.processors == (self.processor,)]
        estimated = sum(self.seconds[status.job.name] for status in here)
        pace = sum(status.seconds for status in here) / estimated if estimated > 0.0 else 1.0
        left = {
            status.job.name: max(pace * self.seconds[status.job.name] - status.seconds, 0.0)
            for status in statuses
        }
        running_first = sorted(statuses, key=lambda status: status.state != "running")
        return wall_seconds([status.job for status in running_first], left, workers, done)


def _what_rates_depend_on(config: Config) -> str:
    """The parts of a configuration that the times of a plan, a tick and a step depend on."""
    parts = (
        config.robot,
        config.gait,
        config.other_gaits,
        config.simulation,
        config.expert,
        config.policy,
        config.chunk,
        config.training.batch,
        config.training.precision,
    )
    return repr(parts)


def estimate_study(
    study: StudyConfig, jobs: Sequence[StudyJob], folder: Path | None = None
) -> Estimate:
    """Estimate how long each job of a study takes here, by a short calibration.

    Args:
        study: The study.
        jobs: Its jobs.
        folder: Folder where the estimate is kept, and from which it is read if it is there already;
            None does not keep it.
    """
    before = None if folder is None else read_estimate(folder, jobs)
    if before is not None:
        return before
    configs = {job.name: cell_config(study, job.cell) for job in jobs}
    different = {_what_rates_depend_on(config): config for config in configs.values()}
    bar = tqdm(different.items(), "measuring this machine", leave=False, unit="configuration")
    rates = {key: measure_rates(completed(config)) for key, config in bar}
    seconds = {}
    for job in jobs:
        config = configs[job.name]
        own = rates[_what_rates_depend_on(config)]
        seconds[job.name] = STARTING + own.seconds(work_of(study, job, config))
    estimate = Estimate(seconds, processor())
    if folder is not None:
        write_json(folder / ESTIMATE_FILE, estimate)
    return estimate


def read_estimate(folder: Path, jobs: Sequence[StudyJob]) -> Estimate | None:
    """The estimate in a study's folder, if it is for this model of processor and these jobs.

    Args:
        folder: Folder of the study.
        jobs: The jobs of the study.
    """
    path = folder / ESTIMATE_FILE
    if not path.exists():
        return None
    try:
        estimate = from_json(Estimate, read_json(path))
    except ValueError:
        return None  # it is only an estimate: a new one is made
    names = {job.name for job in jobs}
    is_same = estimate.processor == processor() and names == set(estimate.seconds)
    return estimate if is_same else None
