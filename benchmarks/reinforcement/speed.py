"""Speed of the vector environment beside Gymnasium's SyncVectorEnv of single environments.

Both step the same robots with the same actions, in turn, in one process; the figures are medians of
processor time. ``python benchmarks/reinforcement/speed.py`` prints a line for each size.
"""

from __future__ import annotations

import time

import gymnasium as gym
import numpy as np

import surefoot as sf

REPEATS = 9
DECISIONS = 10
RATE = 50


def seconds(env: gym.vector.VectorEnv, action: np.ndarray) -> float:
    """Processor time of some decisions [s]."""
    began = time.thread_time()
    for _ in range(DECISIONS):
        env.step(action)
    return time.thread_time() - began


def main() -> None:
    """Measure 1, 8, 32 and 100 robots."""
    sf.register_environments()
    for robots in (1, 8, 32, 100):
        batched = gym.make_vec("surefoot/Solo12-v0", num_envs=robots, rate=RATE)
        single = gym.make_vec(
            "surefoot/Solo12-v0", num_envs=robots, rate=RATE, vectorization_mode="sync"
        )
        action = np.zeros((robots, 12), np.float32)
        times = {"batched": [], "single": []}
        for env in (batched, single):
            env.reset(seed=0)
            env.step(action)
        for _ in range(REPEATS):
            times["batched"].append(seconds(batched, action))
            times["single"].append(seconds(single, action))
        one = float(np.median(times["batched"]))
        other = float(np.median(times["single"]))
        robot_ms = robots * DECISIONS * 1000 / RATE
        print(
            f"{robots:>4} robots: {robot_ms / one:>8.0f} robot-ms/s in lockstep, "
            f"{robot_ms / other:>8.0f} singly, {other / one:.2f} times",
            flush=True,
        )


if __name__ == "__main__":
    main()
