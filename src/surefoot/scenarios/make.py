"""Make a set of initial states: settled gait cycles of the expert, and perturbed neighbors of them.

At each command of a box, the expert walks until its gait has settled. The states at the replanning
instants of the next gait cycle are the nominal initial states; they are perturbed
contact-consistently (paper, III-B) for the other splits. `surefoot.scenarios.prepare` runs both
steps, and keeps the set. Next: `surefoot.scenarios.walking` and `surefoot.scenarios.perturbation`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from surefoot.config import Config, Gait, PerturbationConfig, Split
from surefoot.config.gait_clock import grid_cycle, in_stance
from surefoot.config.robot_table import SOLO12
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import size_of, with_own_values
from surefoot.scenarios.perturbation import perturb
from surefoot.scenarios.starts import SPLITS, Starts, StartSet
from surefoot.scenarios.walking import Walks, expert_walks
from surefoot.types import GRID, Array, IntArray, to_ticks

SEED = 20240711
"""Root seed of the perturbations: any number, but the stored sets depend on it."""
SETTLE = 2.0
"""Minimum time that the expert walks before a gait cycle is recorded [s]."""
SURVIVED = 3.0
"""Minimum time that it has to walk at a command in all [s]."""
SETTLE_PERIODS = 2
"""Minimum number of gait periods that it walks before a gait cycle is recorded."""


@dataclass(frozen=True)
class SplitSize:
    """The size of a split.

    Attributes:
        velocities: The number of commands, spread over the box.
        perturbations: The number of initial states for each command and phase.
    """

    velocities: int
    perturbations: int


SIZES: Mapping[Split, SplitSize] = {
    "nominal": SplitSize(20, 1),
    "train": SplitSize(20, 8),
    "select": SplitSize(10, 2),
    "test": SplitSize(10, 10),
}
"""The sizes of the packaged sets; the states of ``nominal`` are not perturbed."""


@dataclass(frozen=True)
class GaitCycle:
    """States of one settled gait cycle at n commands.

    Attributes:
        q: ``(phases, n, 19)`` configuration [m, unit quaternion, rad].
        v: ``(phases, n, 18)`` velocity [m/s, rad/s].
        tick: ``(phases,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s] and yaw rate [rad/s].
    """

    q: Array
    v: Array
    tick: IntArray
    command: Array


def make_starts(
    name: str,
    config: Config,
    cycles: Mapping[int, GaitCycle],
    perturbation: PerturbationConfig,
    seed: int = SEED,
    sizes: Mapping[Split, SplitSize] = SIZES,
) -> StartSet:
    """Make a set of initial states from settled gait cycles, in seconds.

    Args:
        name: The name of the set.
        config: The robot, the gait and the fall bounds.
        cycles: A settled gait cycle for each number of commands that a split has.
        perturbation: Standard deviations of the perturbations, before their projection, for a robot
            of Solo12's size; `sized` adapts them to another robot.
        seed: Root seed of the perturbations.
        sizes: The size of each split.

    Returns:
        The set; `save_starts` writes it.

    Raises:
        ValueError: A state has no acceptable neighbor: the perturbation is too large.
    """
    robot = load_robot(config.robot)
    config = with_own_values(config, robot)
    perturbation = sized(perturbation, robot)
    grid: dict[str, Starts] = {}
    shape: dict[str, tuple[int, int, int]] = {}
    first_id = 0
    for number, split in enumerate(SPLITS):
        cycle = cycles[sizes[split].velocities]
        repeats = sizes[split].perturbations
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        starts = _nominal(cycle, repeats)
        if split != "nominal":
            starts = _perturbed(starts, config, perturbation, rng, f"{split} states")
        starts.q[:, :2] = 0.0
        grid[split] = replace(starts, id=first_id + np.arange(len(starts)))
        shape[split] = (repeats, len(cycle.q), len(cycle.command))
        first_id += len(starts)
    return StartSet(name, grid, shape, config.gait, robot.name)


def scaled(perturbation: PerturbationConfig, scale: float) -> PerturbationConfig:
    """The perturbation with all its standard deviations multiplied by a factor."""
    linear = perturbation.linear_velocity
    return replace(
        perturbation,
        base_position=scale * perturbation.base_position,
        base_orientation=scale * perturbation.base_orientation,
        joint_position=scale * perturbation.joint_position,
        velocity=scale * perturbation.velocity,
        linear_velocity=None if linear is None else scale * linear,
    )


def sized(perturbation: PerturbationConfig, robot: RobotModel) -> PerturbationConfig:
    """A perturbation made for Solo12, scaled to a robot with legs of another length.

    Lengths scale with the length of the legs, linear velocities with its square root. Angles and
    their rates stay the same, and so does how deep a foot may be in the ground. For Solo12, all
    values stay the same.

    Args:
        perturbation: The perturbation of a robot of Solo12's size.
        robot: The robot.
    """
    if robot.spec == SOLO12:
        return perturbation
    ratio = size_of(robot).length_ratio
    linear = perturbation.linear_velocity
    if linear is None:
        linear = perturbation.velocity
    return replace(
        perturbation,
        base_position=ratio * perturbation.base_position,
        linear_velocity=math.sqrt(ratio) * linear,
    )


def settle(config: Config, command: Array) -> Walks:
    """Let the expert walk at n commands until its gait has settled, and for one more period.

    Args:
        config: The robot, the gait, the expert and the simulator.
        command: ``(n, 3)`` vx, vy [m/s] and yaw rate [rad/s].

    Returns:
        What all robots did, tick by tick, including those that fell.
    """
    instants = cycle_instants(config.gait)
    # If the period is rounded down to the grid, the instants end before the period does.
    cycle_end = max(int(instants[-1]) + GRID, int(instants[0]) + to_ticks(config.gait.period))
    end = max(cycle_end, to_ticks(SURVIVED))
    with tqdm(total=end, desc=f"walking at {len(command)} commands", unit="ms", leave=False) as bar:
        return expert_walks(load_robot(config.robot), config, command, end, 1, bar.update)


def cycle_of(walks: Walks, gait: Gait, robots: IntArray) -> GaitCycle:
    """The states at the replanning instants of a settled gait cycle.

    Args:
        walks: What `settle` returned.
        gait: The gait.
        robots: ``(n,)`` which of the robots, and of their commands.
    """
    instants = cycle_instants(gait)
    cycle = walks.at(instants)
    # The smallest equivalent clock: gait and grid repeat after each `grid_cycle`.
    clock = instants % grid_cycle(gait)
    return GaitCycle(cycle.q[:, robots], cycle.v[:, robots], clock, cycle.command[robots])


def cycle_instants(gait: Gait) -> IntArray:
    """``(phases,)`` the replanning instants of a settled gait cycle [ms].

    The number of phases is that of the grid nodes in a period, rounded. The first instant is at a
    whole number of periods, or at the next node of the grid after it.

    Args:
        gait: The gait.
    """
    period = to_ticks(gait.period)
    whole_periods = max(math.ceil(to_ticks(SETTLE) / period), SETTLE_PERIODS) * period
    begin = math.ceil(whole_periods / GRID) * GRID
    return begin + GRID * np.arange(max(round(period / GRID), 1))


def _nominal(cycle: GaitCycle, repeats: int) -> Starts:
    """The states of a gait cycle, flattened in the order (repeats, phases, commands)."""
    phases, commands, _ = cycle.q.shape
    return Starts(
        np.tile(cycle.q.reshape(-1, 19), (repeats, 1)),
        np.tile(cycle.v.reshape(-1, 18), (repeats, 1)),
        np.tile(np.repeat(cycle.tick, commands), repeats),
        np.tile(cycle.command, (repeats * phases, 1)),
        np.full(repeats * phases * commands, -1),
    )


def _perturbed(
    starts: Starts,
    config: Config,
    perturbation: PerturbationConfig,
    rng: np.random.Generator,
    title: str,
) -> Starts:
    """A random neighbor of each of the initial states, drawn in their order."""
    robot = load_robot(config.robot)
    q = np.empty_like(starts.q)
    v = np.empty_like(starts.v)
    for row in tqdm(range(len(starts)), desc=title, leave=False):
        stance = in_stance(config.gait, int(starts.tick[row]))
        q[row], v[row] = perturb(
            robot, starts.q[row], starts.v[row], stance, perturbation, config.safety, rng
        )
    return replace(starts, q=q, v=v)
