"""Studies made by hand: folders of results with numbers that no run has made."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from surefoot.config.studies import named_study
from surefoot.config.study import StudyConfig
from surefoot.evaluation.digits import as_digits
from surefoot.files import write_atomic, write_json
from surefoot.runs.layout import CONFIG_FILE, KEPT_POLICY_FILE
from surefoot.runs.metrics import Best, StageRecord, format_line
from surefoot.runs.setup import Setup
from surefoot.study.cells import Cell, cells_of
from surefoot.study.folder import (
    JobRecord,
    PolicyTest,
    StudySetup,
    Tests,
    read_study,
    results_folder,
    run_config,
    save_job,
    save_setup,
    save_tests,
)
from tests.fakes.results import push_result, robustness
from tests.fakes.runs import collected_record, trained_record, validated_record

DIRECTIONS = 8
PROCESSOR = "a processor <of 2 & more cores>"


def paper_like(seeds: int = 2) -> StudyConfig:
    """The paper's study with fewer seeds, and a name that would break a careless page."""
    study = named_study("paper")
    first, *others = study.techniques
    safe = replace(others[-1], title='<b>"Safe" & sound</b> $x$')
    return replace(study, techniques=(first, *others[:-1], safe), seeds=tuple(range(seeds)))


def write_study(
    folder: Path, study: StudyConfig, iterations: int = 2, without: tuple[str, ...] = ()
) -> Path:
    """Write the results of a study.

    Args:
        folder: The folder.
        study: The study.
        iterations: Number of iterations of each run after its first one.
        without: Names of the cells that have no results.
    """
    save_setup(folder, StudySetup(study, "c0ffee", "0.1.0", "float32"))
    for cell in cells_of(study):
        if cell.name not in without:
            write_cell(folder, study, cell, iterations)
    return folder


def write_cell(folder: Path, study: StudyConfig, cell: Cell, iterations: int) -> None:
    """Write the results of a cell; its numbers follow from its name."""
    rng = np.random.default_rng(list(cell.name.encode()))
    config = run_config(read_study(folder), cell)
    results = results_folder(folder, cell)
    expert = study.technique(cell.technique).method == "expert"
    sizes = [150_000 + 55_000 * i + int(rng.integers(9_000)) for i in range(iterations + 1)]
    if not expert:
        records = run_records(config.method.name, sizes, rng)
        write_json(results / CONFIG_FILE, Setup(config, {"python": "3.11"}))
        lines = [*(format_line(record) for record in records), b""]
        write_atomic(results / "metrics.jsonl", b"\n".join(lines))
        write_atomic(results / KEPT_POLICY_FILE, b"not a policy")
    for measurement in study.measurements:
        every = range(iterations + 1) if measurement.policies == "all" else [iterations]
        tests = [
            policy_test(measurement.measure, 0 if expert else i, None if expert else sizes[i], rng)
            for i in ([0] if expert else every)
        ]
        save_tests(folder, cell, Tests(measurement.name, tuple(tests), True))
        job = f"{measurement.name}--{cell.name.replace('/', '--')}"
        versions = {"python": "3.11", "surefoot": "0.1.0"}
        record = JobRecord(
            job, "c0ffee", (PROCESSOR,), versions, "float32", "2026-11-01", 90.5, True
        )
        save_job(folder, cell, record)


def run_records(method: str, sizes: list[int], rng: np.random.Generator) -> list[StageRecord]:
    """The metrics of a run."""
    records: list[StageRecord] = []
    for i, frames in enumerate(sizes):
        falls = 0 if i == 0 else int(rng.integers(4))
        expert = 1.0 if i == 0 else float(0.5**i + 0.02 * rng.random())
        if i == 0 or method != "behavior_cloning":
            records.append(
                collected_record(
                    i,
                    falls=falls,
                    falls_expert_driving=min(falls, 1),
                    diverged=int(rng.integers(2)),
                    expert_share=expert,
                    expert_share_with_tail=(10 * expert + 1) / 11,
                    failed_episodes=tuple(100_000 * i + k for k in range(falls)),
                    dataset_frames=frames,
                    frames_kept=frames if i == 0 else frames - sizes[i - 1],
                )
            )
        records.append(trained_record(i, frames=frames, train_loss=0.02 / (i + 1)))
        records.append(validated_record(i))
    records.append(Best(best_iteration=len(sizes) - 1))
    return records


def policy_test(
    measure: str, iteration: int, frames: int | None, rng: np.random.Generator
) -> PolicyTest:
    """What a measurement says of a policy, or of the expert if there are no frames."""
    sha256 = None if frames is None else f"{rng.integers(2**60):064x}"
    if measure == "impulse":
        impulses = rng.uniform(1.5, 3.0, DIRECTIONS) + (0.5 if frames is None else 0.0)
        fitted = tuple(impulses.tolist())
        largest = tuple((0.2 * np.floor(impulses / 0.2)).tolist())
        pushes = push_result(fitted, max_impulse=largest, mean_max_impulse=float(np.mean(largest)))
        return PolicyTest(iteration, frames, sha256, pushes=pushes)
    successes = 100 if frames is None else 80 + 5 * iteration + int(rng.integers(5))
    successes = min(successes, 100)
    mse = 0.004 / (iteration + 1) * rng.uniform(0.8, 1.2, 3)
    outcomes = as_digits([0] * successes + [1] * (100 - successes))
    measured = robustness(successes, 100, mse=tuple(mse.tolist()), outcomes=outcomes)
    return PolicyTest(iteration, frames, sha256, robustness=measured)
