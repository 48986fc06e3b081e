"""Speed of the whole: an evaluation and a training run, beside what their parts cost at best.

The floor of a stage is its plans, robot-milliseconds and training steps at the bare rates of
``bench``, measured in the same run, spread evenly over the processes; training has one.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.bench.engine import bench_engine, engine_floor, standing_policy
from surefoot.bench.plan import bench_plan, cold_plans, plan_table, times_of
from surefoot.bench.train import bench_train
from surefoot.config import Config, method_name
from surefoot.learning.policy import save
from surefoot.methods import METHODS
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.jobs import Job, run_episodes
from surefoot.runs.metrics import Collected, Trained, Validated
from surefoot.runs.run import Run, create
from surefoot.scenarios.starts import load_starts
from surefoot.types import TICKS_PER_SECOND
from surefoot.workers import Workers

STAGES = ("collect", "train", "validate")


def bench_evaluation(config: Config, workers: Workers) -> dict[str, Any]:
    """Time of the paper's evaluation, 100 episodes of 5 s, of a policy that stands.

    Returns:
        ``seconds``, ``floor_seconds`` (bare steps and matrix products, spread over the workers),
        ``ratio``, ``episodes``, ``workers``.
    """
    episodes = config.evaluation.episodes
    stored = load_starts()["nominal"]
    starts = stored[np.arange(episodes) % len(stored)]
    rate = engine_floor(config)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "standing.safetensors"
        save(standing_policy(config), file)
        job = Job(config, starts, starts.id, PolicyOnly(), config.evaluation.duration, policy=file)
        run_episodes(job[: workers.count], workers, "warming up")
        began = time.perf_counter()
        summary = run_episodes(job, workers, "evaluation")
        seconds = time.perf_counter() - began
    least = float(summary.ticks.sum()) / rate / workers.count
    return {
        "episodes": episodes,
        "workers": workers.count,
        "seconds": seconds,
        "floor_seconds": least,
        "ratio": seconds / least,
    }


def bench_end_to_end(
    config: Config, workers: Workers, folder: Path | None = None
) -> dict[str, Any]:
    """Train once, from nothing to the best policy, and say where the time went.

    Args:
        config: of the run.
        workers: processes.
        folder: of the run, which stays; without it a temporary one.

    Returns:
        ``seconds``; of each of ``collect``, ``train``, ``validate``: ``seconds`` and
        ``floor_seconds``; ``other_seconds``; ``plan_ms``, ``floor_robot_ms_per_s``,
        ``floor_step_ms`` that the floors are made of; ``select_successes`` of the best policy;
        ``method``, ``workers``.
    """
    plan_ms = times_of(cold_plans(config, 100)).median
    rate = engine_floor(config)
    step_ms = bench_train(config)["floor_step_ms"]
    with tempfile.TemporaryDirectory() as temporary:
        run = create(folder or Path(temporary) / "run", config)
        name = method_name(config)
        began = time.perf_counter()
        METHODS[name].train(run, workers, None)
        seconds = time.perf_counter() - began
        stages = stage_times(run, workers.count, plan_ms, rate, step_ms)
        assert run.best is not None
        winner = run.validated(run.best.best_iteration)
        assert winner is not None
    return {
        "method": name,
        "workers": workers.count,
        "seconds": seconds,
        **stages,
        "other_seconds": seconds - sum(stage["seconds"] for stage in stages.values()),
        "plan_ms": plan_ms,
        "floor_robot_ms_per_s": rate,
        "floor_step_ms": step_ms,
        "select_successes": winner.successes,
    }


def stage_times(
    run: Run, workers: int, plan_ms: float, rate: float, step_ms: float
) -> dict[str, dict[str, float]]:
    """Seconds of each kind of stage of a run, and what their parts cost at best.

    Args:
        run: finished.
        workers: processes that it ran on.
        plan_ms: of one plan [ms].
        rate: robot-ms per second and process.
        step_ms: of one training step [ms].
    """
    totals = {stage: {"seconds": 0.0, "floor_seconds": 0.0} for stage in STAGES}
    for record in run.metrics:
        if isinstance(record, Collected | Validated):
            rollouts = record.robot_seconds * TICKS_PER_SECOND / rate
            plans = record.plans * plan_ms / 1e3
            totals[record.stage]["seconds"] += record.seconds
            totals[record.stage]["floor_seconds"] += (rollouts + plans) / workers
        elif isinstance(record, Trained):
            totals["train"]["seconds"] += record.seconds
            totals["train"]["floor_seconds"] += record.steps * step_ms / 1e3
    return totals


def end_to_end_table(figures: dict[str, Any]) -> str:
    """The figures of `bench_end_to_end` as a table."""
    lines = [f"{'stage':<10}{'s':>9}{'floor, s':>10}{'ratio':>7}"]
    for stage in STAGES:
        mine, least = figures[stage]["seconds"], figures[stage]["floor_seconds"]
        lines.append(f"{stage:<10}{mine:>9.1f}{least:>10.1f}{mine / least:>7.2f}")
    lines.append(f"{'other':<10}{figures['other_seconds']:>9.1f}")
    lines.append(f"{'all':<10}{figures['seconds']:>9.1f}")
    return "\n".join(lines)


def bench_table(what: str, figures: dict[str, Any]) -> str:
    """The figures of a measurement for people."""
    if what == "plan":
        return plan_table(figures)
    if what == "end_to_end":
        return end_to_end_table(figures)
    return "\n".join(
        f"{what:<12}{key:<24}{value:>12.4g}"
        if isinstance(value, float)
        else f"{what:<12}{key:<24}{value:>12}"
        for key, value in figures.items()
    )


MEASURES: dict[str, Callable[[Config, Workers], dict[str, Any]]] = {
    "plan": lambda config, _: bench_plan(config),
    "engine": lambda config, _: bench_engine(config),
    "train": lambda config, _: bench_train(config),
    "evaluation": bench_evaluation,
    "end_to_end": bench_end_to_end,
}
"""What `surefoot bench` measures, in this order."""
