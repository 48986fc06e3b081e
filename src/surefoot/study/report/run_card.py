"""The model card of a run: what its policy is, how it was trained, what it can do, where it fails.

`run_card` reads the run's folder, or the folder of a run among a study's results. The card of an
unfinished run shows what exists so far. Next: `run_page`, which shows the card.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from surefoot.config import Config
from surefoot.config.json_io import changes, read_record
from surefoot.config.presets import preset
from surefoot.evaluation.report import EvaluationReport
from surefoot.files import sha256_of
from surefoot.robots.scaling import with_own_values
from surefoot.robots.several_gaits import for_each_gait
from surefoot.runs.episode_ids import EpisodeId
from surefoot.runs.layout import ATTEMPTS_FILE, KEPT_POLICY_FILE
from surefoot.runs.metrics import Collected, StageRecord, Validated, best_iteration
from surefoot.runs.run import Run, open_run
from surefoot.study.folder import Tests
from surefoot.study.layout import TESTS_FOLDER
from surefoot.study.report.collecting import (
    ABOUT_FAILURES,
    FAILED,
    FALLS,
    LIMIT,
    SHARE,
    falls,
    paper_failures,
)
from surefoot.study.report.numbers import Estimate, Number, share
from surefoot.study.report.panels import (
    Curve,
    Group,
    Panel,
    ReportFigure,
    RunPoint,
    grid,
    group_of,
    percent,
)
from surefoot.study.report.run_evaluations import read_evaluations
from surefoot.study.report.source import StageSource, stages

SUCCESS = percent("success on the select initial states")
"""The share of the `select` initial states from which a policy succeeds."""


@dataclass(frozen=True)
class Failure:
    """An episode that fell, or that the expert gave up on, while data was collected.

    Attributes:
        iteration: The iteration that collected it.
        episode: Its index in the iteration.
        command: The command that replays it; None among the results of a study, which have neither
            the policies nor all initial states of the run.
    """

    iteration: int
    episode: int
    command: str | None


@dataclass(frozen=True)
class RunCard:
    """What is known about a run.

    Attributes:
        folder: Folder of the run.
        method: Name of its method.
        config: Its configuration.
        versions: Versions with which it was started, by name.
        best_iteration: Iteration of the best policy; None if the run is not finished.
        is_field_run: Whether it continued learning on a robot, behind a bridge.
        metrics: Its metrics, in the order of the file.
        tests: What was measured of its policies, if the run is among the results of a study.
        evaluations: What the command evaluate has stored in its folder, by the name of the file.
        policy: File of the best policy; None if there is none.
        policy_sha256: SHA-256 of that file; empty without one.
        failures: Episodes that failed while data was collected.
        figures: Its figures.
    """

    folder: Path
    method: str
    config: Config
    versions: dict[str, str]
    best_iteration: int | None
    is_field_run: bool
    metrics: tuple[StageRecord, ...]
    tests: tuple[Tests, ...]
    evaluations: dict[str, EvaluationReport]
    policy: Path | None
    policy_sha256: str
    failures: tuple[Failure, ...]
    figures: tuple[ReportFigure, ...]


def run_card(folder: Path) -> RunCard:
    """What is known about a run.

    Args:
        folder: Folder of the run, or of a run among the results of a study.

    Raises:
        RunError: There is no run, or one of its files cannot be read.
        ValueError: A measurement or an evaluation cannot be read; the message names its file.
    """
    run = open_run(folder)
    metrics = tuple(run.metrics)
    best = best_iteration(metrics)
    policy = _policy_of(run, best)
    is_field_run = (folder / ATTEMPTS_FILE).exists()
    measured = sorted(folder.glob(f"{TESTS_FOLDER}/*.json"))
    tests = tuple(read_record(path, Tests) for path in measured)
    return RunCard(
        folder=folder,
        method=run.method,
        config=run.config,
        versions=run.setup.versions,
        best_iteration=best,
        is_field_run=is_field_run,
        metrics=metrics,
        tests=tests,
        evaluations=read_evaluations(folder),
        policy=policy,
        policy_sha256="" if policy is None else sha256_of(policy),
        failures=tuple(_failures(run, metrics, is_field_run)),
        figures=_figures(run.method, is_field_run, stages(metrics)),
    )


def option_changes(config: Config) -> list[tuple[str, object, object]]:
    """The options of a run that differ from the paper's, with both values.

    Robot, gaits and seed are taken from the run, so whatever follows from them is not listed.
    """
    paper = replace(
        preset(config.method.name, "paper"),
        robot=config.robot,
        gait=config.gait,
        other_gaits=config.other_gaits,
        start_set=config.start_set,
        seed=config.seed,
    )
    return list(changes(config, for_each_gait(with_own_values, paper)))


def _policy_of(run: Run, best: int | None) -> Path | None:
    """File of the best policy, in a run's folder or among the results of a study."""
    kept = run.folder / KEPT_POLICY_FILE
    if kept.is_file():
        return kept
    if best is not None:
        path = run.policy_path(best)
        return path if path.is_file() else None
    return None


