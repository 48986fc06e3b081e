"""Prepare a robot, a gait and a box of commands: make everything that a run with them needs, once.

The order is: the command gains (`gains`), the settled gait at commands all over the box, the safety
bounds that it stays within, and initial states in four splits (`make`). All of it is one file, kept
below the user's caches under a SHA-256 of what it depends on (`keys`), and written whole or not at
all. It takes up to two minutes; an interrupted preparation begins again, but keeps the gains that
it has measured. A run keeps a copy. Commands, runs and studies call `completed`.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surefoot.caches import user_folder
from surefoot.config import Config, Gait, PerturbationConfig, SafetyConfig, Split
from surefoot.config.checked import known
from surefoot.config.expert_rules import with_ground, with_rules
from surefoot.config.gait_table import gait_name
from surefoot.mpc.gaits import only_gait
from surefoot.mpc.schedule import stands
from surefoot.robots.identity import description_hash
from surefoot.robots.joint_bounds import with_ranges
from surefoot.robots.limits_used import range_remark, speed_remark, speed_shares
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import filled, own_safety, with_own_values
from surefoot.robots.several_gaits import for_each_gait
from surefoot.scenarios.boxes import box_in_words, largest_box, walks_enough
from surefoot.scenarios.gains import NO_GAIN, ZERO, check_goes, measured_gain, with_measured_gain
from surefoot.scenarios.keys import ingredients_of, key_of
from surefoot.scenarios.make import (
    SEED,
    SIZES,
    SURVIVED,
    GaitCycle,
    SplitSize,
    cycle_instants,
    cycle_of,
    make_starts,
    settle,
)
from surefoot.scenarios.preparation import CommandGain, Followed, Preparation, Triple, rounded
from surefoot.scenarios.settled_bounds import settled_bounds
from surefoot.scenarios.starts import StartSet, load_starts, save_starts
from surefoot.scenarios.walking import GaitError, Walks
from surefoot.types import Array, BoolArray, IntArray, to_ticks

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Prepared:
    """What a robot, a gait and a box of commands need.

    Attributes:
        starts: The initial states.
        made: The command gains, the bounds, and everything else that was measured.
        path: The file with all of this.
        kept: Whether the file existed already.
    """

    starts: StartSet
    made: Preparation
    path: Path
    kept: bool


def prepare(
    config: Config,
    perturbation: PerturbationConfig | None = None,
    seed: int = SEED,
    sizes: Mapping[Split, SplitSize] = SIZES,
) -> Prepared:
    """Make what a robot, a gait and a box of commands need, or find what was made before.

    Args:
        config: The robot, the gait, the commands, the expert and the simulator. Gains that are not
            None are kept.
        perturbation: Standard deviations of the perturbed initial states, for a robot of Solo12's
            size; None takes the paper's.
        seed: Root of the perturbations' randomness.
        sizes: The size of each split.

    Raises:
        GaitError: The robot does not walk in this gait, or not at the commands of the box; the
            message has the numbers, and the largest box that it walks.
        WriteError: The file cannot be written.
    """
    perturbation = perturbation or PerturbationConfig()
    robot = load_robot(config.robot)
    config = with_own_values(only_gait(config, "a preparation"), robot)
    key = prepared_key(config, perturbation, seed, sizes)
    path = Path(user_folder("prepared")) / f"{key}.npz"
    found = _find(path, key)
    if found is not None:
        return found
    began = time.perf_counter()
    logger.info(
        f"{robot.name}, {gait_name(config.gait)}, {box_in_words(config.commands)}: made once, in "
        f"less than two minutes, and kept in {path}"
    )
    counts = {size.velocities for size in sizes.values()}
    spread = {count: config.commands.spread(count) for count in sorted(counts)}
    commands, first = np.unique(np.concatenate(list(spread.values())), axis=0, return_index=True)
    commands = commands[np.argsort(first)]
    gain = _gain_of(robot, config, commands)
    config = _with_gain(config, gain.gain)
    walks = settle(config, commands)
    up = ~walks.lost(config.safety)
    if not walks_enough(up):
        raise _refusal(robot, config, commands, up)
    settled = walks.since(int(cycle_instants(config.gait)[0]))
    cycles = {count: _cycle(settled, up, config, each) for count, each in spread.items()}
    starts = make_starts(key[:8], config, cycles, perturbation, seed, sizes)
    made = Preparation(
        key=key,
        description=description_hash(robot.spec),
        commands=config.commands,
        gain=gain,
        safety=settled_bounds(robot, _own_bounds(robot, config), settled.of(up)),
        followed=_followed(settled, up, config.gait),
        seconds=round(time.perf_counter() - began, 1),
    )
    _warn_of_walks(robot, config, made, settled.of(up))
    # Another process may have made the same file meanwhile, and may be reading it now.
    found = _find(path, key)
    if found is not None:
        return found
    save_starts(replace(starts, preparation=made), path, overwrite=True)
    return Prepared(load_starts(path), made, path, kept=False)


def _warn_of_walks(robot: RobotModel, config: Config, made: Preparation, settled: Walks) -> None:
    """Warn of robots that stay up, but not on their commands or not within their joints' limits."""
    name = f"{robot.name}, {gait_name(config.gait)}"
    astray = made.astray
    if astray:
        worst = max(astray, key=lambda each: np.abs(np.subtract(each.velocity, each.command)).max())
        told = ", ".join(f"{x:.2f}" for x in worst.command)
        reached = ", ".join(f"{x:.2f}" for x in worst.velocity)
        logger.warning(
            f"{name}: at {len(astray)} of {len(made.followed)} commands the robot does not walk as "
            f"it is told; at (vx, vy, yaw rate) {told} it reaches {reached}. Use a smaller box of "
            "commands"
        )
    fastest = speed_shares(robot, settled.v).max(axis=(0, 2))
    if (fastest > 1.0).any():
        worst = int(fastest.argmax())
        told = ", ".join(f"{x:.2f}" for x in settled.command[worst])
        logger.warning(
            f"{name}: at {(fastest > 1.0).sum()} of {len(fastest)} commands a joint is faster than "
            f"its motor; at (vx, vy, yaw rate) {told} {speed_remark(robot, settled.v[:, worst])}. "
            "Use a smaller box of commands, or another gait"
        )
    beyond = range_remark(robot, settled.q)
    if beyond:
        logger.warning(f"{name}: in the settled gait, {beyond}")


