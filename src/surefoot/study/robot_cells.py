"""The records of a survey of robots and gaits, and its table.

A `GaitCell` is one robot in one gait in one simulator, in its own JSON file. Next: `robot_survey`,
which measures them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from surefoot.bench.plan import Times
from surefoot.config import Backend, CommandBox
from surefoot.config.gait_table import GAITS
from surefoot.config.json_io import read_record
from surefoot.config.robot_table import ROBOTS
from surefoot.evaluation.robustness import Robustness
from surefoot.scenarios.preparation import Triple
from surefoot.study.markdown_text import markdown, percent_range

HEAD = (
    "robot",
    "gait",
    "simulator",
    "vx, vy [m/s], yaw rate [rad/s]",
    "plan [ms] (p99)",
    "succeeded",
    "fell, stalled, gave up",
    "mean error of the mean vx, vy, yaw rate (largest)",
    "torque used (peak)",
    "speed used (peak), time beyond",
)


@dataclass(frozen=True)
class Use:
    """How much of the joints' limits a robot used, as a share of each joint's own limit.

    Attributes:
        settled: The largest share from 1 s on.
        peak: The largest share of the whole episodes, with the recovery from the perturbation.
        beyond: The share of the time from 1 s on in which a joint was at its limit or beyond.
    """

    settled: float
    peak: float
    beyond: float


@dataclass(frozen=True)
class Tracking:
    """How far a robot's mean velocity was from its command, from 1 s on, over whole gait periods.

    Attributes:
        mean: The mean absolute error of vx, vy [m/s] and yaw rate [rad/s].
        largest: The largest absolute error of each.
    """

    mean: Triple
    largest: Triple


@dataclass(frozen=True)
class Walked:
    """What was measured of a robot in a gait that it walks.

    Attributes:
        box: The commands: those asked for, or the largest part of them that it walks.
        command_gain: The gains of vx, vy and yaw rate.
        from_rest: The largest error of the mean vx, vy [m/s] and yaw rate [rad/s] of robots that
            began at rest, undisturbed, at commands all over the box.
        plan_ms: Wall time of cold plans [ms].
        robustness: The expert's success from perturbed initial states.
        tracking: The velocities in the episodes that succeeded; None without any.
        torque: The torques in these episodes; None without any.
        speed: The joint rates in them; None without any, or without a speed limit.
    """

    box: CommandBox
    command_gain: Triple
    from_rest: Triple
    plan_ms: Times
    robustness: Robustness
    tracking: Tracking | None
    torque: Use | None
    speed: Use | None


@dataclass(frozen=True)
class GaitCell:
    """One robot in one gait in one simulator.

    Attributes:
        robot: The name of the robot.
        gait: The name of the gait.
        simulator: The simulator of the episodes; everything else is measured in MuJoCo.
        key: SHA-256 of all that the initial states and the episodes depend on.
        episodes: The number of initial states that were asked for.
        seconds: How long each episode lasts [s].
        asked: The commands that were asked for.
        versions: Package -> its version, and the processor.
        walked: What was measured; None if the robot does not walk in this gait.
        reason: Why it does not, or not at all commands asked for; empty if it does.
    """

    robot: str
    gait: str
    simulator: Backend
    key: str
    episodes: int
    seconds: float
    asked: CommandBox
    versions: dict[str, str]
    walked: Walked | None = None
    reason: str = ""

    @property
    def file(self) -> str:
        """The name of the cell's file."""
        return f"{self.robot}-{self.gait}-{self.simulator}.json"

    @property
    def title(self) -> str:
        """The cell's name in texts."""
        return f"{self.robot}, {self.gait}, {self.simulator}"


@dataclass(frozen=True)
class RobotSurvey:
    """A survey: cells with the same number of episodes of the same length.

    Attributes:
        cells: The cells, by robot, gait and simulator.
    """

    cells: tuple[GaitCell, ...]


def read_cells(folder: Path) -> dict[str, GaitCell]:
    """The cells that a folder holds, by the names of their files.

    Raises:
        ValueError: A JSON file in it is not a cell.
    """
    return {path.name: read_record(path, GaitCell) for path in sorted(folder.glob("*.json"))}


def in_order(cells: Sequence[GaitCell]) -> RobotSurvey:
    """The survey of some cells, with the package's robots first."""
    simulators = get_args(Backend)
    robots = list(ROBOTS) + sorted({cell.robot for cell in cells} - set(ROBOTS))
    gaits = list(GAITS)
    ordered = sorted(
        cells,
        key=lambda cell: (
            robots.index(cell.robot),
            gaits.index(cell.gait),
            simulators.index(cell.simulator),
        ),
    )
    return RobotSurvey(tuple(ordered))


def survey_page(survey: RobotSurvey) -> str:
    """The survey in Markdown: the table, and what the robots do not walk, with the reasons."""
    lines = [
        (cell.robot, cell.gait, cell.simulator, *_cells_of(cell.walked))
        for cell in survey.cells
        if cell.walked is not None
    ]
    parts = [_about(survey), markdown(HEAD, lines)]
    smaller = [_because(cell) for cell in survey.cells if cell.walked is not None and cell.reason]
    if smaller:
        parts.append("In a smaller box than was asked for:\n\n" + "\n".join(smaller))
    not_walked = [_because(cell) for cell in survey.cells if cell.walked is None]
    if not_walked:
        parts.append("Not walked:\n\n" + "\n".join(not_walked))
    return "\n\n".join(parts)


def _about(survey: RobotSurvey) -> str:
    """How many initial states there were, how long the episodes were, and on which processors."""
    if not survey.cells:
        return "Nothing has been measured yet."
    first = survey.cells[0]
    processors = sorted({cell.versions.get("processor", "unknown") for cell in survey.cells})
    return (
        f"{first.episodes} perturbed initial states each, {first.seconds:g} s; "
        f"{'; '.join(processors)}."
    )


def _cells_of(walked: Walked) -> list[str]:
    """The table's cells for what was measured."""
    box = walked.box
    robustness = walked.robustness
    times = walked.plan_ms
    share = percent_range(robustness.success_interval)
    return [
        ", ".join(f"{low:g} to {high:g}" for low, high in box.axes),
        f"{times.median:.1f} ({times.p99:.1f})",
        f"{robustness.successes} of {robustness.episodes} {share}",
        f"{robustness.falls}, {robustness.stalls}, {robustness.diverged}",
        _tracking_cell(walked.tracking),
        _use_cell(walked.torque),
        _speed_cell(walked.speed),
    ]


def _tracking_cell(tracking: Tracking | None) -> str:
    """The cell of the tracking error; a dash without any success."""
    if tracking is None:
        return "-"
    mean = ", ".join(f"{error:.3f}" for error in tracking.mean)
    largest = ", ".join(f"{error:.3f}" for error in tracking.largest)
    return f"{mean} ({largest})"


def _use_cell(use: Use | None) -> str:
    """The cell of the share of a limit; a dash where there is none."""
    return "-" if use is None else f"{use.settled:.2f} ({use.peak:.2f})"


def _speed_cell(use: Use | None) -> str:
    """The cell of the share of the speed limits, in bold where they are exceeded."""
    if use is None:
        return "-"
    text = _use_cell(use)
    return f"**{text}, {100 * use.beyond:.1f} %**" if use.settled > 1.0 else text


def _because(cell: GaitCell) -> str:
    """A line of a list: a cell, and why it is not what was asked for."""
    return f"- {cell.title}: {' '.join(cell.reason.split())}"
