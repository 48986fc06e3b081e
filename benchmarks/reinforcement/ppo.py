"""Train Stable-Baselines3's PPO on the lockstep environment, and measure what it reaches.

``python benchmarks/reinforcement/ppo.py --minutes 60 --out FOLDER`` trains for so long of one
core's time, and appends a line of JSON to FOLDER/progress.jsonl every few minutes: robot-hours,
survivors over 10 s of 100 draws from the `test` initial states, and the error of the mean velocity.
The same evaluation of the expert at the environment's rate is the last line. Needs the extra
``gym``, and Stable-Baselines3.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

import surefoot as sf
from surefoot.interop.gym.stable_baselines import LockstepVecEnv

ROBOTS = 32
RATE = 50
EPISODES = 100
"""Initial states of an evaluation."""
Actions = Callable[[NDArray[np.float32], dict], NDArray[np.float32]]


@dataclass(frozen=True)
class Reached:
    """What a controller does from initial states of the split `test`, 10 s each.

    Attributes:
        who: The controller.
        robot_hours: What it was trained on [h].
        minutes: The processor time of its training, measurements included [min].
        survivors: How many of the episodes did not end with a fall.
        episodes: The number of episodes.
        mean_survival: The mean time without a fall [s].
        vx_error: The mean |mean vx - command| of the survivors after the first second [m/s].
        vx_mean: The mean vx of the survivors after the first second [m/s].
        command_mean: The mean commanded vx of the survivors [m/s].
    """

    who: str
    robot_hours: float
    minutes: float
    survivors: int
    episodes: int
    mean_survival: float
    vx_error: float
    vx_mean: float
    command_mean: float


def measure(act: Actions, who: str, robot_hours: float, minutes: float, expert: bool) -> Reached:
    """Let a controller drive from initial states of `test`: the same draws for every controller."""
    env = gym.make_vec(
        "surefoot/Solo12-v0",
        num_envs=EPISODES,
        begin="test",
        rate=RATE,
        expert=expert,
        autoreset_mode="Disabled",
    )
    seen, infos = env.reset(seed=0)
    alive = np.ones(EPISODES, bool)
    survival = np.zeros(EPISODES)
    speed = np.zeros(EPISODES)
    command = seen[:, 44].copy()
    for step in range(10 * RATE):
        seen, _, fell, _, infos = env.step(act(seen, infos))
        alive &= ~fell
        survival += alive / RATE
        if step >= RATE:
            speed += infos["velocity"][:, 0] / (9 * RATE)
    error = np.abs(speed - command)[alive]
    return Reached(
        who=who,
        robot_hours=robot_hours,
        minutes=minutes,
        survivors=int(alive.sum()),
        episodes=EPISODES,
        mean_survival=float(survival.mean()),
        vx_error=float(error.mean()) if alive.any() else float("nan"),
        vx_mean=float(speed[alive].mean()) if alive.any() else float("nan"),
        command_mean=float(command[alive].mean()) if alive.any() else float("nan"),
    )


class Clock(BaseCallback):
    """Ends the training after a time, and measures the policy at equal intervals.

    Args:
        minutes: How long to train, of processor time [min].
        every: The processor time between measurements [min].
        write: What takes the measurements.
    """

    def __init__(self, minutes: float, every: float, write: Callable[[Reached], None]) -> None:
        super().__init__()
        self._minutes = minutes
        self._every = every
        self._write = write
        self._began = time.process_time()
        self._next = every

    def _on_step(self) -> bool:
        """Whether to go on."""
        passed = (time.process_time() - self._began) / 60.0
        if passed >= self._next or passed >= self._minutes:
            self._next += self._every
            self._write(measured(self.model, passed))
        return passed < self._minutes


def measured(model: BaseAlgorithm, minutes: float) -> Reached:
    """What a model reaches, without exploration."""
    normalize = model.get_vec_normalize_env()
    assert normalize is not None

    def act(seen: NDArray[np.float32], _infos: dict) -> NDArray[np.float32]:
        return model.predict(normalize.normalize_obs(seen), deterministic=True)[0]

    return measure(act, "ppo", model.num_timesteps / RATE / 3600.0, minutes, expert=False)


def train(minutes: float, every: float, out: Path, begin: str, seed: int) -> None:
    """Train, and append what is reached to a file."""
    torch.set_num_threads(1)
    sf.register_environments()
    out.mkdir(parents=True, exist_ok=True)
    progress = out / "progress.jsonl"

    def write(reached: Reached) -> None:
        with progress.open("a") as file:
            file.write(json.dumps({"seed": seed, **asdict(reached)}) + "\n")

    robots = LockstepVecEnv(ROBOTS, begin=begin, rate=RATE, duration=5.0)
    model = PPO(
        "MlpPolicy",
        VecNormalize(robots),
        n_steps=96,
        batch_size=768,
        n_epochs=5,
        learning_rate=5e-4,
        gamma=0.98,
        target_kl=0.03,
        policy_kwargs={"net_arch": [128, 128], "log_std_init": -2.0},
        seed=seed,
        device="cpu",
    )
    model.learn(10**9, callback=Clock(minutes, every, write))
    model.save(out / "ppo.zip")
    normalize = model.get_vec_normalize_env()
    assert normalize is not None
    normalize.save(str(out / "normalize.pkl"))
    write(measure(lambda _seen, infos: infos["expert_action"], "expert", 0.0, 0.0, expert=True))


def main() -> None:
    """Read the options, and train."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--every", type=float, default=5.0)
    parser.add_argument("--out", type=Path, default=Path("runs/ppo"))
    parser.add_argument("--begin", default="train")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    train(options.minutes, options.every, options.out, options.begin, options.seed)


if __name__ == "__main__":
    main()