def _failures(run: Run, metrics: Sequence[StageRecord], is_field_run: bool) -> list[Failure]:
    """The episodes that failed while data was collected."""
    failures = []
    has_data = run.dataset.folder.is_dir()
    for record in metrics:
        if not isinstance(record, Collected):
            continue
        if is_field_run and record.iteration > 0:
            continue  # a robot's episode is not simulated again; its flight tells what happened
        for episode in record.failed_episodes:
            index = EpisodeId.from_number(episode).index
            command = None
            if has_data:
                where = shlex.quote(str(run.folder))
                command = f"surefoot play {where} --iteration {record.iteration} --episode {index}"
            failures.append(Failure(record.iteration, index, command))
    return failures


def _figures(
    method: str, is_field_run: bool, records: Sequence[StageSource]
) -> tuple[ReportFigure, ...]:
    """The figure of a run: failures, share of the expert, and success along its iterations."""
    collected = [
        each for each in records if isinstance(each.record, Collected) and each.record.iteration > 0
    ]
    validated = [each for each in records if isinstance(each.record, Validated)]
    panels = []
    captions = []
    if collected:
        captions.append(
            "Failed rollouts in the paper's count and physical falls while collecting data, and "
            f"the share of the time that the MPC drove. {ABOUT_FAILURES}"
        )
        failed = [_group(each, paper_failures(each, method)) for each in collected]
        fell = [_group(each, falls(each)) for each in collected]
        drove = [_group(each, each.share("expert_share")) for each in collected]
        panels = [
            Panel(FAILED.title, FAILED, _curve("failed", failed), limit=LIMIT),
            Panel(FALLS.title, FALLS, _curve("fell", fell), limit=LIMIT),
            Panel(SHARE.title, SHARE, _curve("MPC", drove)),
        ]
    if validated:
        captions.append(
            "The success of each policy on the select initial states, with Wilson's 95 % interval."
        )
        success = [_success(each) for each in validated]
        panels.append(Panel(SUCCESS.title, SUCCESS, _curve("success", success)))
    if not panels:
        return ()
    is_series = method == "behavior_cloning"
    figure = ReportFigure(
        "iterations",
        "Along the amount of data" if is_series else "Along the iterations",
        " ".join([*captions, _about_iterations(method, is_field_run)]),
        "policies" if is_series else "iterations",
        grid(panels, 2),
        over_runs=False,
    )
    return (figure,)


def _about_iterations(method: str, is_field_run: bool) -> str:
    """What the numbers of the policies mean, and which policy is kept."""
    if method == "behavior_cloning":
        return "Policies are numbered by the amount of data; that of most data is kept."
    if is_field_run:
        return "Iteration 0 is the pre-training; the last policy is kept."
    return "Iteration 0 is the pre-training; the best policy is chosen by its success."


def _curve(title: str, groups: Sequence[Group]) -> tuple[Curve, ...]:
    """The only curve of a panel."""
    return (Curve(title, title, 0, tuple(groups)),)


def _group(stage: StageSource, value: Number) -> Group:
    """What a stage has measured, at its iteration."""
    label = str(stage.record.iteration)
    return group_of(label, [RunPoint(0, stage.number("iteration"), value)])


def _success(stage: StageSource) -> Group:
    """The success of a policy with its interval, at its iteration."""
    value = share(stage.number("successes"), stage.number("episodes"))
    low = stage.number("success_interval", 0)
    high = stage.number("success_interval", 1)
    return replace(_group(stage, value), estimate=Estimate(value, low, high, 1))
