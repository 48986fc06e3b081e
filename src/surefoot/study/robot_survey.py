"""Each robot in each gait: how well the expert does, and how much of the joints' limits it uses.

A cell of the survey is one robot in one gait in one simulator. It is prepared like any run
(`scenarios.prepare`), and its episodes, from perturbed initial states, are those of an evaluation
(`evaluation.robustness`). Each cell is written as soon as it is measured, so an interrupted survey
continues with the next one. Next: `robot_episodes`, what is computed from the episodes, and
`robot_cells`, the records and the table.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surefoot.bench.plan import cold_plans, times_of
from surefoot.config import Backend, CommandBox, Config, PerturbationConfig, RobotConfig, simulated
from surefoot.config.gait_table import GAITS
from surefoot.config.robot_table import ROBOTS
from surefoot.errors import unknown
from surefoot.evaluation.robustness import evaluation_job, robustness_of
from surefoot.files import write_json
from surefoot.mpc.gaits import with_gait
from surefoot.mpc.schedule import stands
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import size_of, with_own_values
from surefoot.rollouts.jobs import chunks_of
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.versions import versions
from surefoot.scenarios.keys import MEASURING, code_hash, ingredients_of, key_of
from surefoot.scenarios.make import SEED, SIZES, cycle_instants
from surefoot.scenarios.prepare import Prepared, prepare, prepared_key, with_preparation
from surefoot.scenarios.walking import GaitError
from surefoot.study.robot_cells import (
    GaitCell,
    RobotSurvey,
    Walked,
    in_order,
    read_cells,
)
from surefoot.study.robot_episodes import join_episodes, measure_episodes, tracking_of, use_of
from surefoot.workers import Workers, map_chunks

FORWARD = (-0.3, 0.6)
"""[m/s] Range of vx for a robot of Solo12's size; `box_of` scales it for others."""
SIDEWAYS = (-0.2, 0.2)
"""[m/s] Range of vy for a robot of Solo12's size."""
TURNING = (-0.5, 0.5)
"""[rad/s] Range of the yaw rate for every robot."""
NEITHER = "; but it does not walk all of that either"
"""Added to a refusal if the box that it proposes is refused as well."""
STILL = CommandBox((0.0, 0.0))
"""The commands of a robot that stands."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class SurveyPlan:
    """What is to be measured: every robot in every gait in every simulator.

    Attributes:
        robots: Names of robots of the package, or files with a `RobotSpec`.
        gaits: Names of gaits.
        simulators: The simulators of the episodes.
        episodes: The number of perturbed initial states of each cell.
        seconds: How long each episode lasts [s].
    """

    robots: tuple[str, ...]
    gaits: tuple[str, ...]
    simulators: tuple[Backend, ...]
    episodes: int
    seconds: float


@dataclass(frozen=True)
class CellTask:
    """A cell to measure.

    Attributes:
        cell: The cell, without results.
        config: The robot, the gait, the commands that are asked for, and the evaluation.
    """

    cell: GaitCell
    config: Config


def survey_robots(plan: SurveyPlan, folder: Path, workers: Workers) -> RobotSurvey:
    """Measure every cell that a folder does not hold yet.

    Args:
        plan: What is to be measured.
        folder: The folder of the cells, one JSON file each.
        workers: Processes that run the episodes.

    Returns:
        All cells of the folder, including those of earlier surveys.

    Raises:
        ValueError: There is no such robot or gait, a gait has too few initial states, or the folder
            holds cells that were measured differently.
        WriteError: A cell cannot be written.
    """
    tasks = tasks_of(plan)
    cells = read_cells(folder)
    check_same(tasks, cells, folder)
    left = [task for task in tasks if task.cell.file not in cells]
    for number, task in enumerate(left, start=1):
        cell = measure_gait(task, workers)
        write_json(folder / cell.file, cell)
        cells[cell.file] = cell
        logger.info(f"{number} of {len(left)}: {_in_words(cell)}")
    return in_order(list(cells.values()))


def tasks_of(plan: SurveyPlan) -> list[CellTask]:
    """The cells of a plan, in the order in which they are measured.

    Raises:
        ValueError: There is no such robot or gait, a gait has too few initial states, a robot or a
            gait is named twice, or none is named.
    """
    for name in plan.gaits:
        if name not in GAITS:
            raise ValueError(unknown("gait", name, GAITS))
        most = len(cycle_instants(GAITS[name])) * SIZES["test"].velocities
        most *= SIZES["test"].perturbations
        if not 1 <= plan.episodes <= most:
            raise ValueError(
                f"{plan.episodes} episodes of the gait {name}, which has {most} initial states; "
                f"use 1 to {most}"
            )
    evaluation = replace(Config().evaluation, episodes=plan.episodes, duration=plan.seconds)
    tasks = []
    for model in plan.robots:
        base = Config(evaluation=evaluation, robot=RobotConfig(model=model))
        robot = load_robot(base.robot)
        for gait in plan.gaits:
            config = with_gait(base, gait)
            config = replace(config, commands=box_of(robot, config))
            own = with_own_values(config, robot)
            prepared = prepared_key(own, PerturbationConfig(), SEED, SIZES)
            for simulator in plan.simulators:
                measured = ingredients_of(simulated(own, simulator))
                cell = GaitCell(
                    robot=robot.name,
                    gait=gait,
                    simulator=simulator,
                    key=key_of(prepared, measured, code_hash(MEASURING)),
                    episodes=plan.episodes,
                    seconds=plan.seconds,
                    asked=config.commands,
                    versions=versions(simulator),
                )
                tasks.append(CellTask(cell, config))
    if not tasks or len({task.cell.file for task in tasks}) < len(tasks):
        raise ValueError("name at least one robot and one gait, and each of them once")
    return tasks


def box_of(robot: RobotModel, config: Config) -> CommandBox:
    """The commands that a robot is to walk in a gait, rounded to 0.01; zero if the gait stands.

    Args:
        robot: The robot; vx and vy scale with the square root of its leg length.
        config: The gait.
    """
    if stands(config.gait):
        return STILL
    factor = size_of(robot).length_ratio ** 0.5
    low, high = (round(factor * end, 2) for end in FORWARD)
    right, left = (round(factor * end, 2) for end in SIDEWAYS)
    return CommandBox((low, high), (right, left), TURNING)


def check_same(tasks: Sequence[CellTask], cells: dict[str, GaitCell], folder: Path) -> None:
    """Check that a folder's cells can be in one table with those that are to be measured.

    Args:
        tasks: What is to be measured.
        cells: The cells of the folder, by the names of their files.
        folder: The folder, for the message.

    Raises:
        ValueError: A cell has other episodes, or one of a known robot depends on what has changed.
    """
    first = tasks[0].cell
    models = {name: name for name in ROBOTS}
    models |= {task.cell.robot: task.config.robot.model for task in tasks}
    for name, cell in cells.items():
        if (cell.episodes, cell.seconds) != (first.episodes, first.seconds):
            raise ValueError(
                f"{folder / name} was measured in {cell.episodes} episodes of {cell.seconds:g} s, "
                f"not in {first.episodes} of {first.seconds:g} s; name another folder with --out"
            )
        if cell.robot not in models:
            continue
        robots = (models[cell.robot],)
        plan = SurveyPlan(robots, (cell.gait,), (cell.simulator,), cell.episodes, cell.seconds)
        now = tasks_of(plan)[0].cell
        if (cell.key, cell.asked) != (now.key, now.asked):
            raise ValueError(
                f"{folder / name} is of another robot, expert, planner, code or package "
                "than there is now; name another folder with --out, or remove the file"
            )


def measure_gait(task: CellTask, workers: Workers) -> GaitCell:
    """Measure a cell.

    Args:
        task: The cell.
        workers: Processes that run the episodes.
    """
    cell = task.cell
    prepared, reason = prepare_largest(task.config)
    if prepared is None:
        return replace(cell, reason=reason)
    made = prepared.made
    config = replace(task.config, commands=made.commands, start_set=str(prepared.path))
    config = with_preparation(config, made)
    job = evaluation_job(simulated(config, cell.simulator), None, "test", prepared.starts)
    parts = map_chunks(measure_episodes, chunks_of(job), workers, cell.title)
    measured = join_episodes(parts)
    success = measured.summary.outcome == Outcome.SUCCESS
    limited = np.isfinite(load_robot(config.robot).speed_limit).any()
    walked = Walked(
        box=made.commands,
        command_gain=made.command_gain,
        from_rest=made.tracking_error,
        plan_ms=times_of(cold_plans(config, stored=prepared.starts)),
        robustness=robustness_of(measured.summary, prepared.starts, "test"),
        tracking=tracking_of(measured.error[success]),
        torque=use_of(measured.torque[success]),
        speed=use_of(measured.speed[success]) if limited else None,
    )
    return replace(cell, walked=walked, reason=reason)


def prepare_largest(config: Config) -> tuple[Prepared | None, str]:
    """Prepare the commands that are asked for, or the largest part of them that the robot walks.

    If it does not walk sideways, or does not turn, it is tried without these commands.

    Args:
        config: The robot, the gait and the commands that are asked for.

    Returns:
        What was prepared, None if the robot does not walk in the gait; and the reason if this is
        not all that was asked for, else an empty text.
    """
    reason = ""
    for box in boxes_to_try(config.commands):
        try:
            return prepare(replace(config, commands=box)), reason
        except GaitError as error:
            reason = reason or str(error)
            largest = error.largest
        if largest is None:
            continue
        if largest == STILL:
            return None, reason
        try:
            return prepare(replace(config, commands=largest)), reason
        except GaitError as error:
            logger.info(f"nor in that: {error}")
            reason = reason.removesuffix(NEITHER) + NEITHER
    return None, reason


def boxes_to_try(box: CommandBox) -> list[CommandBox]:
    """The box, then the same without vy, without yaw rate, and without both, each once."""
    closed = (0.0, 0.0)
    boxes = [
        box,
        replace(box, vy=closed),
        replace(box, yaw_rate=closed),
        replace(box, vy=closed, yaw_rate=closed),
    ]
    return list(dict.fromkeys(boxes))


def _in_words(cell: GaitCell) -> str:
    """A cell for the log."""
    if cell.walked is None:
        return f"{cell.title}: {cell.reason}"
    robustness = cell.walked.robustness
    return f"{cell.title}: {robustness.successes} of {robustness.episodes}"
