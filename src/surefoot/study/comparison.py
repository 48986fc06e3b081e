"""The methods side by side: policies of several runs, and the expert, in the same settings.

In each simulator, all are evaluated from the same `test` initial states and pushed the same way,
under the first run's settings. A comparison in progress is a sequence of immutable `Comparison`
records; each is written after its measurement, so an interrupted comparison resumes where it
stopped. Read `records` for the fields, `comparable` for which runs can be compared.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import get_args

from surefoot.config import Backend, Config, DisturbanceConfig, simulated
from surefoot.config.evaluation import shortened
from surefoot.config.json_io import changes, read_record
from surefoot.config.study import EXPERT
from surefoot.evaluation.push import push_recovery
from surefoot.evaluation.push_limits import push_difference
from surefoot.evaluation.report import check_disturbances
from surefoot.evaluation.robustness import evaluate, success_difference
from surefoot.files import claim_file, write_json
from surefoot.robots.load import with_profile
from surefoot.runs.versions import versions
from surefoot.scenarios.starts import starts_of
from surefoot.study.comparable import WhichPolicy, open_comparable_runs, rows_of, shared_settings
from surefoot.study.records import Comparison, Difference, Differences, Measured, Row
from surefoot.workers import Workers

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Measurements:
    """What is measured of each controller in a comparison.

    Attributes:
        simulators: The simulators to measure in.
        episodes: Number of `test` initial states, the first ones of the set.
        pushes: Whether to push the robots too.
        push_speeds: Number of forward speeds of the robots that are pushed, each at all phases of
            the gait (ten in a trot); None takes the runs' own number.
        push_directions: Number of directions of the pushes; None takes the runs' own number.
        push_resolution: Distance between two levels of the pushes [N s]; None takes the runs' own.
        starts: Name of the set of initial states, or its file; None is the set of the runs.
        disturbance: What disturbs the robots; None takes what disturbs the first run's own
            evaluation.
        profile: Hardware profile of the robots, or its file; None takes the runs' own.
    """

    simulators: tuple[Backend, ...] = get_args(Backend)
    episodes: int = 500
    pushes: bool = True
    push_speeds: int | None = None
    push_directions: int | None = None
    push_resolution: float | None = None
    starts: str | None = None
    disturbance: DisturbanceConfig | None = None
    profile: str | None = None


def compare(
    runs: Sequence[Path],
    measurements: Measurements,
    workers: Workers,
    path: Path | None = None,
    *,
    names: Sequence[str] = (),
    baseline: Path | None = None,
    which: WhichPolicy = "best",
) -> Comparison:
    """Measure the policies of several runs, and the expert.

    Args:
        runs: Folders of the runs.
        measurements: What is measured.
        workers: Processes that run the episodes.
        path: File to write to after each measurement, and to resume from if it exists.
        names: Labels of the runs; without them, the method and what distinguishes each run.
        baseline: Folder of the run that the others are compared with; without it the first run of
            behavior cloning.
        which: `best` for the policy chosen on the `select` initial states, or `last`.

    Raises:
        ValueError: The runs cannot be compared, the file holds another comparison, or another
            process is adding to it.
        RunError: A folder holds no run, or a run has no such policy.
    """
    opened = open_comparable_runs(runs)
    first = opened[0].config
    config = _config_of(first, measurements)
    if measurements.disturbance is not None:
        check_disturbances(config, first.evaluation.disturbance)
    stored = starts_of(config)
    rows = rows_of(opened, names, which)
    comparison = Comparison(
        config=config,
        episodes=measurements.episodes,
        versions=versions("bullet"),
        starts={stored.name: stored.hash},
        baseline=baseline_label(rows, baseline),
        rows=rows,
    )
    if path is not None:
        claim_file(path)
        if path.exists():
            comparison = resume_comparison(path, comparison)
    for simulator, number in product(measurements.simulators, range(len(rows))):
        row = comparison.rows[number]
        settings = simulated(config, simulator)
        for measured in measure_row(row, settings, measurements.pushes, workers):
            comparison = with_results(comparison, number, simulator, measured)
            save_comparison(path, comparison)
    comparison = with_differences(comparison)
    save_comparison(path, comparison)
    return comparison


def measure_row(row: Row, config: Config, pushes: bool, workers: Workers) -> Iterator[Measured]:
    """Measure what is missing of a controller in one simulator.

    Args:
        row: The controller, with what has been measured of it before.
        config: The configuration under which all are measured, in the simulator.
        pushes: Whether to push the robots too.
        workers: Processes that run the episodes.

    Yields:
        What is known of it after each measurement.
    """
    simulator = config.simulation.backend
    title = f"{simulator}, {row.label}"
    policy = None if row.policy is None else Path(row.policy)
    measured = row.results.get(simulator, Measured())
    if measured.evaluation is None:
        evaluation, _ = evaluate(config, policy, "test", workers)
        measured = replace(measured, evaluation=evaluation)
        yield measured
        logger.info(
            "%s: %d of %d, %d fell",
            title,
            evaluation.successes,
            evaluation.episodes,
            evaluation.falls,
        )
    if pushes and measured.pushes is None:
        found = push_recovery(config, policy, workers)
        yield replace(measured, pushes=found)
        logger.info("%s: %.2f N s", title, found.mean_fitted_impulse)


def _config_of(config: Config, measurements: Measurements) -> Config:
    """The configuration under which all are measured, from that of the first run."""
    settings = replace(shared_settings(config, measurements.episodes), chunk=config.chunk)
    push = shortened(
        settings.push,
        measurements.push_speeds,
        measurements.push_directions,
        measurements.push_resolution,
    )
    evaluation = settings.evaluation
    if measurements.disturbance is not None:
        evaluation = replace(evaluation, disturbance=measurements.disturbance)
    start_set = config.start_set if measurements.starts is None else measurements.starts
    robot = settings.robot
    if measurements.profile is not None:
        robot = with_profile(robot, measurements.profile)
    return replace(settings, robot=robot, push=push, evaluation=evaluation, start_set=start_set)


def baseline_label(rows: Sequence[Row], baseline: Path | None) -> str | None:
    """Label of the row that the others are compared with.

    Args:
        rows: The rows.
        baseline: Folder of its run; None takes the first run of behavior cloning, if there is any.

    Raises:
        ValueError: No row belongs to that run.
    """
    if baseline is None:
        cloned = [row.label for row in rows if row.method == "behavior_cloning"]
        return cloned[0] if cloned else None
    for row in rows:
        if row.run is not None and Path(row.run).resolve() == baseline.resolve():
            return row.label
    folders = ", ".join(row.run for row in rows if row.run is not None)
    raise ValueError(f"the baseline {baseline} is none of {folders}")


def with_results(
    comparison: Comparison, number: int, simulator: Backend, measured: Measured
) -> Comparison:
    """The comparison with what was measured of one row in one simulator."""
    rows = list(comparison.rows)
    results = rows[number].results | {simulator: measured}
    rows[number] = replace(rows[number], results=results)
    return replace(comparison, rows=tuple(rows))


def save_comparison(path: Path | None, comparison: Comparison) -> None:
    """Write the comparison to its file, if it has one."""
    if path is not None:
        write_json(path, comparison)


def resume_comparison(path: Path, comparison: Comparison) -> Comparison:
    """The comparison with the results that its file already holds.

    Args:
        path: The file.
        comparison: What is to be compared, without results.

    Raises:
        ValueError: The file has another configuration, other versions or other initial states, does
            not keep the initial states, or has results of policies that are not asked for, which
            would be lost.
    """
    before = read_record(path, Comparison)
    for name, of_file, asked_for in (
        ("episodes", before.episodes, comparison.episodes),
        ("versions", before.versions, comparison.versions),
        ("starts", before.starts, comparison.starts),
    ):
        if of_file != asked_for:
            raise ValueError(
                f"{path} holds a comparison of other {name}: {of_file}, not {asked_for}; name "
                "another file"
            )
    for name, of_file, asked_for in changes(before.config, comparison.config):
        raise ValueError(
            f"{path} holds a comparison of other config: {name} is {of_file}, not {asked_for}; "
            "name another file"
        )
    if not all(_keeps_initial_states(row) for row in before.rows):
        raise ValueError(
            f"{path} holds a comparison of an earlier version, which did not keep the initial "
            "states; name another file"
        )
    asked = {row.sha256 for row in comparison.rows}
    lost = [f"{row.label} ({row.policy})" for row in before.rows if row.sha256 not in asked]
    if lost:
        raise ValueError(
            f"{path} also holds results of {', '.join(lost)}: name these runs too, or another "
            "file; a run that was trained further has another policy"
        )
    results = {row.sha256: row.results for row in before.rows}
    rows = [replace(row, results=results.get(row.sha256, {})) for row in comparison.rows]
    return replace(comparison, rows=tuple(rows))


def _keeps_initial_states(row: Row) -> bool:
    """Whether a row records the initial states of its episodes."""
    evaluations = [measured.evaluation for measured in row.results.values()]
    return all(each is None or bool(each.initial_states) for each in evaluations)


def with_differences(comparison: Comparison) -> Comparison:
    """The comparison with the paired differences of its rows, in each simulator."""
    by_label = {row.label: row for row in comparison.rows}
    expert = by_label[EXPERT]
    baseline = None if comparison.baseline is None else by_label[comparison.baseline]
    rows = []
    for row in comparison.rows:
        differences = {}
        for simulator in row.results:
            pair = Differences(
                expert=difference_of(row, expert, simulator),
                baseline=difference_of(row, baseline, simulator),
            )
            if pair != Differences():
                differences[simulator] = pair
        rows.append(replace(row, differences=differences))
    return replace(comparison, rows=tuple(rows))


def difference_of(row: Row, other: Row | None, simulator: Backend) -> Difference | None:
    """Paired differences of a row to another in one simulator; None without another one."""
    if other is None or other is row:
        return None
    measured = row.results.get(simulator, Measured())
    reference = other.results.get(simulator, Measured())
    success = None
    if measured.evaluation is not None and reference.evaluation is not None:
        success = success_difference(measured.evaluation, reference.evaluation)
    pushes = None
    if measured.pushes is not None and reference.pushes is not None:
        pushes = push_difference(measured.pushes, reference.pushes)
    return Difference(success, pushes)
