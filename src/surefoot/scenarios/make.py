"""Write the stored set of starts: settled gait cycles of the expert, and perturbed neighbours.

Each velocity's expert walks until its gait has settled; the states at the ten replanning instants
of the next gait cycle are the nominal starts, and are perturbed contact-consistently, with the
paper's standard deviations times SCALE. Run once per set; a set is never overwritten. Usage:
python scripts/make_starts.py OUT.npz [SCALE]
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from surefoot.config import Config, PerturbationConfig
from surefoot.mpc.expert import make_expert
from surefoot.mpc.schedule import in_stance
from surefoot.robots.model import clip_torque, standing
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.perturbation import perturb
from surefoot.scenarios.starts import SPLITS, Starts, StartSet, save_starts
from surefoot.sim import make_simulator
from surefoot.types import GRID, Array, to_ticks

SEED = 20240711  # any number; the stored set depends on it
SETTLE = 2.0  # [s] whole gait periods
VELOCITIES = {"nominal": 20, "train": 20, "select": 10, "test": 10}
PERTURBATIONS = {"nominal": 1, "train": 8, "select": 2, "test": 10}
TOP_SPEED = 0.3  # [m/s]


def settled_cycle(config: Config, velocity: Array) -> tuple[Array, Array]:
    """States ``(phases, n, 19)``, ``(phases, n, 18)`` of one gait cycle at n forward speeds."""
    robot = solo12(config.robot)
    n = len(velocity)
    simulator = make_simulator(robot, n, config.simulation)
    expert = make_expert(robot, config)
    expert.reset(n)
    simulator.reset(np.tile(standing(robot), (n, 1)), np.zeros((n, 18)))
    command = np.zeros((n, 3))
    command[:, 0] = velocity
    q, v = [], []
    end = to_ticks(SETTLE) + to_ticks(config.gait.period)
    for tick in tqdm(range(end), desc=f"{n} speeds", unit="ms"):
        state = simulator.state
        if tick >= to_ticks(SETTLE) and tick % GRID == 0:
            q.append(state.q)
            v.append(state.v)
        torque = expert.torque(state, np.full(n, tick), command, np.ones(n, bool))
        simulator.step(clip_torque(torque, robot.torque_limit))
    return np.array(q), np.array(v)


def main(path: Path, scale: float) -> None:
    """Make all splits and write them."""
    config, paper = Config(), PerturbationConfig()
    sigmas = ("base_position", "base_orientation", "joint_position", "velocity")
    perturbation = replace(paper, **{name: scale * getattr(paper, name) for name in sigmas})
    robot = solo12(config.robot)
    phases = to_ticks(config.gait.period) // GRID
    cycles = {n: settled_cycle(config, np.linspace(0, TOP_SPEED, n)) for n in (10, 20)}
    grid, shape, first_id = {}, {}, 0
    for number, split in enumerate(SPLITS):
        speeds, repeats = VELOCITIES[split], PERTURBATIONS[split]
        rng = np.random.default_rng(np.random.SeedSequence(SEED, spawn_key=(number,)))
        rows = []
        for _ in tqdm(range(repeats), desc=split):
            for phase in range(phases):
                for speed in range(speeds):
                    q, v = (part[phase, speed] for part in cycles[speeds])
                    if split != "nominal":
                        stance = in_stance(config.gait, phase * GRID)
                        q, v = perturb(robot, q, v, stance, perturbation, config.safety, rng)
                    rows.append((q, v, phase * GRID, np.linspace(0, TOP_SPEED, speeds)[speed]))
        q, v, tick, vx = (np.array(column) for column in zip(*rows, strict=True))
        q[:, :2] = 0.0
        command = np.stack([vx, 0 * vx, 0 * vx], axis=1)
        ids = first_id + np.arange(len(q))
        grid[split] = Starts(q, v, tick, command, ids)
        shape[split] = (repeats, phases, speeds)
        first_id += len(q)
    starts = StartSet(path.stem, grid, shape)
    save_starts(starts, path)
    print(f"{path}: {first_id} starts, hash {starts.hash}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 1.0)
