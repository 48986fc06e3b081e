"""Which policies can be compared, and the settings in which all of them are measured.

Each run contributes only its policy, with the gains, and its cost; robot, physics, gait, commands,
expert, falls, evaluation and pushes must be the same in all runs. Next: `comparison`, which
measures the policies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from surefoot.config import (
    TABLE_I,
    Config,
    DisturbanceConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
)
from surefoot.config.json_io import changes
from surefoot.config.methods import IterativeConfig
from surefoot.config.scenarios import acting
from surefoot.config.study import EXPERT
from surefoot.files import sha256_of
from surefoot.methods import METHODS
from surefoot.mpc.gaits import names_of
from surefoot.robots.identity import description_hash
from surefoot.rollouts.jobs import PLANNER
from surefoot.runs.layout import RunError
from surefoot.runs.metrics import Collected, Trained, Validated
from surefoot.runs.policies import find_policy
from surefoot.runs.run import Run, open_run
from surefoot.runs.run_cost import run_cost
from surefoot.scenarios.starts import starts_of
from surefoot.study.records import Row

WhichPolicy = Literal["best", "last"]
"""The policy that a run chose (`runs.metrics.Best`), or the one that it trained last."""


def open_comparable_runs(folders: Sequence[Path]) -> list[Run]:
    """Open the runs.

    Raises:
        ValueError: There are no runs, or they cannot be compared.
        RunError: A folder holds no run.
    """
    if not folders:
        raise ValueError("there are no runs to compare; name the folders of at least one")
    runs = [open_run(folder) for folder in folders]
    for run in runs:
        check_comparable(run, runs[0])
    return runs


def rows_of(runs: Sequence[Run], names: Sequence[str], which: WhichPolicy) -> tuple[Row, ...]:
    """The expert's row, and one for each run, without results.

    Args:
        runs: The runs.
        names: Labels of the runs, in their order; without any, those of `label_of`.
        which: The policy of each run to compare.

    Raises:
        ValueError: The names do not fit, or two runs hold the same policy.
        RunError: A run has no such policy.
    """
    rows = [Row(EXPERT)]
    for run, label in zip(runs, labels_of(runs, names), strict=True):
        policy = run.best_policy_path if which == "best" else last_policy(run)
        find_policy(policy)  # one that cannot be used fails here, not hours later
        digest = sha256_of(policy)
        for row in rows:
            if row.sha256 == digest:
                raise ValueError(
                    f"{run.folder} and {row.run} hold the same policy; name one of them"
                )
        method = run.config.method
        T = method.T if isinstance(method, IterativeConfig) else 0.0
        row = Row(
            label,
            run=str(run.folder),
            method=run.method,
            policy=str(policy),
            sha256=digest,
            cost=run_cost(run.metrics, T),
        )
        rows.append(row)
    return tuple(rows)


def labels_of(runs: Sequence[Run], names: Sequence[str]) -> list[str]:
    """A label for each run, all of them different.

    Args:
        runs: The runs.
        names: The labels, if the user gave any.

    Raises:
        ValueError: There are more or fewer names than runs, or two rows have the same label.
    """
    if names and len(names) != len(runs):
        raise ValueError(f"{len(names)} names for {len(runs)} runs; give one for each")
    labels = list(names)
    if not names:
        labels = [label_of(run) for run in runs]
        count = Counter([EXPERT, *labels])
        labels = [
            f"{label} ({run.name})" if count[label] > 1 else label
            for label, run in zip(labels, runs, strict=True)
        ]
    count = Counter([EXPERT, *labels])
    twice = sorted(label for label in labels if count[label] > 1)
    if twice:
        raise ValueError(f"rows of the same name: {', '.join(twice)}; tell them apart with --names")
    return labels


def shared_settings(config: Config, episodes: int) -> Config:
    """The part of a run's configuration that affects an evaluation; the rest is the default.

    Args:
        config: The run's configuration.
        episodes: Number of initial states.
    """
    safety = replace(
        TABLE_I,
        fall_height=config.safety.fall_height,
        fall_angle=config.safety.fall_angle,
        body_contact=config.safety.body_contact,
        grace=config.safety.grace,
        stepping_from=config.safety.stepping_from,
    )
    return Config(
        robot=config.robot,
        simulation=replace(config.simulation, backend="mujoco"),
        gait=config.gait,
        commands=config.commands,
        start_set=config.start_set,
        expert=config.expert,
        safety=safety,
        evaluation=replace(config.evaluation, episodes=episodes),
        push=config.push,
    )


def _same_starts(run: Run, other: Run) -> bool:
    """Whether two runs have the same initial states, even if in different files."""
    own = [each.setup.starts_hash for each in (run, other)]
    return own[0] != "" and own[0] == own[1]


def check_comparable(run: Run, first: Run) -> None:
    """Check that two runs share settings and initial states, and learned from the package's expert.

    Raises:
        ValueError: Robot, physics, gait, commands, expert, falls, evaluation, pushes or initial
            states differ; or a run has several gaits, or learned from another expert.
    """
    _check_gaits(first)
    _check_gaits(run)
    settings = shared_settings(run.config, 1)
    if _same_starts(run, first):  # each run has its own copy
        settings = replace(settings, start_set=first.config.start_set)
    own = run.config.robot.spec
    others = first.config.robot.spec
    if own and others and description_hash(own) == description_hash(others):  # the same here
        settings = replace(settings, robot=replace(settings.robot, spec=others))
    for name, value, other in changes(settings, shared_settings(first.config, 1)):
        raise ValueError(
            f"{run.folder} has {name} {value}, {first.folder} has {other}: they cannot be compared"
        )
    stored = starts_of(first.config)
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
                "here: use sf.evaluate and sf.push_recovery with your plan, from Python"
            )


def _check_gaits(run: Run) -> None:
    """Check that a run has one gait, like the expert's row and the pushes.

    Raises:
        ValueError: It has several.
    """
    if run.config.other_gaits:
        raise ValueError(
            f"{run.folder} is a run of several gaits ({names_of(run.config)}), and runs of one "
            "gait are compared: name runs of `surefoot train` with --gait, or measure this one "
            "with `surefoot evaluate`"
        )


def label_of(run: Run) -> str:
    """The method's title, and what distinguishes the run."""
    method = run.config.method
    collection = run.config.collection
    parts = [METHODS[run.method].title]
    if isinstance(method, LocoDaggerConfig):
        parts.append(f"alpha {method.alpha:g}")
    if isinstance(method, LocoSafeDaggerConfig):
        parts.append(" + ".join(method.gates))
    plain = DisturbanceConfig()
    taught = acting(collection, teaches=isinstance(method, IterativeConfig) and method.teaches)
    if taught.pushes or taught.expert_impulse != plain.expert_impulse:
        parts.append("pushes")
    if (
        collection.friction != plain.friction
        or collection.mass != plain.mass
        or collection.noise != plain.noise
        or collection.delay != plain.delay
    ):
        parts.append("disturbed")
    return ", ".join(parts)


def last_policy(run: Run) -> Path:
    """File of the policy trained last.

    Raises:
        RunError: No policy has been trained.
    """
    trained = [record.iteration for record in run.metrics if isinstance(record, Trained)]
    if not trained:
        raise RunError(
            f"{run.folder} has no policy yet; repeat the command that began it (`surefoot train` "
            "with --resume)"
        )
    return run.policy_path(max(trained))
