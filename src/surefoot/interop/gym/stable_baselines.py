"""The vector environment in the form that Stable-Baselines3 expects: `LockstepVecEnv`.

Stable-Baselines3 would make a process or a simulator for each robot; here its algorithms get one
batch in lockstep. Read `env` first; `examples/train_ppo.py` trains PPO on `LockstepVecEnv`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from surefoot.interop.gym.env import Info, WalkingVectorEnv
from surefoot.learning.observation import Float32Array

INFOS = ("velocity", "expert_action")
"""The keys of the infos of `WalkingEnv`, and so of each robot here."""


class LockstepVecEnv(VecEnv):
    """Robots in lockstep, for the algorithms of Stable-Baselines3.

    The infos of a robot are those of `WalkingEnv`: its mean velocity, and the expert's action with
    ``expert=True``. When an episode is over, they are the last ones of that episode, and
    ``reset_infos`` has the first ones of the next.

    Args:
        num_envs: The number of robots.
        robot: See `WalkingEnv`.
        options: The options of `WalkingEnv`.
    """

    def __init__(self, num_envs: int, robot: str | None = None, **options: Any) -> None:
        self.robots = WalkingVectorEnv(
            num_envs, robot, autoreset_mode=AutoresetMode.SAME_STEP, **options
        )
        self.render_mode = None
        super().__init__(
            num_envs, self.robots.single_observation_space, self.robots.single_action_space
        )
        self._actions = np.zeros((num_envs, 12), np.float32)
        self._next_seed: int | None = None

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Seed the next reset, and everything after it: robot i gets ``seed + i``."""
        self._next_seed = seed
        return [None if seed is None else seed + n for n in range(self.num_envs)]

    def reset(self) -> Float32Array:
        """Begin an episode of every robot."""
        observation, infos = self.robots.reset(seed=self._next_seed)
        self._next_seed = None
        self.reset_infos = [_infos_of(infos, row) for row in range(self.num_envs)]
        return observation

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, ...]:
        """Carry out one decision; robots whose episodes end begin new ones immediately."""
        seen, reward, terminated, truncated, infos = self.robots.step(self._actions)
        each = [_infos_of(infos, row) for row in range(self.num_envs)]
        done = terminated | truncated
        for row in np.flatnonzero(done).tolist():
            self.reset_infos[row] = each[row]
            each[row] = _infos_of(infos["final_info"], row)
            each[row]["terminal_observation"] = infos["final_obs"][row]
            each[row]["TimeLimit.truncated"] = bool(truncated[row])
        return seen, reward.astype(np.float32), done, each

    def close(self) -> None:
        """There is nothing to close."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same attribute, once for each of these robots."""
        return [getattr(self.robots, attr_name)] * len(self._rows(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: the robots share everything.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("robots in lockstep share their attributes; make another one")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Refuse: there is no environment of a single robot.

        Raises:
            NotImplementedError: Always.
        """
        raise NotImplementedError("robots in lockstep have no methods of their own")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """False for each of these robots."""
        return [False] * len(self._rows(indices))

    def _rows(self, indices: Any) -> Sequence[int]:
        """The rows of some robots; None for all of them."""
        return list(self._get_indices(indices))


def _infos_of(infos: Info, row: int) -> Info:
    """The infos of one robot, from those of the vector environment."""
    return {name: infos[name][row].copy() for name in INFOS if name in infos}
