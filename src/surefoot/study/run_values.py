"""What each run of a study shows, as one value: failures, expert share, success, errors, impulses.

Each function takes a cell and returns its value, or None if that has not been measured yet;
`runs_of` and `shares_of` collect the values of a technique's runs. Several trainings on the data of
one seed are not independent runs: they count as one run, with their mean. Read `run_statistics` for
what is computed from the values, and `claims` for what uses them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Literal

import numpy as np

from surefoot.config.study import Measure
from surefoot.evaluation.robustness import Robustness
from surefoot.runs.metrics import Best, Collected
from surefoot.study.folder import PolicyTest
from surefoot.study.results import CellResult
from surefoot.study.run_statistics import Runs

Counted = tuple[int, int]
"""Number of rollouts that are counted, and number of all rollouts."""
MONITORED = ("safe_dagger", "loco_safe_dagger")
"""Methods whose rollouts fail in the paper's count only if the MPC diverges: the expert takes over
before the policy falls."""
Axis = Literal[0, 1, 2]
"""Component of a velocity error: vx, vy, yaw rate."""


def runs_of(
    cells: Iterable[CellResult], value_of: Callable[[CellResult], float | None]
) -> Runs | None:
    """The value of each seed that has one, as the mean over its trainings; None without any.

    Args:
        cells: The cells of a technique under a setting.
        value_of: Returns the value of a cell, or None if that has not been measured yet.
    """
    by_seed: dict[int, list[float]] = {}
    for cell in cells:
        value = value_of(cell)
        if value is not None:
            by_seed.setdefault(cell.cell.seed, []).append(value)
    values = tuple(float(np.mean(trainings)) for trainings in by_seed.values())
    return Runs(values, None, tuple(by_seed)) if values else None


def shares_of(
    cells: Iterable[CellResult], counted: Callable[[CellResult], Counted | None]
) -> Runs | None:
    """The share of rollouts for each seed that has one; None without any.

    Trainings on the data of one seed are tried from the same initial states: they count as one run
    with the mean of their shares, and with no more rollouts than one of them has.

    Args:
        cells: The cells of a technique under a setting.
        counted: Returns the count for a cell, or None if that has not been measured yet.
    """
    by_seed: dict[int, list[Counted]] = {}
    for cell in cells:
        count = counted(cell)
        if count is not None and count[1] > 0:
            by_seed.setdefault(cell.cell.seed, []).append(count)
    if not by_seed:
        return None
    shares = [np.mean([events / n for events, n in counts]) for counts in by_seed.values()]
    rollouts = [min(n for _, n in counts) for counts in by_seed.values()]
    return Runs(tuple(map(float, shares)), tuple(rollouts), tuple(by_seed))


def is_trained(cell: CellResult) -> bool:
    """Whether the cell's run is finished."""
    return any(isinstance(record, Best) for record in cell.metrics)


def iterations_collected(cell: CellResult) -> list[Collected]:
    """What the iterations after the pre-training have collected, in their order.

    Returns:
        The records; none unless the run is finished.
    """
    if not is_trained(cell):
        return []
    found = [record for record in cell.metrics if isinstance(record, Collected)]
    return sorted(
        (record for record in found if record.iteration > 0), key=lambda record: record.iteration
    )


def paper_failures(record: Collected, method: str) -> int:
    """Failed rollouts of an iteration in the paper's count (IV-F), as far as it can be repeated.

    With LocoSafeDAGGER a rollout fails if the MPC diverges; SafeDAGGER, which the paper does not
    count, is counted in the same way. With LocoDAGGER a rollout fails if the MPC diverges while it
    drives, or if the robot falls while the policy drives, which here means in the tick of the fall.
    Our rollouts end with a fall, whereas those of the paper's research code continue, so an MPC
    that would have diverged on a fallen robot is not a failure here.

    Args:
        record: What an iteration has collected.
        method: Name of the method.
    """
    if method in MONITORED:
        return record.diverged
    return record.diverged + record.falls - record.falls_expert_driving


def failed(records: Sequence[Collected], method: str) -> Counted:
    """The failures of some iterations in the paper's count, and the number of their rollouts."""
    failures = sum(paper_failures(record, method) for record in records)
    return failures, sum(record.episodes for record in records)


def fell(records: Sequence[Collected]) -> Counted:
    """The rollouts of some iterations that ended in a fall, whoever drove, and their total."""
    return sum(record.falls for record in records), sum(record.episodes for record in records)


def lost(records: Sequence[Collected]) -> Counted:
    """The rollouts of some iterations that ended in a fall or a diverging MPC, and their total."""
    ended = sum(record.falls + record.diverged for record in records)
    return ended, sum(record.episodes for record in records)


def falls_per_minute(cell: CellResult) -> float | None:
    """Falls per minute of rollouts after the pre-training, tails included [1/min]."""
    records = iterations_collected(cell)
    minutes = [record.rollout_seconds_with_tail for record in records]
    known = [seconds / 60 for seconds in minutes if seconds is not None]
    if not records or len(known) < len(records):
        return None
    return sum(record.falls for record in records) / sum(known) if sum(known) > 0.0 else None


def _with_rollouts(records: Sequence[Collected]) -> list[Collected]:
    """The iterations whose budget allowed any rollout: in the others nobody drove."""
    return [record for record in records if record.episodes > 0]


