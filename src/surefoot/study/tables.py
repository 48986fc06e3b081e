"""A comparison in Markdown: what the policies can do, how they differ, and what they cost.

A dash stands for what has not been measured yet. `docs/methods.md` has these tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from surefoot.config import Backend
from surefoot.evaluation.push_limits import PushDifference, PushResult
from surefoot.evaluation.report import disturbances
from surefoot.evaluation.robustness import Robustness, VelocityError
from surefoot.evaluation.statistics import PairedDifference, wilson
from surefoot.runs.run_cost import RunCost
from surefoot.study.markdown_text import markdown, percent_range
from surefoot.study.records import (
    Comparison,
    Difference,
    Differences,
    Measured,
    Row,
)

RESULTS = (
    "simulator",
    "method",
    "success",
    "strict",
    "fell",
    "stalled",
    "diverged",
    "body contact, of them successes",
    "MSE, successes, whole episode",
    "MSE, all, from 1 s on",
    "push [N s]",
    "least, most",
)
LATCHING = ("would have latched, of them successes", "initial states outside the profile")
"""Additional columns for robots with a hardware profile."""
DIFFERENCES = (
    "simulator",
    "method",
    "success, to the expert",
    "success, to the baseline",
    "push, to the expert",
    "push, to the baseline",
)
COST = (
    "method",
    "policy of iteration",
    "expert [s]",
    "MPC solves",
    "fell in pre-training",
    "fell after it",
    "per robot-minute",
    "near falls, of them in the tail",
    "expert's queries lost",
    "MPC diverged",
    "takeovers",
    "expert share",
    "frames kept",
    "recoveries by tilt, by bounds",
    "wall time [s]: collect, train, validate, gates",
)


def comparison_tables(comparison: Comparison) -> str:
    """The comparison in Markdown: what the policies can do, how they differ, what they cost."""
    measured = [
        (simulator, row, row.results[simulator])
        for simulator in get_args(Backend)
        for row in comparison.rows
        if simulator in row.results
    ]
    profile = comparison.config.robot.profile
    results = [
        (
            simulator,
            row.label,
            *robustness_cells(each.evaluation),
            *push_cells(each.pushes),
            *(latching_cells(each.evaluation) if profile else []),
        )
        for simulator, row, each in measured
    ]
    differences = [
        (simulator, row.label, *difference_cells(row.differences[simulator]))
        for simulator, row, _ in measured
        if simulator in row.differences
    ]
    costs = [
        (row.label, _iteration(row), *cost_cells(row.cost))
        for row in comparison.rows
        if row.cost is not None
    ]
    return "\n\n".join(
        [
            _about_results(comparison, [each for _, _, each in measured]),
            markdown((*RESULTS, *LATCHING) if profile else RESULTS, results),
            _about_differences(comparison),
            markdown(DIFFERENCES, differences),
            _about_costs(comparison),
            markdown(COST, costs),
        ]
    )


def _about_results(comparison: Comparison, measured: Sequence[Measured]) -> str:
    """What the first table shows."""
    share = 100 * comparison.config.push.success
    robots = sorted(
        {f"{each.pushes.episodes} robots" for each in measured if each.pushes is not None}
    )
    disturbed = disturbances(comparison.config)
    settings = ", ".join(f"{name} {value}" for name, value in disturbed.items())
    return (
        f"{comparison.episodes} `test` initial states of {', '.join(comparison.starts)}"
        f"{f', disturbed: {settings}' if settings else ''}; "
        "95 % intervals: Wilson's for success, Newcombe's for its paired differences, for pushes "
        "bootstrap intervals over robots, no narrower than the levels and the number of robots "
        "allow. Body contact: episodes in which something other than a foot touched the ground. "
        "MSE of vx, vy [m²/s²] and yaw rate [rad²/s²], in "
        f"thousandths. Push: the impulse that {share:.0f} % of "
        f"{', '.join(robots) or 'the robots'} survive, mean of all directions; "
        f"least and most of a direction.{_about_profile(comparison)}"
    )


def _about_profile(comparison: Comparison) -> str:
    """What the hardware profile does, if there is one."""
    profile = comparison.config.robot.profile
    if profile is None:
        return ""
    return (
        f" Torques are clipped to the hardware profile {profile}; would have latched: episodes in "
        "which an actual robot would have switched itself off by its own limits, and which go on "
        "here."
    )


def _about_differences(comparison: Comparison) -> str:
    """What the second table shows."""
    return (
        "Paired differences on the same initial states, row minus expert and row minus baseline "
        f"({comparison.baseline or 'no baseline'}): success in percentage points, pushes in N s."
    )


def _about_costs(comparison: Comparison) -> str:
    """What the third table shows."""
    return (
        "What each whole run cost; for a series of sizes, what the last size cost. Falls, with "
        "Wilson's 95 % intervals, and expert share are those of the iterations after the "
        "pre-training, over all rollouts and their time T together. Expert [s] is the time that "
        "the expert drove; where DAGGER asks it and the policy drives, only the MPC solves count. "
        f"Near falls tilted beyond {comparison.config.safety.fall_angle:.0f} degrees, where pushed "
        "robots may, and did not fall; those in the tail are among them."
    )


def robustness_cells(evaluation: Robustness | None) -> list[str]:
    """The eight cells of an evaluation."""
    if evaluation is None:
        return ["-"] * 8
    low, high = evaluation.success_interval
    n = evaluation.episodes
    return [
        f"{evaluation.successes} of {n}, {100 * evaluation.success_rate:.1f} % "
        f"({100 * low:.1f} to {100 * high:.1f})",
        f"{100 * evaluation.strict_successes / n:.1f} %",
        str(evaluation.falls),
        str(evaluation.stalls),
        str(evaluation.diverged),
        "-"
        if evaluation.body_contacts is None
        else f"{evaluation.body_contacts}, {evaluation.body_contact_successes}",
        _error_cell(evaluation.mse),
        _error_cell(evaluation.settled_mse),
    ]


def _error_cell(mse: VelocityError) -> str:
    """The velocity errors, in thousandths."""
    return ", ".join("-" if error is None else f"{1000 * error:.2f}" for error in mse)


def push_cells(pushes: PushResult | None) -> list[str]:
    """The two cells of the pushes."""
    if pushes is None:
        return ["-"] * 2
    low, high = pushes.mean_interval
    impulses = pushes.fitted_impulse
    return [
        f"{pushes.mean_fitted_impulse:.2f} ({low:.2f} to {high:.2f})",
        f"{min(impulses):.2f}, {max(impulses):.2f}",
    ]


def latching_cells(evaluation: Robustness | None) -> list[str]:
    """The two cells for robots with a hardware profile."""
    if evaluation is None or evaluation.latching is None:
        return ["-"] * 2
    latching = evaluation.latching
    return [f"{latching.latched}, {latching.latched_successes}", str(latching.outside)]


def difference_cells(differences: Differences) -> list[str]:
    """The four cells of a row's differences."""
    expert = differences.expert or Difference()
    baseline = differences.baseline or Difference()
    return [
        _difference_cell(expert.success, 100, 1),
        _difference_cell(baseline.success, 100, 1),
        _difference_cell(expert.pushes, 1, 2),
        _difference_cell(baseline.pushes, 1, 2),
    ]


