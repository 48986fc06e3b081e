"""The stages that all methods share: collect data, train, validate, choose the best policy.

The stages are those of an iteration of the paper's Algorithms 1 to 4. A stage whose record is in
the run's metrics is not done again, so that a run can be resumed. The methods (`methods`) call the
stages in order; `runs.gate_training` adds the training of learned gates.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

import numpy as np

from surefoot.config import Config, IterativeConfig, Steps
from surefoot.config.array_io import load_arrays
from surefoot.evaluation.mirrors import training_mirror
from surefoot.evaluation.robustness import evaluate, success_difference
from surefoot.learning.dataset import Dataset
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import policy_spec, save
from surefoot.learning.symmetry import Mirrored
from surefoot.learning.train import FitResult, fit
from surefoot.rollouts.jobs import Job, expert_name
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.budget import SECONDS_PER_SOLVE, allowance, solves_spent
from surefoot.runs.collecting import Limit, PlayChunks, run_and_store, simulate_chunks
from surefoot.runs.collection_cost import collection_cost
from surefoot.runs.episode_ids import end_of_iteration
from surefoot.runs.layout import RunError
from surefoot.runs.metrics import Best, Collected, Trained, Validated
from surefoot.runs.own_expert import check_expert, remember_expert
from surefoot.runs.policies import fitted_policy, load_policy
from surefoot.runs.precision import kept_precision
from surefoot.runs.progress import epochs_bar
from surefoot.runs.run import Run
from surefoot.runs.sampling import order_of_series, pretraining_rollouts
from surefoot.scenarios.gaits import all_starts_of
from surefoot.types import PlanFunction
from surefoot.workers import Workers

logger = logging.getLogger(__name__)

Collect = Callable[[Run, int, Job, Workers], Collected]
"""Collects the data of an iteration, as `collect_data` does."""


def pretrain(
    run: Run, method: IterativeConfig, workers: Workers, plan: PlanFunction | None = None
) -> None:
    """Pre-training: D <- expert rollouts; train pi_0 on D (behavior cloning).

    Args:
        run: The run.
        method: Parameters of its method.
        workers: Processes that run the rollouts.
        plan: The expert's MPC, any plain function; None for the BiConMP-style planner.
    """
    collect_data(run, 0, pretraining_rollouts(run.config, method, plan), workers)
    train_policy(run, 0, method.first_training)


def collect_data(
    run: Run,
    iteration: int,
    job: Job,
    workers: Workers,
    play: PlayChunks = simulate_chunks,
) -> Collected:
    """D <- D u D': run the episodes of a job and append the frames that its rule keeps.

    A budget (`config.budget`) ends the collection before the rollout that would exceed it.

    Args:
        run: The run.
        iteration: The iteration i.
        job: The iteration's rollouts.
        workers: Processes that run the rollouts; the result does not depend on them.
        play: Runs the rollouts, in a simulator or on a robot.

    Raises:
        ValueError: The run was begun with another expert (a `RunError` if its plans at the fixed
            states differ), or holds rollouts of another job.
        RunError: The expert has failed in all rollouts; none of them is stored.
    """
    if run.has_begun:
        check_expert(run, job.plan)
    else:
        remember_expert(run, job.plan)
    done = run.collected(iteration)
    allowed = allowance(run, iteration)
    if done is not None:
        if done.expert != expert_name(job):
            raise ValueError(
                f"{run.folder} was begun with the expert {done.expert}, not with "
                f"{expert_name(job)}; resume it with the same one, or begin another run"
            )
        known = None if allowed is None else Limit(allowed, done.episodes)
        run_and_store(run, iteration, job, workers, known, play)  # runs only lost chunks
        return done
    began = time.perf_counter()
    limit = None if allowed is None else Limit(allowed)
    cost = collection_cost(run_and_store(run, iteration, job, workers, limit, play))
    data = dataset_of(run, iteration)
    record = Collected(
        iteration=iteration,
        expert=expert_name(job),
        starts_hash=all_starts_of(run.config).hash,
        **vars(cost),
        dataset_frames=data.frames,
        dataset_hash=data.hash,
        seconds=time.perf_counter() - began,
        allowed_seconds=None if allowed is None else allowed * SECONDS_PER_SOLVE,
        spent_seconds=None if allowed is None else cost.plans * SECONDS_PER_SOLVE,
    )
    record = run.append_metrics(record)
    spent = SECONDS_PER_SOLVE * solves_spent(run, iteration + 1)
    logger.info(
        f"iteration {iteration}: {cost.episodes} rollouts, {cost.falls} fell, "
        f"{cost.diverged} diverged, expert share {100 * cost.expert_share:.1f} % "
        f"(with tail {100 * cost.expert_share_with_tail:.1f} %), "
        f"{cost.frames_kept} frames kept, {data.frames} in all"
        + ("" if allowed is None else f", {spent:.2f} s of the budget spent in all")
    )
    return record


def dataset_of(run: Run, iteration: int) -> Dataset:
    """D of iteration i, without later shards, which exist if an early stage is done again."""
    return run.dataset.before(end_of_iteration(iteration))


def first_frames(run: Run, frames: int) -> Dataset:
    """Whole episodes of D that together have at most this many frames.

    They are the first episodes in a random order that the run's seed fixes. D is stored phase by
    phase, so this order is stratified: any first part of it has each gait phase in its share.

    Args:
        run: The run.
        frames: The largest number of frames.

    Raises:
        ValueError: The first episode alone has more frames than that.
    """
    summary = join_summaries(
        [load_arrays(run.summary_path(name), Summary) for name in run.dataset.shards]
    )
    summary = summary[np.argsort(summary.episode)]
    order = order_of_series(run.config, summary.start)
    fits = np.cumsum(summary.kept[order]) <= frames
    if fits.all():
        return run.dataset
    chosen = order[fits]
    if not summary.kept[chosen].any():
        raise ValueError(f"method.frames: {frames} frames are less than one episode")
    return run.dataset.only(summary.episode[chosen].tolist())


def train_policy(
    run: Run, iteration: int, epochs: int | Steps, data: Dataset | None = None, fresh: bool = False
) -> Trained:
    """Train pi_i on D, starting from pi_{i-1}; pi_0 starts from random weights.

    Args:
        run: The run.
        iteration: The iteration i.
        epochs: Number of passes over the data, or of steps.
        data: Data to train on; None for D of iteration i.
        fresh: Whether to start from the random weights of pi_0 instead of from pi_{i-1}.

    Raises:
        RunError: The policy was lost, and training it again gave another loss.
        PolicyFileError: The file of this policy or of the previous one is damaged.
    """
    done = run.trained(iteration)
    checkpoint = run.checkpoint_path(iteration)
    if done is not None and run.policy_path(iteration).exists():
        load_policy(run, iteration)  # raises now if the file is damaged, not when the policy drives
        checkpoint.unlink(missing_ok=True)  # left if the run was killed just before removing it
        return done
    began = time.perf_counter()
    if data is None:
        data = dataset_of(run, iteration)
    result = _fit(run, iteration, epochs, data, fresh)
    if done is not None and done.train_loss != result.train_loss[-1]:
        same = "with the same versions"
        if result.device != done.device:
            same = f"on {done.device} instead of {result.device}"
        if iteration > 0 and not fresh:
            same += ", after the same policy of the iteration before"
        raise RunError(
            f"{run.policy_path(iteration)} is lost, and training it again gave a loss of "
            f"{result.train_loss[-1]} instead of {done.train_loss} rad: do it where it was "
            f"trained, {same}, or restore it from a copy"
        )
    _save_policy(run, iteration, data, result)
    record = done or run.append_metrics(
        Trained(
            iteration=iteration,
            epochs=len(result.train_loss),
            steps=result.steps,
            frames=result.frames,
            episodes=data.episodes,
            dataset_hash=data.hash,
            device=result.device,
            precision=result.precision,
            train_loss=result.train_loss[-1],
            validation_loss=result.validation_loss[-1],
            seconds=time.perf_counter() - began,
        )
    )
    checkpoint.unlink(missing_ok=True)
    logger.info(
        f"iteration {iteration}: {result.steps} steps on {result.frames} frames, {result.losses}"
    )
    return record


def _fit(run: Run, iteration: int, epochs: int | Steps, data: Dataset, fresh: bool) -> FitResult:
    """Fit a network and show a progress bar; resume from the checkpoint if there is one."""
    config = run.config
    if iteration == 0 or fresh:
        inputs = policy_spec(config).observation.input_size
        network = PolicyNetwork(config.policy, run.torch_seed("network", 0), inputs)
    else:
        network = load_policy(run, iteration - 1).network
    with epochs_bar(f"iteration {iteration}: train") as progress:
        return fit(
            network,
            training_data(config, data),
            kept_precision(config.training, run.precision),
            policy_spec(config),
            epochs,
            run.torch_seed("order", iteration),
            progress,
            run.checkpoint_path(iteration),
        )


def training_data(config: Config, data: Dataset) -> Dataset | Mirrored:
    """The data that a network is fitted to: a dataset, with mirrored frames if configured.

    Args:
        config: Robot, gaits, and the training's mirror.
        data: The dataset.

    Raises:
        ValueError: A mirror is configured, but the robot or a gait is not its own mirror image.
    """
    mirror = training_mirror(config)
    return data if mirror is None else Mirrored(data, mirror)


def _save_policy(run: Run, iteration: int, data: Dataset, result: FitResult) -> None:
    """Write the policy of an iteration, with its provenance."""
    provenance = {
        "run": run.name,
        "method": run.method,
        "iteration": iteration,
        "seed": run.config.seed,
        "dataset_hash": data.hash,
    }
    save(fitted_policy(run.config, result, provenance), run.policy_path(iteration))


def validate_policy(run: Run, iteration: int, workers: Workers) -> Validated:
    """Measure the robustness of pi_i on the `select` initial states, used to choose the policy.

    Args:
        run: The run.
        iteration: The iteration i.
        workers: Processes that run the episodes; the result does not depend on them.
    """
    done = run.validated(iteration)
    if done is not None:
        return done
    began = time.perf_counter()
    robustness, _ = evaluate(run.config, run.policy_path(iteration), "select", workers)
    record = run.append_metrics(
        Validated(iteration=iteration, **vars(robustness), seconds=time.perf_counter() - began)
    )
    logger.info(
        f"iteration {iteration}: {record.successes} of {record.episodes} select initial states, "
        f"{record.falls} fell, {record.stalls} stalled"
    )
    return record


def choose_best_policy(run: Run, last: int, first: int = 0) -> Best:
    """Choose the policy of iterations first to last that has the most successes on `select`.

    Ties go to the latest iteration, whose policy was trained on the most data: where all succeed,
    tracking errors differ by chance, and later policies withstand harder pushes
    (``benchmarks/README.md``). If only the last iteration trains in full (`steps_before_last`), an
    earlier policy is chosen only if it is better beyond chance: it was trained to collect data, and
    withstands less.

    Args:
        run: The run.
        last: Last iteration whose policy may be chosen.
        first: First iteration whose policy may be chosen.

    Raises:
        RunError: An iteration has not been validated.
    """
    if run.best is not None:
        return run.best
    records = []
    for iteration in range(first, last + 1):
        record = run.validated(iteration)
        if record is None:
            raise RunError(f"{run.folder} has not validated the policy of iteration {iteration}")
        records.append(record)
    best = max(records, key=lambda record: (record.successes, record.iteration))
    method = run.config.method
    collects_first = isinstance(method, IterativeConfig) and method.steps_before_last is not None
    if collects_first and not _is_better(best, records[-1]):
        best = records[-1]
    return run.append_metrics(Best(best_iteration=best.iteration))


def _is_better(policy: Validated, other: Validated) -> bool:
    """Whether a policy succeeds more often than another from the same states, beyond chance."""
    difference = success_difference(policy, other)
    return difference is not None and difference.interval is not None and difference.interval[0] > 0