def expert_share(records: Sequence[Collected]) -> float | None:
    """The share of the time before the tails that the expert drove, mean over some iterations."""
    found = [record.expert_share for record in _with_rollouts(records)]
    return float(np.mean(found)) if found else None


def share_with_tail(cell: CellResult) -> float | None:
    """The share of the whole time, tails included, that the expert drove, mean over iterations."""
    records = _with_rollouts(iterations_collected(cell))
    found = [record.expert_share_with_tail for record in records]
    return float(np.mean(found)) if found else None


def largest_rise(cell: CellResult) -> float | None:
    """Largest rise of the expert's share from one iteration to the next; negative if none rises."""
    found = [record.expert_share for record in _with_rollouts(iterations_collected(cell))]
    return float(np.diff(found).max()) if len(found) > 1 else None


def solves(cell: CellResult) -> float | None:
    """Number of MPC solves in all iterations after the pre-training."""
    records = iterations_collected(cell)
    return float(sum(record.plans for record in records)) if records else None


def solves_per_second(cell: CellResult) -> float | None:
    """MPC solves after the pre-training for each second of rollouts before the tails [1/s]."""
    records = iterations_collected(cell)
    known = [record.rollout_seconds for record in records if record.rollout_seconds is not None]
    if not records or len(known) < len(records):
        return None
    return sum(record.plans for record in records) / sum(known) if sum(known) > 0.0 else None


def rollouts(cell: CellResult) -> float | None:
    """Number of rollouts after the pre-training."""
    records = iterations_collected(cell)
    return float(sum(record.episodes for record in records)) if records else None


def dataset_frames(cell: CellResult) -> float | None:
    """Number of frames in the dataset at the end."""
    records = iterations_collected(cell)
    return float(records[-1].dataset_frames) if records else None


def policy_tests(cell: CellResult, measurement: str) -> tuple[PolicyTest, ...]:
    """A measurement's results for a cell's policies, in their order; none until it is finished."""
    tests = cell.tests.get(measurement)
    return tests.policies if tests is not None and tests.finished else ()


def measured_robustness(
    cell: CellResult, measurement: str, which: Literal[0, -1]
) -> Robustness | None:
    """The robustness of a cell's first or last policy; None if not measured yet."""
    tests = policy_tests(cell, measurement)
    return tests[which].robustness if tests else None


def successes(robustness: Robustness | None) -> Counted | None:
    """Number of episodes that succeeded, and number of all episodes."""
    return None if robustness is None else (robustness.successes, robustness.episodes)


def tracking_error(robustness: Robustness | None, axis: Axis) -> float | None:
    """The paper's mean squared velocity error, over successful episodes; None without any."""
    return None if robustness is None else robustness.mse[axis]


def settled_error(robustness: Robustness | None, axis: Axis) -> float | None:
    """Mean squared velocity error from 1 s on, over all episodes that last that long."""
    return None if robustness is None else robustness.settled_mse[axis]


def early_error(cell: CellResult, measurement: str, axis: Axis) -> float | None:
    """Mean tracking error of the policies of the first half of the iterations."""
    tests = [test for test in policy_tests(cell, measurement) if test.iteration > 0]
    errors = [tracking_error(test.robustness, axis) for test in tests[: len(tests) // 2]]
    known = [error for error in errors if error is not None]
    return float(np.mean(known)) if known else None


def mean_impulse(cell: CellResult, measurement: str) -> float | None:
    """Impulse that the best policy withstands, mean of all directions [N s]."""
    test = cell.best_test(measurement)
    if test is None or test.pushes is None:
        return None
    return test.pushes.mean_fitted_impulse


def imitation_mrad(cell: CellResult, measurement: str) -> float | None:
    """Mean deviation of the best policy from the expert's targets [mrad]."""
    test = cell.best_test(measurement)
    return None if test is None or test.imitation is None else test.imitation.mean_mrad


def direction_impulses(cell: CellResult, measurement: str) -> tuple[float, ...] | None:
    """Impulse from each direction that the best policy withstands [N s]."""
    test = cell.best_test(measurement)
    return None if test is None or test.pushes is None else test.pushes.fitted_impulse


def unpushed(cell: CellResult, measurement: str) -> Counted | None:
    """Robots of the push test that survive unpushed under the best policy, and their total."""
    test = cell.best_test(measurement)
    if test is None or test.pushes is None:
        return None
    return test.pushes.successes[0][0], test.pushes.episodes


def best_value(cells: Sequence[CellResult], measurement: str, measure: Measure) -> Runs | None:
    """A measurement's result for the best policy of each run.

    Args:
        cells: The cells of a technique under a setting.
        measurement: Name of the measurement.
        measure: What it measures.

    Returns:
        Success as a share, the mean impulse [N s], or the deviation from the expert [mrad]; None
        if not measured yet.
    """
    if measure == "robustness":
        return shares_of(cells, lambda cell: successes(_best_robustness(cell, measurement)))
    if measure == "impulse":
        return runs_of(cells, lambda cell: mean_impulse(cell, measurement))
    return runs_of(cells, lambda cell: imitation_mrad(cell, measurement))


def _best_robustness(cell: CellResult, measurement: str) -> Robustness | None:
    """The robustness of a cell's best policy; None if not measured yet."""
    test = cell.best_test(measurement)
    return None if test is None else test.robustness
