"""What all methods share: draw starts, collect, train, validate, choose the best. Resumable.

Each function is one stage of an iteration; a stage whose record stands in the run's metrics is not
done again.
"""

from __future__ import annotations

import time
from contextlib import closing
from typing import Any

import numpy as np
from tqdm import tqdm

from surefoot.config import Config, ExpertData, Gait
from surefoot.dataset import Dataset
from surefoot.engine import ExpertOnly, Rollout
from surefoot.episodes import (
    Job,
    Summary,
    chunks_of,
    expert_name,
    join,
    load_summary,
    run_chunk,
    save_summary,
)
from surefoot.evaluation import evaluate
from surefoot.policy import Policy, PolicyNetwork, load, save
from surefoot.robot import solo12, standing
from surefoot.run import Run, RunError
from surefoot.safety import Outcome
from surefoot.starts import Starts, StartSet, at_rest, load_starts
from surefoot.train import choose_device, fit
from surefoot.types import TICKS_PER_SECOND, BoolArray, IntArray, PlanFunction, to_ticks
from surefoot.workers import Workers, each_chunk

EPISODES_PER_ITERATION = 100_000
"""Episode ids: iteration * this + index."""


def check(config: Config) -> None:
    """What would fail hours later fails before any work.

    Raises:
        ValueError: a number that cannot be worked with, and what it may be.
    """
    stored = load_starts()
    if config.gait != Gait():
        raise ValueError(
            f"the starts {stored.name!r} are of the default gait, the configuration asks for "
            f"{config.gait}: write a set of starts for it first (scripts/make_starts.py)"
        )
    checks = (
        ("chunk", config.chunk, 1, 10_000),
        ("training.batch", config.training.batch, 2, 1_000_000),
        ("training.threads", config.training.threads, 1, 1024),
        ("training.learning_rate", config.training.learning_rate, 1e-12, 1.0),
        ("training.memory", config.training.memory, 1, 1_000_000_000),
        ("training.validation", config.training.validation, 0.0, 0.9),
        ("evaluation.episodes", config.evaluation.episodes, 1, len(stored["select"])),
        ("evaluation.duration", config.evaluation.duration, 0.001, 3600.0),
        ("method.iterations", getattr(config.method, "iterations", 0), 0, 10_000),
        ("method.epochs", config.method.epochs, 1, 1_000_000),
        ("method.T", getattr(config.method, "T", 1.0), 0.001, 3600.0),
    )
    for name, value, least, most in checks:
        if not least <= value <= most:
            raise ValueError(f"{name} is {value}; use {least} to {most}")
    choose_device(config.training.device)


def episode_ids(iteration: int, count: int) -> IntArray:
    """Ids that no other iteration of a run uses."""
    return iteration * EPISODES_PER_ITERATION + np.arange(count)


def expert_rollouts(config: Config, data: ExpertData, plan: PlanFunction | None = None) -> Job:
    """Expert rollouts to clone, from the `train` starts; failed rollouts are dropped whole."""
    stored = load_starts()
    parts = [stored["train"][expert_rows(stored, data)]]
    if data.nominal:
        # From standing still, as a robot is switched on: no other start teaches that.
        speeds = np.unique(parts[0].command, axis=0)
        parts.insert(0, at_rest(standing(solo12(config.robot)), speeds))
    starts = Starts(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0]))
    )
    ids = episode_ids(0, len(starts))
    return Job(config, starts, ids, ExpertOnly(), data.duration, keep=keep_unless_failed, plan=plan)


def expert_rows(stored: StartSet, data: ExpertData) -> IntArray:
    """Rows of the `train` split: velocities x ten phases x perturbations."""
    grid = stored.rows("train")
    if data.perturbations > grid.shape[0]:
        raise ValueError(
            f"{data.perturbations} perturbations asked for, the starts {stored.name!r} hold "
            f"{grid.shape[0]} of each velocity and phase"
        )
    return grid[: data.perturbations, :, equally_spaced(grid.shape[2], data.velocities)].ravel()


def equally_spaced(available: int, wanted: int) -> IntArray:
    """Indices of ``wanted`` equally spaced velocities, both ends included."""
    if not 1 <= wanted <= available:
        raise ValueError(f"{wanted} velocities asked for, the stored starts hold {available}")
    return np.round(np.linspace(0, available - 1, wanted)).astype(np.int64)