def prepared_key(
    config: Config, perturbation: PerturbationConfig, seed: int, sizes: Mapping[Split, SplitSize]
) -> str:
    """SHA-256 of everything that a preparation depends on; the arguments are those of `prepare`.

    Args:
        config: The configuration, with the robot's own values in place of None.
        perturbation: Standard deviations of the perturbed initial states.
        seed: Root of the perturbations' randomness.
        sizes: The size of each split.
    """
    return key_of(ingredients_of(config), config.commands, perturbation, seed, sizes)


def _find(path: Path, key: str) -> Prepared | None:
    """What was prepared before under a key; None if there is nothing, or it cannot be read."""
    if not path.exists():
        return None
    try:
        starts = load_starts(path)
    except (OSError, ValueError) as error:
        logger.warning(f"{path} is made again: it cannot be read ({error})")
        return None
    if starts.preparation is None or starts.preparation.key != key:
        logger.warning(f"{path} is made again: it holds something else than its name says")
        return None
    return Prepared(starts, starts.preparation, path, kept=True)


def _gain_of(robot: RobotModel, config: Config, commands: Array) -> CommandGain:
    """The command gains: those that are given, or those that are measured.

    Raises:
        GaitError: None can be measured; if that is because robots fall, it gives the largest box.
    """
    given = config.expert.command_gain
    if given is not None:
        return CommandGain(given, ZERO, ZERO, ZERO)
    try:
        return measured_gain(robot, config)
    except GaitError as error:
        config = _with_gain(config, NO_GAIN)
        up = ~settle(config, commands).lost(config.safety)
        if walks_enough(up):
            raise
        raise _refusal(robot, config, commands, up) from error


def _with_gain(config: Config, gain: Triple) -> Config:
    """The configuration with other command gains."""
    return replace(config, expert=replace(config.expert, command_gain=gain))


def _refusal(robot: RobotModel, config: Config, commands: Array, up: BoolArray) -> GaitError:
    """Why a box cannot be prepared, and which one can."""
    name = gait_name(config.gait)
    fell = "; ".join(", ".join(f"{x:.3g}" for x in command) for command in commands[~up][:4])
    text = (
        f"the gait {name} does not walk {robot.name} at these commands: of {len(up)} that are "
        f"spread over {box_in_words(config.commands)}, it survives {up.sum()} for {SURVIVED:g} s, "
        f"and falls at (vx, vy, yaw rate) {fell}{'; ...' if (~up).sum() > 4 else ''}"
    )
    logger.info("%s; looking for the largest box that it walks", text)
    box = largest_box(robot, config)
    if box is None:
        return GaitError(f"{text}. It falls on the spot, too: use another gait")
    return GaitError(f"{text}. The largest box that works: {box_in_words(box)}", box)