def _difference_cell(
    pair: PairedDifference | PushDifference | None, scale: float, digits: int
) -> str:
    """A difference with its interval, times a scale; a dash where there is none."""
    if pair is None:
        return "-"
    text = f"{scale * pair.difference:+.{digits}f}"
    if pair.interval is None:
        return text
    low, high = pair.interval
    return f"{text} ({scale * low:+.{digits}f} to {scale * high:+.{digits}f})"


def _iteration(row: Row) -> str:
    """The iteration that trained a row's policy."""
    return "-" if row.policy is None else str(int(Path(row.policy).stem))


def cost_cells(cost: RunCost) -> list[str]:
    """The thirteen cells of a run's cost."""
    frames = max(cost.frames_kept, 1)
    seconds = cost.seconds
    walls = (seconds.collect, seconds.train, seconds.validate, seconds.gates)
    return [
        f"{cost.expert_seconds:.0f}",
        f"{cost.plans}",
        share_cell(cost.pretraining_falls, cost.pretraining_episodes),
        share_cell(cost.falls, cost.episodes),
        "-" if cost.falls_per_robot_minute is None else f"{cost.falls_per_robot_minute:.2f}",
        f"{cost.near_falls}, {cost.near_falls_in_tail}",
        f"{cost.queries_failed} of {cost.queries}" if cost.queries else "-",
        f"{cost.diverged}",
        "-" if cost.takeovers is None else f"{cost.takeovers}",
        "-" if cost.expert_share is None else f"{100 * cost.expert_share:.1f} %",
        f"{cost.frames_kept}",
        f"{100 * cost.recoveries_tilted / frames:.1f} %, "
        f"{100 * cost.recoveries_near_bounds / frames:.1f} %",
        ", ".join(f"{wall:.0f}" for wall in walls),
    ]


def share_cell(count: int | None, n: int | None) -> str:
    """How many of n, with the interval of their share; a dash where there are none."""
    if count is None or not n:
        return "-"
    low, high = wilson(count, n)
    return f"{count} of {n} {percent_range((low, high))}"
