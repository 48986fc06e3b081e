"""The expert under test: both simulators, two horizons, the published rules and this package's own.

Every variant starts from the same stored `test` initial states, perturbed with the paper's standard
deviations and with 1.5 times those, and is pushed the same way. A survey in progress is a sequence
of immutable `Survey` records; each is written after its measurement, so an interrupted survey
resumes where it stopped. Read `expert_cells` for the fields, `docs/expert.md` for the results.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import get_args

from surefoot.bench.plan import cold_plans, times_of
from surefoot.config import Backend, Config, PushConfig, simulated
from surefoot.config.expert_rules import published_rules
from surefoot.config.json_io import read_record
from surefoot.evaluation.push import push_recovery
from surefoot.evaluation.robustness import evaluate
from surefoot.evaluation.statistics import wilson
from surefoot.files import claim_file, write_json
from surefoot.robots.scaling import with_own_values
from surefoot.runs.versions import versions
from surefoot.scenarios.starts import PACKAGED, load_starts
from surefoot.study.expert_cells import Nodes, Rules, Survey, SurveyCell, Survival
from surefoot.workers import Workers

PUSHES = PushConfig(split="nominal", speeds=4, before=0.25, after=1.75, resolution=0.1, levels=50)
"""The expert starts in its settled gait, so it does not need two seconds before the push."""
PAPER, WIDE = PACKAGED
"""The sets of initial states with the paper's deviations, and with 1.5 times those."""

HORIZONS: tuple[Nodes, ...] = ((20, 10), (10, 5))
"""The horizons: centroidal and kinematic nodes."""

logger = logging.getLogger(__name__)


def survey_expert(
    config: Config, simulator: Backend | None, episodes: int, workers: Workers, path: Path | None
) -> Survey:
    """Measure every variant of the expert.

    Args:
        config: What the variants have in common, with the package's own rules.
        simulator: The only simulator to measure in; None measures in all.
        episodes: Number of initial states of each set, 5 s each.
        workers: Processes that run the episodes.
        path: File to write to after each measurement, and to resume from if it exists.

    Raises:
        ValueError: The file holds a survey of another configuration, of other versions or initial
            states, or another process is adding to it.
    """
    config = with_own_values(config)
    simulators = get_args(Backend) if simulator is None else (simulator,)
    survey = Survey(
        config=config,
        episodes=episodes,
        versions=versions("bullet"),
        starts={name: load_starts(name).hash for name in PACKAGED},
        cells=(),
        lost_by_all={},
    )
    if path is not None:
        claim_file(path)
        if path.exists():
            survey = resume_survey(path, survey)
    cells = {cell.variant: cell for cell in survey.cells}
    for variant in product(simulators, HORIZONS, get_args(Rules)):
        begun = cells.get(variant, SurveyCell(*variant))
        for cell in measure_variant(begun, config, episodes, workers):
            cells[variant] = cell
            measured = tuple(cells.values())
            survey = replace(survey, cells=measured, lost_by_all=lost_by_all(measured))
            if path is not None:
                write_json(path, survey)
    return survey


def measure_variant(
    cell: SurveyCell, config: Config, episodes: int, workers: Workers
) -> Iterator[SurveyCell]:
    """Measure what is missing of a variant.

    Args:
        cell: The variant, with what has been measured of it before.
        config: What the variants have in common, with the package's own rules.
        episodes: Number of initial states of each set.
        workers: Processes that run the episodes.

    Yields:
        The variant after each measurement.
    """
    config = variant_of(config, cell, episodes)
    if cell.plan_ms is None:
        cell = replace(cell, plan_ms=times_of(cold_plans(config)))
        yield cell
    if cell.paper is None:
        survival = measure_survival(config, PAPER, workers)
        cell = replace(cell, paper=survival)
        yield cell
        logger.info("%s: %d of %d, %s", cell.title, survival.survived, episodes, PAPER)
    if cell.wide is None:
        survival = measure_survival(config, WIDE, workers)
        cell = replace(cell, wide=survival)
        yield cell
        logger.info("%s: %d of %d, %s", cell.title, survival.survived, episodes, WIDE)
    if cell.push is None:
        push = push_recovery(config, None, workers)
        cell = replace(cell, push=push)
        yield cell
        logger.info("%s: %.2f N s", cell.title, push.mean_fitted_impulse)


def variant_of(config: Config, cell: SurveyCell, episodes: int) -> Config:
    """The configuration of a variant of the expert.

    Args:
        config: What the variants have in common, with the package's own rules.
        cell: The variant.
        episodes: Number of initial states of each set.
    """
    centroidal, kinematic = cell.nodes
    expert = replace(
        config.expert,
        centroidal=replace(config.expert.centroidal, nodes=centroidal),
        kinematic=replace(config.expert.kinematic, nodes=kinematic),
    )
    variant = replace(
        simulated(config, cell.simulator),
        expert=expert,
        evaluation=replace(config.evaluation, episodes=episodes),
        push=PUSHES,
    )
    return published_rules(variant) if cell.rules == "published" else variant


def measure_survival(config: Config, starts: str, workers: Workers) -> Survival:
    """Run a variant on one set of initial states.

    Args:
        config: The variant's configuration.
        starts: Name of the set.
        workers: Processes that run the episodes.
    """
    stored = load_starts(starts)
    robustness, summary = evaluate(config, None, "test", workers, stored=stored)
    lost = summary.failed
    survived = int((~lost).sum())
    return Survival(
        episodes=robustness.episodes,
        survived=survived,
        survived_interval=wilson(survived, len(lost)),
        stalls=robustness.stalls,
        lost=tuple(summary.start[lost].tolist()),
        invalid_plans=robustness.invalid_plans,
        mse=robustness.settled_mse,
        starts_hash=robustness.starts_hash,
    )


def lost_by_all(cells: Sequence[SurveyCell]) -> dict[str, tuple[int, ...]]:
    """Ids of the initial states that every variant measured so far has lost.

    Args:
        cells: The variants.

    Returns:
        Simulator and set of initial states -> ids, for those that any variant was measured on.
    """
    lost: dict[str, tuple[int, ...]] = {}
    for simulator in get_args(Backend):
        own = [cell for cell in cells if cell.simulator == simulator]
        for name, survivals in (
            (PAPER, [cell.paper for cell in own if cell.paper is not None]),
            (WIDE, [cell.wide for cell in own if cell.wide is not None]),
        ):
            if survivals:
                common = set.intersection(*(set(survival.lost) for survival in survivals))
                lost[f"{simulator} {name}"] = tuple(sorted(common))
    return lost


def resume_survey(path: Path, survey: Survey) -> Survey:
    """The survey that a file already holds.

    Args:
        path: The file.
        survey: What is to be measured, without results.

    Raises:
        ValueError: The file has another configuration, other versions or other initial states.
    """
    before = read_record(path, Survey)
    for name, same in (
        ("config", before.config == survey.config),
        ("episodes", before.episodes == survey.episodes),
        ("versions", before.versions == survey.versions),
        ("starts", before.starts == survey.starts),
    ):
        if not same:
            raise ValueError(f"{path} holds a survey of other {name}; name another file")
    return before
