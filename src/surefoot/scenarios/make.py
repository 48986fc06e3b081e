"""Make a set of initial states: settled gait cycles of the expert, and perturbed neighbors of them.

At each velocity the expert walks until its gait has settled. The states at the replanning instants
of the next gait cycle are the nominal initial states; they are perturbed contact-consistently
(paper, III-B) for the other splits. A set is made once, with the command ``surefoot make-starts``,
and never changed. Next: `surefoot.scenarios.perturbation` and `surefoot.scenarios.starts`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from surefoot.config import Config, PerturbationConfig, Split
from surefoot.mpc.expert import make_expert
from surefoot.mpc.schedule import in_stance
from surefoot.robots.load import load_robot
from surefoot.robots.model import clip_torque, standing
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios.perturbation import perturb
from surefoot.scenarios.starts import SPLITS, Starts, StartSet
from surefoot.sim import make_simulator
from surefoot.types import GRID, Array, to_ticks

SEED = 20240711
"""Root of the perturbations' randomness: any number, but the stored sets depend on it."""
SETTLE = 2.0
"""How long the expert walks before a gait cycle is recorded, in whole gait periods [s]."""
TOP_SPEED = 0.3
"""The largest forward speed [m/s]."""


@dataclass(frozen=True)
class SplitSize:
    """How large a split is.

    Attributes:
        velocities: The number of equally spaced forward speeds from 0 to the top speed.
        perturbations: The number of initial states for each velocity and phase.
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
    """States of one settled gait cycle at n forward speeds.

    Attributes:
        q: ``(phases, n, 19)`` configuration [m, unit quaternion, rad].
        v: ``(phases, n, 18)`` velocity [m/s, rad/s].
        speed: ``(n,)`` the forward speeds that are commanded [m/s].
    """

    q: Array
    v: Array
    speed: Array


def make_starts(
    name: str,
    config: Config,
    perturbation: PerturbationConfig,
    seed: int = SEED,
    sizes: Mapping[Split, SplitSize] = SIZES,
) -> StartSet:
    """Make a set of initial states, in minutes.

    Args:
        name: The name of the set.
        config: The robot, the gait, the expert, the simulator and the fall bounds.
        perturbation: Standard deviations of the perturbations, before their projection.
        seed: Root of the perturbations' randomness.
        sizes: The size of each split.

    Returns:
        The set; `save_starts` writes it.

    Raises:
        ValueError: A state has no acceptable neighbor: the perturbation is too large.
    """
    config = with_own_values(config)
    counts = sorted({size.velocities for size in sizes.values()})
    cycles = {count: settled_cycle(config, np.linspace(0, TOP_SPEED, count)) for count in counts}
    grid: dict[str, Starts] = {}
    shape: dict[str, tuple[int, int, int]] = {}
    first_id = 0
    for number, split in enumerate(SPLITS):
        cycle = cycles[sizes[split].velocities]
        repeats = sizes[split].perturbations
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        if split == "nominal":
            starts = _nominal(cycle, repeats)
        else:
            starts = _perturbed(_nominal(cycle, repeats), config, perturbation, rng)
        starts.q[:, :2] = 0.0
        grid[split] = replace(starts, id=first_id + np.arange(len(starts)))
        shape[split] = (repeats, len(cycle.q), len(cycle.speed))
        first_id += len(starts)
    return StartSet(name, grid, shape)


def scaled(perturbation: PerturbationConfig, scale: float) -> PerturbationConfig:
    """The perturbation with all its standard deviations multiplied by a factor."""
    return replace(
        perturbation,
        base_position=scale * perturbation.base_position,
        base_orientation=scale * perturbation.base_orientation,
        joint_position=scale * perturbation.joint_position,
        velocity=scale * perturbation.velocity,
    )


def settled_cycle(config: Config, speed: Array) -> GaitCycle:
    """Let the expert walk at n forward speeds until its gait has settled, and for one more cycle.

    Args:
        config: The robot, the gait, the expert and the simulator.
        speed: ``(n,)`` forward speeds to command [m/s].

    Returns:
        The states at the replanning instants of the last cycle.
    """
    robot = load_robot(config.robot)
    n = len(speed)
    simulator = make_simulator(robot, n, config.simulation)
    expert = make_expert(robot, config)
    expert.reset(n)
    simulator.reset(np.tile(standing(robot), (n, 1)), np.zeros((n, 18)))
    command = np.zeros((n, 3))
    command[:, 0] = speed
    q = []
    v = []
    begin = to_ticks(SETTLE)
    end = begin + to_ticks(config.gait.period)
    for tick in tqdm(range(end), desc=f"{n} speeds", unit="ms"):
        state = simulator.state
        if tick >= begin and tick % GRID == 0:
            q.append(state.q)
            v.append(state.v)
        torque = expert.torque(state, np.full(n, tick), command, np.ones(n, bool))
        simulator.step(clip_torque(torque, robot.torque_limit))
    return GaitCycle(np.array(q), np.array(v), speed)


def _nominal(cycle: GaitCycle, repeats: int) -> Starts:
    """The states of a gait cycle, repeated: (repeats, phases, speeds), flattened in this order."""
    phases, speeds, _ = cycle.q.shape
    tick = np.repeat(GRID * np.arange(phases), speeds)
    command = np.zeros((phases * speeds, 3))
    command[:, 0] = np.tile(cycle.speed, phases)
    return Starts(
        np.tile(cycle.q.reshape(-1, 19), (repeats, 1)),
        np.tile(cycle.v.reshape(-1, 18), (repeats, 1)),
        np.tile(tick, repeats),
        np.tile(command, (repeats, 1)),
        np.full(repeats * phases * speeds, -1),
    )


def _perturbed(
    starts: Starts, config: Config, perturbation: PerturbationConfig, rng: np.random.Generator
) -> Starts:
    """A random neighbor of each of the initial states, drawn in their order."""
    robot = load_robot(config.robot)
    q = np.empty_like(starts.q)
    v = np.empty_like(starts.v)
    for row in tqdm(range(len(starts)), desc="perturbed states"):
        stance = in_stance(config.gait, int(starts.tick[row]))
        q[row], v[row] = perturb(
            robot, starts.q[row], starts.v[row], stance, perturbation, config.safety, rng
        )
    return replace(starts, q=q, v=v)
