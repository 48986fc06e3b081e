"""Gymnasium environments: `WalkingEnv` is one robot, `WalkingVectorEnv` many in lockstep.

The observation is what a policy of this package sees (47 numbers, `learning.observation`); the
action is twelve joint targets, as fractions of ``action_range`` [rad] from the nominal pose; `task`
defines the reward and the end of an episode. Robot i of a vector environment seeded with s equals
a single environment seeded with s + i. Read `ids` for the names of the environments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from surefoot.config import Config
from surefoot.config.json_io import Plain, from_json
from surefoot.errors import unknown
from surefoot.interop.gym.task import (
    MOST_SEEN,
    Decided,
    Walkers,
    WalkingTask,
    walking_config,
)
from surefoot.learning.observation import INPUT_SIZE, Float32Array
from surefoot.types import Array, BoolArray

Info = dict[str, Any]
"""What Gymnasium calls info: anything by name."""


def _observation_space() -> gymnasium.spaces.Box:
    """The observations of one robot."""
    return gymnasium.spaces.Box(-MOST_SEEN, MOST_SEEN, (INPUT_SIZE,), np.float32)


def _action_space() -> gymnasium.spaces.Box:
    """The actions of one robot."""
    return gymnasium.spaces.Box(-1.0, 1.0, (12,), np.float32)


def _walkers(
    robot: str | None, config: Config | Mapping[str, Plain] | None, task: WalkingTask, batch: int
) -> Walkers:
    """The robots of an environment.

    Raises:
        ValueError: There is no such robot, or the configuration is for another one.
    """
    if config is not None and not isinstance(config, Config):
        config = from_json(Config, config)
    return Walkers(walking_config(robot, config), task, batch)


def _task(**options: Any) -> WalkingTask:
    """The task that options describe.

    Raises:
        ValueError: An option is unknown or out of range.
    """
    names = [field.name for field in fields(WalkingTask)]
    for name in options:
        if name not in names:
            raise ValueError(
                unknown("option of the environment", name, ("robot", "config", *names))
            )
    return WalkingTask(**options)


class WalkingEnv(gymnasium.Env[Float32Array, Float32Array]):
    """One robot that follows a velocity command.

    Args:
        robot: The name of a robot of the package, or a file with a `RobotSpec`; None for the robot
            of the configuration, or Solo12 if that is None too.
        config: Robot, gait, commands, simulator, gains and bounds, or the same as JSON holds them;
            None for the default configuration of ``robot``.
        render_mode: Always None; `surefoot play` and `surefoot walk` draw robots.
        options: The fields of `WalkingTask`: rate, duration, begin, expert and the rest.

    Attributes:
        walkers: The robot, as a batch of one.

    Raises:
        ValueError: An option is unknown or out of range, there is no such robot, or the
            configuration is for another one.
    """

    metadata: Info = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        robot: str | None = None,
        config: Config | Mapping[str, Plain] | None = None,
        render_mode: None = None,
        **options: Any,
    ) -> None:
        self.walkers = _walkers(robot, config, _task(**options), 1)
        self.render_mode = render_mode
        self.observation_space: gymnasium.Space = _observation_space()
        self.action_space: gymnasium.Space = _action_space()
        self._everyone = np.ones(1, bool)

    def reset(
        self, *, seed: int | None = None, options: Info | None = None
    ) -> tuple[Float32Array, Info]:
        """Begin an episode; ``options`` are not used.

        Args:
            seed: Fixes this episode and all that follow.
            options: Not used.
        """
        super().reset(seed=seed)
        self.walkers.begin(self._everyone, [self.np_random])
        return self.walkers.observation[0], self._info(np.zeros(3))

    def step(self, action: Float32Array) -> tuple[Float32Array, float, bool, bool, Info]:
        """Carry out one decision; see `task` for the reward and the end of an episode.

        Args:
            action: ``(12,)`` targets as fractions of ``action_range`` from the nominal pose.
        """
        decided = self.walkers.decide(np.asarray(action)[None], self._everyone)
        return (
            self.walkers.observation[0],
            float(decided.reward[0]),
            bool(decided.terminated[0]),
            bool(decided.truncated[0]),
            self._info(decided.velocity[0]),
        )

    def _info(self, velocity: Array) -> Info:
        """The mean velocity of a decision in the heading frame, and the expert's action."""
        info: Info = {"velocity": velocity}
        if self.walkers.task.expert:
            info["expert_action"] = self.walkers.expert_action[0]
        return info


