"""The methods side by side: policies of several runs, and the expert, on the same ground.

All are evaluated from the same `test` starts and take the same pushes, in each simulator, under
the first run's settings; of a run come only its policy, with its gains, and what it cost. What is
measured is written down at once: a comparison that is interrupted goes on where it stopped.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from itertools import product
from pathlib import Path
from typing import Any, Literal

from tqdm import tqdm

from surefoot.config import (
    Backend,
    Config,
    DisturbanceConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    SafetyConfig,
    simulated,
)
from surefoot.config.json_io import changes, to_json
from surefoot.evaluation.push import push_difference, push_recovery
from surefoot.evaluation.robustness import evaluate
from surefoot.evaluation.statistics import paired_difference
from surefoot.files import as_digits, from_digits, write_json
from surefoot.methods import METHODS
from surefoot.rollouts.jobs import PLANNER
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.accounting import cost_of
from surefoot.runs.metrics import Collected, Trained, Validated
from surefoot.runs.policies import find_policy
from surefoot.runs.run import Run, RunError, open_run
from surefoot.runs.versions import versions
from surefoot.scenarios.starts import load_starts
from surefoot.types import BoolArray
from surefoot.workers import Workers

EXPERT = "expert"
"""Label of the expert's row."""


def compare(
    runs: Sequence[Path],
    simulators: Sequence[Backend],
    episodes: int,
    workers: Workers,
    path: Path | None = None,
    *,
    names: Sequence[str] = (),
    baseline: Path | None = None,
    which: Literal["best", "last"] = "best",
    pushes: bool = True,
    push_speeds: int | None = None,
) -> dict[str, Any]:
    """Measure the policies of several runs, and the expert.

    Args:
        runs: their folders.
        simulators: to measure in.
        episodes: the first so many `test` starts.
        workers: who runs the episodes.
        path: file to write to after each measurement, and to go on with.
        names: labels of the runs; without them `label_of` each.
        baseline: the run that the others are compared with; the first behaviour cloning without it.
        which: `best`, the policy chosen on the `select` starts, or `last`.
        pushes: whether to push them.
        push_speeds: forward speeds of the robots pushed, ten of each; as configured without it.

    Returns:
        ``rows``: the expert's and one of each run, ``label``, ``run``, ``method``, ``policy``,
        ``sha256`` of the policy's file, ``cost`` (see `accounting.cost_of`); ``results``, for each
        simulator ``evaluation`` (see `evaluation.figures_of`; ``outcomes`` and ``strict`` have one
        digit a start, of `Outcome` and 1 for strict stepping) and ``pushes`` (see
        `push_recovery`); ``differences``, for each simulator to the ``expert`` and to the
        ``baseline``: ``success`` (see `paired_difference`) and ``pushes`` (see `push_difference`).
        ``baseline``: its label.

    Raises:
        ValueError: runs that cannot be compared, or a file that holds another comparison.
        RunError: a folder without a run, or without such a policy.
    """
    config, rows = entries(runs, names, which, episodes)
    if push_speeds is not None:
        config = replace(config, push=replace(config.push, speeds=push_speeds))
    labels = {Path(row["run"]): row["label"] for row in rows if row["run"]}
    cloned = (row["label"] for row in rows if row["method"] == "behavior_cloning")
    if baseline is not None and baseline not in labels:
        raise ValueError(f"the baseline {baseline} is none of {', '.join(map(str, labels))}")
    record: dict[str, Any] = {
        "config": to_json(config),
        "episodes": episodes,
        "versions": versions("bullet"),
        "starts": {load_starts().name: load_starts().hash},
        "baseline": next(cloned, None) if baseline is None else labels[baseline],
        "rows": rows,
    }
    if path is not None and path.exists():
        take_over(path, record)
    for simulator, row in product(simulators, rows):
        ground = simulated(config, simulator)
        policy = None if row["policy"] is None else Path(row["policy"])
        results, label = row["results"].setdefault(simulator, {}), f"{simulator}, {row['label']}"
        if "evaluation" not in results:
            figures, summary = evaluate(ground, policy, "test", workers, label)
            figures["outcomes"] = as_digits(summary.outcome)
            figures["strict"] = as_digits(summary.strict)
            results["evaluation"] = figures
            keep(path, record)
            tqdm.write(f"{label}: {figures['successes']} of {episodes}, {figures['falls']} fell")
        if pushes and "pushes" not in results:
            results["pushes"] = push_recovery(ground, policy, workers, label)
            keep(path, record)
            tqdm.write(f"{label}: {results['pushes']['mean_fitted_impulse']:.2f} Ns")
    for row in rows:
        row["differences"] = differences(record, row)
    keep(path, record)
    return record


def keep(path: Path | None, record: dict[str, Any]) -> None:
    """Write the record down."""
    if path is not None:
        write_json(path, record)


