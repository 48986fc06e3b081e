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

from surefoot.config.json_io import to_json
from surefoot.evaluation.robustness import evaluate
from surefoot.files import load_arrays, save_arrays
from surefoot.learning.dataset import Dataset
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, load, save
from surefoot.learning.train import fit
from surefoot.rollouts.jobs import Job, chunks_of, expert_name, run_chunk
from surefoot.rollouts.summary import Summary, join
from surefoot.runs.accounting import collection_figures
from surefoot.runs.run import Run, RunError
from surefoot.runs.sampling import EPISODES_PER_ITERATION
from surefoot.scenarios.starts import load_starts
from surefoot.types import to_ticks
from surefoot.workers import Workers, each_chunk


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


def iteration_of(shard: str) -> int:
    """The iteration that collected a shard."""
    return int(shard.split("_")[1].split("-")[0])


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
        if run.summary_path(name).exists()
        and run.dataset.file(name).exists()
        and (run.trace_path(name).exists() or not job.trace)
    }
    missing = [number for number, name in enumerate(names) if name not in stored]
    for chunk, name in zip(chunks, names, strict=True):
        if name in stored and not _ran(load_arrays(run.summary_path(name), Summary), chunk):
            raise ValueError(
                f"{run.folder} holds rollouts of iteration {iteration} from other starts or by "
                f"another expert than {expert_name(job)}; resume it as it was begun, or begin "
                "another run"
            )
    label = f"iteration {iteration}: collect"
    results = each_chunk(run_chunk, [chunks[number] for number in missing], workers, label)
    with closing(results):  # whatever goes wrong here, the workers end with it
        for done, result in results:
            # The shard last: one that the dataset knows is a chunk that is done.
            name = names[missing[done]]
            if result.trace is not None:
                save_arrays(run.trace_path(name), result.trace)
            save_arrays(run.summary_path(name), result.summary)
            run.dataset.append(name, result.frames)
    return join([load_arrays(run.summary_path(name), Summary) for name in names])


def _ran(summary: Summary, chunk: Job) -> bool:
    """Whether a summary is of these episodes, by this expert."""
    summary = summary[~summary.query]
    same = np.array_equal(summary.episode, chunk.episode)
    same = same and np.array_equal(summary.start, chunk.starts.id)
    return same and bool((summary.expert == expert_name(chunk)).all())


def first_frames(run: Run, frames: int) -> Dataset:
    """The first whole episodes of D, as many as have at most so many frames together.

    Raises:
        ValueError: not even one episode does.
    """
    summary = join([load_arrays(run.summary_path(name), Summary) for name in run.dataset.shards])
    order = np.argsort(summary.episode)
    fits = np.cumsum(summary.kept[order]) <= frames
    if not fits[0]:
        raise ValueError(f"method.frames: {frames} frames are less than one episode")
    if fits.all():
        return run.dataset
    return run.dataset.before(int(summary.episode[order][np.argmin(fits)]))


def train(
    run: Run, iteration: int, epochs: int, data: Dataset | None = None, fresh: bool = False
) -> dict[str, Any]:
    """Train pi_i on D, starting from pi_{i-1}; the first starts from random weights.

    Args:
        run: the run.
        iteration: i.
        epochs: passes over the data.
        data: without it D of iteration i.
        fresh: start from the random weights again.
    """
    done = run.done("train", iteration)
    checkpoint = run.folder / "checkpoints" / f"{iteration:03d}.safetensors"
    if done and run.policy_path(iteration).exists():
        checkpoint.unlink(missing_ok=True)  # of a run that was killed just before
        return done
    began = time.perf_counter()
    config, data = run.config, data or dataset(run, iteration)
    if iteration == 0 or fresh:
        network = PolicyNetwork(config.policy, run.torch_seed("network", 0))
    else:
        network = load(run.policy_path(iteration - 1)).network
    period = to_ticks(config.gait.period)
    with tqdm(total=epochs, desc=f"iteration {iteration}: train", unit="epoch", leave=False) as bar:

        def progress(_epoch: int, _of: int, train_loss: float, validation_loss: float) -> None:
            bar.set_postfix(train=f"{train_loss:.4f}", validation=f"{validation_loss:.4f}")
            bar.update()

        result = fit(
            network,
            data,
            config.training,
            config.policy,
            epochs,
            run.torch_seed("order", iteration),
            period,
            progress,
            checkpoint,
        )
    if done and done["train_loss"] != result.train_loss[-1]:
        raise RunError(
            f"{run.policy_path(iteration)} is lost, and training it again gave a loss of "
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
    save(policy, run.policy_path(iteration))
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
    robustness, _ = evaluate(run.config, run.policy_path(iteration), "select", workers)
    record = run.record(
        "validate", iteration, **to_json(robustness), seconds=time.perf_counter() - began
    )
    tqdm.write(
        f"iteration {iteration}: {robustness.successes} of {robustness.episodes} select starts, "
        f"{robustness.falls} fell, {robustness.stalls} stalled"
    )
    return record


def best(run: Run, last: int, first: int = 0) -> dict[str, Any]:
    """Of iterations first to last, the policy with most successes on `select`.

    Among equals, the one that has seen most data: where all succeed, tracking errors differ by
    chance, and later policies stand harder pushes (``benchmarks/README.md``).
    """
    if done := run.done("best", 0):
        return done

    def merit(iteration: int) -> tuple[int, int]:
        return (run.done("validate", iteration) or {})["successes"], iteration

    winner = max(range(first, last + 1), key=merit)
    return run.record("best", 0, best_iteration=winner)