def keep_unless_failed(record: Rollout) -> BoolArray:
    """All frames of rollouts that neither fell nor diverged."""
    return record.happened & ~record.failed[:, None]


def collect(run: Run, iteration: int, job: Job, workers: Workers) -> dict[str, Any]:
    """D <- D u D': run the episodes of a job and append the frames that its rule keeps."""
    if (done := run.done("collect", iteration)) is not None:
        if done["expert"] != expert_name(job):
            raise ValueError(
                f"{run.folder} was begun with the expert {done['expert']}, not with "
                f"{expert_name(job)}; resume it with the same one, or begin another run"
            )
        run_and_store(run, iteration, job, workers)  # only what has been lost since
        return done
    began = time.perf_counter()
    figures = collection_figures(run_and_store(run, iteration, job, workers))
    data = dataset(run, iteration)
    record = run.record(
        "collect",
        iteration,
        expert=expert_name(job),
        starts_hash=load_starts().hash,
        **figures,
        dataset_frames=data.frames,
        dataset_hash=data.hash,
        seconds=time.perf_counter() - began,
    )
    tqdm.write(
        f"iteration {iteration}: {figures['episodes']} rollouts, {figures['falls']} fell, "
        f"{figures['diverged']} diverged, expert share {100 * figures['expert_share']:.1f} % "
        f"(with tail {100 * figures['expert_share_with_tail']:.1f} %), "
        f"{figures['frames_kept']} frames kept, {data.frames} in all"
    )
    return record


def dataset(run: Run, iteration: int) -> Dataset:
    """D of iteration i. Later shards are there if an earlier stage has to be done again."""
    return run.dataset.before((iteration + 1) * EPISODES_PER_ITERATION)


def run_and_store(run: Run, iteration: int, job: Job, workers: Workers) -> Summary:
    """Run the chunks of a job that are not stored yet, and store each as soon as it is done.

    Raises:
        ValueError: the run's folder holds chunks of another job.
    """
    chunks = chunks_of(job)
    names = [f"iteration_{iteration:03d}-{number:03d}" for number in range(len(chunks))]
    stored = {
        name
        for name in run.dataset.shards
        if run.summary(name).exists() and run.dataset.file(name).exists()
    }
    missing = [number for number, name in enumerate(names) if name not in stored]
    for chunk, name in zip(chunks, names, strict=True):
        if name in stored and not _ran(load_summary(run.summary(name)), chunk):
            raise ValueError(
                f"{run.folder} holds rollouts of iteration {iteration} from other starts or by "
                f"another expert than {expert_name(job)}; resume it as it was begun, or begin "
                "another run"
            )
    label = f"iteration {iteration}: collect"
    results = each_chunk(run_chunk, [chunks[number] for number in missing], workers, label)
    with closing(results):  # whatever goes wrong here, the workers end with it
        for done, (summary, frames) in results:
            # The summary first: a shard that the dataset knows is a chunk that is done.
            name = names[missing[done]]
            save_summary(run.summary(name), summary)
            run.dataset.append(name, frames)
    return join([load_summary(run.summary(name)) for name in names])


def _ran(summary: Summary, chunk: Job) -> bool:
    """Whether a summary is of these episodes, by this expert."""
    same = np.array_equal(summary.episode, chunk.episode)
    same = same and np.array_equal(summary.start, chunk.starts.id)
    return same and bool((summary.expert == expert_name(chunk)).all())


def collection_figures(summary: Summary) -> dict[str, Any]:
    """Falls, and who drove then; expert share over T and with the tail; MPC solves."""
    fell = summary.outcome == Outcome.FELL
    tail_ticks = summary.ticks - summary.proper_ticks
    robot_ticks = int(summary.ticks.sum())
    with_tail = int(summary.expert_ticks.sum() + tail_ticks.sum())
    return {
        "episodes": len(summary.outcome),
        "falls": int(fell.sum()),
        "falls_in_tail": int((fell & (tail_ticks > 0)).sum()),
        "falls_expert_driving": int((fell & summary.expert_drove_last).sum()),
        "falls_expert_driving_before": int((fell & summary.expert_drove_before).sum()),
        "diverged": int((summary.outcome == Outcome.DIVERGED).sum()),
        "stalls": int((summary.outcome == Outcome.STALLED).sum()),
        "falls_per_robot_minute": float(fell.sum() / (robot_ticks / TICKS_PER_SECOND / 60)),
        "expert_share": float(summary.expert_ticks.sum() / summary.proper_ticks.sum()),
        "expert_share_with_tail": with_tail / robot_ticks,
        "expert_seconds": with_tail / TICKS_PER_SECOND,
        "robot_seconds": robot_ticks / TICKS_PER_SECOND,
        "plans": int(summary.plans.sum()),
        "invalid_plans": int(summary.invalid_plans.sum()),
        "frames_kept": int(summary.kept.sum()),
        "failed_episodes": summary.episode[fell | (summary.outcome == Outcome.DIVERGED)].tolist(),
    }