def _own_bounds(robot: RobotModel, config: Config) -> SafetyConfig:
    """The robot's own bounds in a gait, with the falls that are configured."""
    height = known(config.gait.com_height, "gait.com_height")
    return own_safety(SafetyConfig(fall_height=config.safety.fall_height), height, robot)


def _followed(settled: Walks, up: BoolArray, gait: Gait) -> tuple[Followed, ...]:
    """How the expert followed each command, over whole gait periods.

    Args:
        settled: The settled part of the walks.
        up: ``(n,)`` True for robots that have not fallen.
        gait: The gait; if it stands, every command counts as zero.
    """
    told = np.zeros_like(settled.command) if stands(gait) else settled.command
    # Whole periods, so that a gait's sway cancels.
    period = to_ticks(gait.period)
    ticks = len(settled.tick) // period * period
    last = settled.since(int(settled.tick[-1]) + 1 - ticks)
    rows = zip(told, last.mean_velocity, up, strict=True)
    return tuple(
        Followed(rounded(command), rounded(velocity) if stays else ZERO, not stays)
        for command, velocity, stays in rows
    )


def _cycle(settled: Walks, up: BoolArray, config: Config, commands: Array) -> GaitCycle:
    """The settled cycle at some commands; where a robot fell, that of the nearest other command.

    Args:
        settled: The settled part of the walks.
        up: ``(n,)`` True for robots that have not fallen.
        config: The gait and the box.
        commands: ``(m, 3)`` the commands.
    """
    width = np.ptp(config.commands.axes, axis=1)
    away = (commands[:, None] - settled.command) / np.where(width > 0.0, width, 1.0)
    distance = np.where(up, np.linalg.norm(away, axis=2), np.inf)
    nearest: IntArray = distance.argmin(axis=1)
    return cycle_of(settled, config.gait, nearest)


def completed(config: Config) -> Config:
    """The configuration with all values that its robot, gaits and commands need in place of None.

    Values that follow from the robot are filled in (`with_own_values`). Those that have to be
    measured, the command gains and the initial states, are prepared unless they are packaged, given
    or kept from before. Where there is a terrain, the ground to plan on is filled in, too. Values
    that are given stay.

    Args:
        config: The configuration.

    Raises:
        ValueError: The robot does not walk in a gait, or not at the commands of the box.
    """
    check_goes(config)
    return for_each_gait(lambda one: with_ground(_completed(one)), config)


def _completed(config: Config) -> Config:
    """The same as `completed`, for a configuration of one gait."""
    own = with_own_values(config)
    if own.start_set is None:
        prepared = prepare(config)
        return with_preparation(replace(config, start_set=str(prepared.path)), prepared.made)
    if config.start_set is None:
        return own
    made = load_starts(config.start_set).preparation
    if made is not None:
        return with_preparation(config, made)
    return with_measured_gain(own)  # None in a set of an earlier version


def with_preparation(config: Config, made: Preparation) -> Config:
    """The configuration, with measured gains and bounds and their rules in place of None.

    Args:
        config: The configuration; values that are given stay, with a warning if gains or commands
            differ from the measured ones.
        made: What was measured.
    """
    if config.commands != made.commands:
        logger.warning(
            f"the initial states were made for {box_in_words(made.commands)}, but the commands are "
            f"{box_in_words(config.commands)}: give the same, or prepare these"
        )
    # The gains are only valid with the rules that they were measured with.
    config = with_rules(config, made.commands)
    given = config.expert.command_gain
    if given is not None and not np.allclose(given, made.command_gain, atol=1e-6):
        logger.warning(
            f"expert.command_gain is {given}, but the initial states were made with "
            f"{made.command_gain}: robots do not begin in the settled gait of this expert"
        )
    measured = made.safety
    expert = filled(config.expert, command_gain=made.command_gain)
    safety = filled(
        config.safety,
        com_height=measured.com_height,
        roll_pitch=measured.roll_pitch,
        settled=measured.settled,
    )
    if not safety.joints and measured.joints:
        rows = with_ranges(measured.joints, safety, load_robot(config.robot))
        safety = replace(safety, joints=rows)
    return with_own_values(replace(config, expert=expert, safety=safety))
