"""The expert under test: both simulators, two horizons, published and own rules, on equal terms.

Every variant starts from the same stored `test` starts, perturbed with the paper's standard
deviations and with 1.5 times those, and takes the same pushes. What is measured is written down at
once: a survey that is interrupted goes on where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, get_args

import numpy as np
from tqdm import tqdm

from surefoot.bench.plan import cold_plans, times_of
from surefoot.config import Backend, Config, PushConfig, simulated
from surefoot.config.json_io import to_json
from surefoot.config.presets import published_rules
from surefoot.evaluation.push import push_recovery
from surefoot.evaluation.robustness import evaluate
from surefoot.evaluation.statistics import wilson
from surefoot.files import write_json
from surefoot.runs.versions import versions
from surefoot.scenarios.starts import PACKAGED, load_starts
from surefoot.study.tables import markdown
from surefoot.workers import Workers

PUSHES = PushConfig(split="nominal", speeds=4, before=0.25, after=1.75, resolution=0.1, levels=50)
"""The expert is pushed out of its settled gait, in which it needs no two seconds before."""
HORIZONS = ((20, 10), (10, 5))
"""Centroidal and kinematic nodes of 50 ms."""
RULES: dict[str, Callable[[Config], Config]] = {
    "published": published_rules,
    "own": lambda config: config,
}


def survey(
    config: Config, simulator: Backend | None, episodes: int, workers: Workers, path: Path | None
) -> dict[str, Any]:
    """Measure every variant of the expert.

    Args:
        config: what the variants have in common, and the own rules.
        simulator: the only one to measure; both without it.
        episodes: starts of each set, 5 s each.
        workers: who runs the episodes.
        path: file to write to after each measurement, and to go on with.

    Returns:
        ``cells``: for each variant ``simulator``, ``nodes``, ``rules``; ``plan_ms`` (see
        `times_of`); for the starts and, after ``wide_``, for those with 1.5 times the deviations
        ``episodes``, ``survived``, ``survived_interval`` (Wilson 95 %), ``stalls``, ``lost`` (ids),
        ``invalid_plans``, ``mse`` (vx, vy, yaw rate, from 1 s on) and ``starts_hash``; ``push``
        (see `push_recovery`). ``lost_by_all``: for each simulator and set the starts that every
        variant loses.

    Raises:
        ValueError: the file holds a survey of another configuration, of other versions or starts.
    """
    simulators = get_args(Backend) if simulator is None else (simulator,)
    record: dict[str, Any] = {
        "config": to_json(config),
        "episodes": episodes,
        "versions": versions(),
        "starts": {name: load_starts(name).hash for name in PACKAGED},
        "cells": [],
    }
    if path is not None and path.exists():
        found = json.loads(path.read_text())
        for key in ("config", "episodes", "versions", "starts"):
            if found.get(key) != record[key]:
                raise ValueError(f"{path} holds a survey of other {key}; name another file")
        record = found

    def keep(cell: dict[str, Any], **figures: Any) -> None:
        cell.update(figures)
        record["lost_by_all"] = lost_by_all(record["cells"])
        if path is not None:
            write_json(path, record)

    for name, nodes, rules in product(simulators, HORIZONS, RULES):
        variant = variant_of(config, name, nodes, rules, episodes)
        which = {"simulator": name, "nodes": list(nodes), "rules": rules}
        cell = next((c for c in record["cells"] if which.items() <= c.items()), None)
        if cell is None:
            cell = which
            record["cells"].append(cell)
        label = f"{name}, {nodes[0]}/{nodes[1]} nodes, {rules} rules"
        if "plan_ms" not in cell:
            keep(cell, plan_ms=to_json(times_of(cold_plans(variant))))
        for prefix, stored in zip(("", "wide_"), PACKAGED, strict=True):
            if f"{prefix}survived" not in cell:
                keep(cell, **survival(variant, stored, workers, label, prefix))
                tqdm.write(f"{label}: {cell[prefix + 'survived']} of {episodes}, {stored}")
        if "push" not in cell:
            keep(cell, push=push_recovery(variant, None, workers, label))
            tqdm.write(f"{label}: {cell['push']['mean_fitted_impulse']:.2f} Ns")
    return record


def variant_of(
    config: Config, simulator: Backend, nodes: tuple[int, int], rules: str, episodes: int
) -> Config:
    """One variant of the expert."""
    expert = replace(
        config.expert,
        centroidal=replace(config.expert.centroidal, nodes=nodes[0]),
        kinematic=replace(config.expert.kinematic, nodes=nodes[1]),
    )
    return RULES[rules](
        replace(
            simulated(config, simulator),
            expert=expert,
            evaluation=replace(config.evaluation, episodes=episodes),
            push=PUSHES,
        )
    )


def survival(
    config: Config, stored: str, workers: Workers, label: str, prefix: str
) -> dict[str, Any]:
    """The figures of one variant on one set of starts, their keys after ``prefix``."""
    figures, summary = evaluate(config, None, "test", workers, label, stored=load_starts(stored))
    lost = summary.failed
    named = {
        "episodes": figures["episodes"],
        "survived": int((~lost).sum()),
        "survived_interval": wilson(int((~lost).sum()), len(lost)),
        "stalls": figures["stalls"],
        "lost": summary.start[lost].tolist(),
        "invalid_plans": figures["invalid_plans"],
        "mse": figures["settled_mse"],
        "starts_hash": figures["starts_hash"],
    }
    return {f"{prefix}{key}": value for key, value in named.items()}


def lost_by_all(cells: list[dict[str, Any]]) -> dict[str, list[int]]:
    """Ids of the starts that every variant measured so far loses, for each simulator and set."""
    result = {}
    for simulator, (prefix, stored) in product(
        get_args(Backend), zip(("", "wide_"), PACKAGED, strict=True)
    ):
        lost = [
            set(cell[f"{prefix}lost"])
            for cell in cells
            if cell["simulator"] == simulator and f"{prefix}lost" in cell
        ]
        if lost:
            result[f"{simulator} {stored}"] = sorted(set.intersection(*lost))
    return result


def table(record: dict[str, Any]) -> str:
    """The survey as a Markdown table."""
    head = (
        "simulator",
        "nodes",
        "rules",
        "survived",
        "survived, sigmas x 1.5",
        "RMS error vx, vy [m/s]",
        "push at 80 %, mean [Ns] (least, most)",
        "plan [ms] (p99): contacts, centroidal, kinematics, inverse dynamics",
    )
    rows = []
    for cell in record["cells"]:
        nodes = "/".join(map(str, cell["nodes"]))
        columns = [cell["simulator"], nodes, cell["rules"], *(["-"] * 5)]
        for column, prefix in ((3, ""), (4, "wide_")):
            if f"{prefix}survived" in cell:
                low, high = cell[f"{prefix}survived_interval"]
                columns[column] = (
                    f"{cell[f'{prefix}survived']} of {cell[f'{prefix}episodes']} "
                    f"({100 * low:.1f} to {100 * high:.1f} %)"
                )
        if None not in cell.get("mse", [None]):
            columns[5] = ", ".join(f"{np.sqrt(value):.3f}" for value in cell["mse"][:2])
        if "push" in cell:
            push = cell["push"]["fitted_impulse"]
            columns[6] = f"{np.mean(push):.2f} ({min(push):.2f}, {max(push):.2f})"
        if "plan_ms" in cell:
            plan = cell["plan_ms"]
            stages = ", ".join(f"{value:.2f}" for value in plan["stages"].values())
            columns[7] = f"{plan['median']:.2f} ({plan['p99']:.2f}): {stages}"
        rows.append(columns)
    return markdown(head, rows)