def train(run: Run, iteration: int, epochs: int) -> dict[str, Any]:
    """Train pi_i on D, starting from pi_{i-1}; the first starts from random weights."""
    done = run.done("train", iteration)
    checkpoint = run.folder / "checkpoints" / f"{iteration:03d}.safetensors"
    if done and run.policy(iteration).exists():
        checkpoint.unlink(missing_ok=True)  # of a run that was killed just before
        return done
    began = time.perf_counter()
    config, data = run.config, dataset(run, iteration)
    if iteration == 0:
        seed = int(run.seed("network", 0).generate_state(1)[0])
        network = PolicyNetwork(config.policy, seed)
    else:
        network = load(run.policy(iteration - 1)).network
    period = to_ticks(config.gait.period)
    with tqdm(total=epochs, desc=f"iteration {iteration}: train", unit="epoch", leave=False) as bar:

        def progress(_epoch: int, _of: int, train_loss: float, validation_loss: float) -> None:
            bar.set_postfix(train=f"{train_loss:.4f}", validation=f"{validation_loss:.4f}")
            bar.update()

        order = int(run.seed("order", iteration).generate_state(1)[0])
        result = fit(
            network,
            data,
            config.training,
            config.policy,
            epochs,
            order,
            period,
            progress,
            checkpoint,
        )
    if done and done["train_loss"] != result.train_loss[-1]:
        raise RunError(
            f"{run.policy(iteration)} is lost, and training it again gave a loss of "
            f"{result.train_loss[-1]} instead of {done['train_loss']} rad, on {result.device} "
            f"instead of {done['device']}: do it where it was trained, or restore it from a copy"
        )
    provenance = {
        "run": run.folder.name,
        "method": run.method,
        "iteration": iteration,
        "seed": config.seed,
        "dataset_hash": data.hash,
    }
    policy = Policy(
        result.network, config.policy, period, result.command_range, provenance=provenance
    )
    save(policy, run.policy(iteration))
    record = done or run.record(
        "train",
        iteration,
        epochs=epochs,
        steps=result.steps,
        frames=result.frames,
        device=result.device,
        train_loss=result.train_loss[-1],
        validation_loss=result.validation_loss[-1],
        seconds=time.perf_counter() - began,
    )
    checkpoint.unlink(missing_ok=True)
    tqdm.write(
        f"iteration {iteration}: {epochs} epochs on {result.frames} frames, "
        f"L1 {result.train_loss[-1]:.4f} rad, held out {result.validation_loss[-1]:.4f} rad"
    )
    return record


def validate(run: Run, iteration: int, workers: Workers) -> dict[str, Any]:
    """Robustness of pi_i on the `select` starts: the figure a policy is chosen by."""
    if done := run.done("validate", iteration):
        return done
    began = time.perf_counter()
    figures, _ = evaluate(
        run.config, run.policy(iteration), "select", workers, f"iteration {iteration}: validate"
    )
    record = run.record("validate", iteration, **figures, seconds=time.perf_counter() - began)
    tqdm.write(
        f"iteration {iteration}: {figures['successes']} of {figures['episodes']} select starts, "
        f"{figures['falls']} fell, {figures['stalls']} stalled"
    )
    return record


def best(run: Run, iterations: int) -> dict[str, Any]:
    """The policy with most successes on `select`; among equals the best tracking in vx."""
    if done := run.done("best", 0):
        return done

    def merit(iteration: int) -> tuple[int, float]:
        record = run.done("validate", iteration) or {}
        error = record["settled_mse"][0]
        return record["successes"], -np.inf if error is None else -error

    winner = max(range(iterations + 1), key=merit)
    return run.record("best", 0, best_iteration=winner)