class WalkingVectorEnv(gymnasium.vector.VectorEnv[Float32Array, Float32Array, Array]):
    """Robots that follow velocity commands in lockstep, in array code between resets.

    Args:
        num_envs: The number of robots.
        robot: See `WalkingEnv`.
        config: See `WalkingEnv`.
        autoreset_mode: When robots whose episodes are over begin new ones: in the next step
            (Gymnasium's default), in the same step (final observations are then in the infos), or
            not until ``reset(options={"reset_mask": rows})``.
        options: The fields of `WalkingTask`.

    Attributes:
        walkers: The robots.

    Raises:
        ValueError: An option is unknown or out of range, there is no such robot, or the
            configuration is for another one.
    """

    def __init__(
        self,
        num_envs: int = 1,
        robot: str | None = None,
        config: Config | Mapping[str, Plain] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        self.walkers = _walkers(robot, config, _task(**options), num_envs)
        self.num_envs = num_envs
        self._mode = AutoresetMode(autoreset_mode)
        self.metadata = {"render_modes": [], "autoreset_mode": self._mode}
        self.single_observation_space = _observation_space()
        self.single_action_space = _action_space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator] = []
        self._over = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | list[int] | None = None, options: Info | None = None
    ) -> tuple[Float32Array, Info]:
        """Begin an episode of every robot.

        Args:
            seed: Fixes these episodes, and all later ones of the same robots; robot i gets
                ``seed + i``, or the i-th seed of a list.
            options: ``reset_mask`` ``(num_envs,)`` selects the robots that begin an episode.
        """
        rows = np.ones(self.num_envs, bool)
        if options and "reset_mask" in options:
            rows = np.asarray(options["reset_mask"], bool)
        if seed is not None or not self._generators:
            seeded = self._seeded(seed)
            pairs = zip(seeded, self._generators or seeded, rows, strict=True)
            self._generators = [new if begins else old for new, old, begins in pairs]
        self.walkers.begin(rows, self._generators)
        self._over &= ~rows
        return self.walkers.observation, self._infos(np.zeros((self.num_envs, 3)), rows)

    def _seeded(self, seed: int | list[int] | None) -> list[np.random.Generator]:
        """A source of randomness for each robot."""
        if seed is None:
            seed = int(self.np_random.integers(2**31))
        elif isinstance(seed, int | np.integer):
            super().reset(seed=int(seed))
        seeds = seed if isinstance(seed, list) else [int(seed) + n for n in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"{len(seeds)} seeds for {self.num_envs} robots; give one for each")
        return [seeding.np_random(each)[0] for each in seeds]

    def step(self, actions: Float32Array) -> tuple[Float32Array, Array, BoolArray, BoolArray, Info]:
        """Carry out one decision of every robot whose episode is not over.

        Args:
            actions: ``(num_envs, 12)`` targets as fractions of ``action_range`` from the nominal
                pose.
        """
        over = self._over
        decided = self.walkers.decide(actions, ~over)
        self._over = decided.terminated | decided.truncated
        infos = self._infos(decided.velocity, ~over)
        if self._mode is AutoresetMode.NEXT_STEP and np.count_nonzero(over):
            self.walkers.begin(over, self._generators)
            infos = self._infos(decided.velocity, np.ones(self.num_envs, bool))
        elif self._mode is AutoresetMode.SAME_STEP and np.count_nonzero(self._over):
            infos = self._begin_again(decided, infos)
        elif self._mode is AutoresetMode.DISABLED:
            self._over |= over
        ends = (decided.terminated, decided.truncated)
        return self.walkers.observation, decided.reward, *ends, infos

    def _begin_again(self, decided: Decided, infos: Info) -> Info:
        """Begin new episodes where they are over; return the infos of old and new ones."""
        rows = self._over
        final = np.full(self.num_envs, None, dtype=object)
        seen = self.walkers.observation
        for row in np.flatnonzero(rows).tolist():
            final[row] = seen[row].copy()
        self.walkers.begin(rows, self._generators)
        self._over = np.zeros(self.num_envs, bool)
        last = {name: np.copy(value) for name, value in infos.items()}
        last.update({name: value & rows for name, value in last.items() if name[0] == "_"})
        velocity = np.where(rows[:, None], 0.0, decided.velocity)  # new episodes have none yet
        infos = self._infos(velocity, np.ones(self.num_envs, bool))
        return infos | {
            "final_obs": final,
            "_final_obs": rows.copy(),
            "final_info": last,
            "_final_info": rows.copy(),
        }

    def _infos(self, velocity: Array, rows: BoolArray) -> Info:
        """The infos of some robots, as Gymnasium's vector environments lay them out."""
        infos: Info = {"velocity": velocity, "_velocity": rows.copy()}
        if self.walkers.task.expert:
            infos["expert_action"] = self.walkers.expert_action
            infos["_expert_action"] = rows.copy()
        return infos