def entries(
    runs: Sequence[Path], names: Sequence[str], which: Literal["best", "last"], episodes: int
) -> tuple[Config, list[dict[str, Any]]]:
    """The configuration under which all are evaluated, and the rows, without results.

    Raises:
        ValueError: runs that cannot be compared, or names that do not fit.
    """
    if not runs:
        raise ValueError("compare what? Name the folders of runs")
    if names and len(names) != len(runs):
        raise ValueError(f"{len(names)} names for {len(runs)} runs; give one for each")
    opened = [open_run(folder) for folder in runs]
    for run in opened:
        check_comparable(run, opened[0])
    labels = list(names) or [label_of(run) for run in opened]
    count = Counter([EXPERT, *labels])
    if not names:
        labels = [
            f"{label} ({run.folder.name})" if count[label] > 1 else label
            for label, run in zip(labels, opened, strict=True)
        ]
        count = Counter(labels)
    if twice := sorted(label for label in labels if count[label] > 1 or label == EXPERT):
        raise ValueError(f"rows of the same name: {', '.join(twice)}; tell them apart with --names")
    nothing = dict.fromkeys(("run", "method", "policy", "sha256", "cost"))
    rows: list[dict[str, Any]] = [{"label": EXPERT, **nothing, "results": {}}]
    for run, label in zip(opened, labels, strict=True):
        policy = run.best_policy_path if which == "best" else last_policy(run)
        find_policy(policy)  # one that cannot be used fails here, not hours later
        digest = sha256(policy.read_bytes()).hexdigest()
        if same := [row["run"] for row in rows if row["sha256"] == digest]:
            raise ValueError(f"{run.folder} and {same[0]} hold the same policy; name one of them")
        rows.append(
            {
                "label": label,
                "run": str(run.folder),
                "method": run.method,
                "policy": str(policy),
                "sha256": digest,
                "cost": cost_of(run.metrics, getattr(run.config.method, "T", 0.0)),
                "results": {},
            }
        )
    return replace(ground_of(opened[0].config, episodes), chunk=opened[0].config.chunk), rows


def ground_of(config: Config, episodes: int) -> Config:
    """What of a run's configuration bears on an evaluation, without the simulator; rest default."""
    falls = ("fall_height", "fall_angle", "grace", "stepping_from")
    return Config(
        robot=config.robot,
        simulation=replace(config.simulation, backend="mujoco"),
        gait=config.gait,
        expert=config.expert,
        safety=SafetyConfig(**{name: getattr(config.safety, name) for name in falls}),
        evaluation=replace(config.evaluation, episodes=episodes),
        push=config.push,
    )


def check_comparable(run: Run, first: Run) -> None:
    """Whether two runs stand on the same ground.

    Raises:
        ValueError: other physics, gait, expert, falls, evaluation, pushes or starts.
    """
    for name, value, other in changes(ground_of(run.config, 1), ground_of(first.config, 1)):
        raise ValueError(
            f"{run.folder} has {name} {value}, {first.folder} has {other}: they cannot be compared"
        )
    stored = load_starts()
    for record in run.metrics:
        if isinstance(record, Collected | Validated) and record.starts_hash != stored.hash:
            raise ValueError(
                f"{run.folder} was made from other starts ({record.starts_hash[:8]}...) than "
                f"{stored.name} ({stored.hash[:8]}...): results on different starts cannot be "
                "compared"
            )
        if isinstance(record, Collected) and record.expert != PLANNER:
            raise ValueError(
                f"{run.folder} learned from your own expert {record.expert}, which has no row "
                "here: use evaluation.evaluate and push.push_recovery with your plan, from Python"
            )


def label_of(run: Run) -> str:
    """The method, and what distinguishes the run."""
    method = run.config.method
    collection = run.config.collection
    parts = [METHODS[run.method].title]
    if isinstance(method, LocoDaggerConfig):
        parts.append(f"alpha {method.alpha:g}")
    if isinstance(method, LocoSafeDaggerConfig):
        parts.append(" + ".join(method.guard))
    if collection.pushes or collection.expert_impulse[1]:
        parts.append("pushes")
    plain = DisturbanceConfig()
    if any(
        getattr(collection, name) != getattr(plain, name)
        for name in ("friction", "mass", "noise", "delay")
    ):
        parts.append("disturbed")
    return ", ".join(parts)


def last_policy(run: Run) -> Path:
    """File of the policy trained last.

    Raises:
        RunError: none has been trained.
    """
    trained = [record.iteration for record in run.metrics if isinstance(record, Trained)]
    if not trained:
        raise RunError(f"{run.folder} has no policy yet; go on with `surefoot train ... --resume`")
    return run.policy_path(max(trained))


def take_over(path: Path, record: dict[str, Any]) -> None:
    """Fill in the results that a file holds already.

    Raises:
        ValueError: it is of another configuration, of other versions or starts, or holds results
            of policies that are not asked for, which would be lost.
    """
    found = json.loads(path.read_text())
    for key in ("episodes", "config", "versions", "starts"):
        if found.get(key) != record[key]:
            raise ValueError(f"{path} holds a comparison of other {key}; name another file")
    before = {row["sha256"]: row for row in found["rows"]}
    for row in record["rows"]:
        row["results"] = before.pop(row["sha256"], row)["results"]
    if before:
        others = ", ".join(f"{row['label']} ({row['policy']})" for row in before.values())
        raise ValueError(
            f"{path} also holds results of {others}: name these runs too, or another file; a run "
            "that was trained on has another policy"
        )


def differences(record: dict[str, Any], row: dict[str, Any]) -> dict[str, Any]:
    """Paired differences of a row to the expert and to the baseline, in each simulator."""
    labelled = {each["label"]: each for each in record["rows"]}
    found: dict[str, Any] = {}
    for simulator, (to, label) in product(
        row["results"], (("expert", EXPERT), ("baseline", record["baseline"]))
    ):
        if label is None or labelled[label] is row:
            continue
        mine, other = (each["results"].get(simulator, {}) for each in (row, labelled[label]))
        pair = found.setdefault(simulator, {}).setdefault(to, {})
        if "evaluation" in mine and "evaluation" in other:
            pair["success"] = paired_difference(succeeded(mine), succeeded(other))
        if "pushes" in mine and "pushes" in other:
            pair["pushes"] = push_difference(mine["pushes"], other["pushes"])
    return found


def succeeded(results: dict[str, Any]) -> BoolArray:
    """``(n,)`` True for each start that ended in success."""
    return from_digits(results["evaluation"]["outcomes"]) == Outcome.SUCCESS
