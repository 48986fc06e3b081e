"""The task of the Gymnasium environments: robots in lockstep follow commands at a decision rate.

A decision is twelve joint targets, which the policy's PD law tracks for some ticks of 1 ms. The
reward of a decision that takes dt seconds is ::

    dt (tracking exp(-|v - v_cmd|^2 / s_v^2) + turning exp(-(w - w_cmd)^2 / s_w^2)
        + alive - effort mean((tau / tau_max)^2))

where velocities are in the heading frame, and velocities and squared torques are averages over the
ticks, so that the return of an episode is about the same at every rate. An episode terminates when
the robot falls, by the package's own rule (`SafetyConfig`), and is truncated after its duration.
Read `env` next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal

import numpy as np

from surefoot.config import Config, RobotConfig
from surefoot.config.checked import Checked, Duration, Within
from surefoot.learning.observation import Float32Array, network_input, state_spec
from surefoot.learning.policy import PolicySpec, pd, policy_spec, target_of
from surefoot.mpc.expert import make_expert
from surefoot.mpc.gaits import only_gait
from surefoot.robots.load import find_spec, load_robot
from surefoot.robots.model import standing, stop_speeding
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.compiled import clip_torque
from surefoot.rollouts.outcome import Falls
from surefoot.rotations import heading_velocity
from surefoot.scenarios.gains import with_measured_gain
from surefoot.scenarios.starts import Starts, at_rest, starts_of
from surefoot.sim import make_simulator
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, State, to_ticks

Begin = Literal["standing", "nominal", "train", "select", "test"]
"""Where episodes begin: standing still, or in a split of the stored initial states."""
Weight = Annotated[float, Within(0.0, 1000.0)]
"""The weight of a term of the reward [1/s]."""
MOST_SEEN = 1000.0
"""No number in an observation is larger than this; those of a walking robot stay below 50."""


@dataclass(frozen=True)
class WalkingTask(Checked):
    """What an environment asks of its robots."""

    section: ClassVar[str] = "task"

    rate: Annotated[int, Within(1, TICKS_PER_SECOND)] = 50
    """[Hz] decisions in a second, a divisor of 1000. The PD law runs at 1 kHz whatever this is. 50
    is usual in reinforcement learning: exploration that is held for 20 ms moves a leg, and an
    episode has few enough decisions to assign credit to. 1000 is the rate of this package's
    policies, and of the data that they learn from."""
    duration: Duration = 10.0
    """[s] an episode is truncated after this time."""
    begin: Begin = "standing"
    """Where episodes begin: `standing` still in the nominal pose, at a random phase of the gait,
    with a random command of the configuration's box; or in a split of the stored initial states
    `config.start_set`, with its command."""
    expert: bool = False
    """Whether every info has `expert_action`, the expert's answer to the same observation. Its
    model predictive controller then plans every 50 ms. Its command gains of another robot than
    Solo12, or another gait than the trot, are measured, which takes seconds the first time."""
    action_range: Annotated[float, Within(0.01, 10.0)] = 2.0
    """[rad] an action of 1 or -1 is a target this far from the nominal pose. Walking
    undisturbed, the experts of Solo12 and Go2 stay within 1.1 and 1.6 rad."""
    tracking: Weight = 1.0
    """Weight of following the commanded velocity."""
    turning: Weight = 0.5
    """Weight of following the commanded yaw rate."""
    alive: Weight = 0.5
    """Weight of not having fallen."""
    effort: Weight = 0.5
    """Weight of the mean squared share of the torque limits."""
    velocity_scale: Annotated[float, Within(0.001, 100.0)] = 0.1
    """[m/s] s_v: an error of this much leaves 37 % of the reward for tracking."""
    yaw_rate_scale: Annotated[float, Within(0.001, 100.0)] = 0.3
    """[rad/s] s_w, the same for turning."""

    def __post_init__(self) -> None:
        """Check the fields, and that a decision takes a whole number of ticks."""
        super().__post_init__()
        if TICKS_PER_SECOND % self.rate:
            raise ValueError(
                f"task.rate is {self.rate} Hz; use a divisor of 1000, such as 50, 100 or 1000"
            )


def walking_config(robot: str | None = None, config: Config | None = None) -> Config:
    """The configuration of an environment, with the robot's own values in place of None.

    Args:
        robot: The name of a robot of the package, or a file with a `RobotSpec`; None for the robot
            of the configuration.
        config: A configuration for that robot; None for the default one.

    Raises:
        ValueError: There is no such robot, or the configuration is for another one or has several
            gaits.
    """
    named = Config() if robot is None else Config(robot=RobotConfig(model=robot))
    if config is None:
        config = named
    elif robot is not None and find_spec(config.robot) != find_spec(named.robot):
        raise ValueError(
            f"the robot is {robot!r}, but that of the configuration is {config.robot.model!r}; set "
            f"config.robot to RobotConfig({robot!r}), or leave one of the two out"
        )
    return with_own_values(only_gait(config, "an environment"))


def task_spec(config: Config) -> PolicySpec:
    """The observation of environments and exported data: the full state, whatever policies see."""
    return replace(policy_spec(config), observation=state_spec(config))


@dataclass(frozen=True)
class Decided:
    """The result of one decision of B robots; rows that did not move hold zeros.

    Attributes:
        reward: ``(B,)`` the reward.
        terminated: ``(B,)`` True where the robot fell.
        truncated: ``(B,)`` True where the time of the episode is up.
        velocity: ``(B, 3)`` mean vx, vy [m/s] and yaw rate [rad/s] in the heading frame.
    """

    reward: Array
    terminated: BoolArray
    truncated: BoolArray
    velocity: Array


class Walkers:
    """B robots that follow commands, each in its own episode.

    A robot's episode depends only on its own generator and actions, not on the other robots.

    Args:
        config: Robot, gait, commands, simulator, gains and bounds, from `walking_config`.
        task: The task.
        batch: The number of robots B.

    Attributes:
        robot: The robot.
        task: The task.
        batch: The number of robots B.
        command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s].
        tick: ``(B,)`` gait clock [ms].

    Raises:
        ValueError: There is no such robot, the stored initial states are for another robot or gait,
            the configuration has a terrain, or the expert is needed but does not walk in this gait.
    """

    def __init__(self, config: Config, task: WalkingTask, batch: int) -> None:
        if config.simulation.terrain is not None:
            raise ValueError(
                f"simulation.terrain is {config.simulation.terrain!r}, but the robots of an "
                "environment walk on level ground; leave it out, or set it to None"
            )
        if task.expert:
            config = with_measured_gain(config)
        self.robot = load_robot(config.robot)
        self.batch = batch
        self.task = task
        self.command = np.zeros((batch, 3))
        self.tick = np.zeros(batch, np.int64)
        self._config = config
        self._spec = task_spec(config)
        self._period = to_ticks(config.gait.period)
        self._skip = TICKS_PER_SECOND // task.rate
        self._end = -(-to_ticks(task.duration) // self._skip) * self._skip
        self._stored = None if task.begin == "standing" else starts_of(config)[task.begin]
        self._simulator = make_simulator(self.robot, batch, config.simulation)
        self._elapsed = np.zeros(batch, np.int64)
        self._falls = Falls(config.safety, batch)
        self._expert = make_expert(self.robot, config) if task.expert else None
        self._expert_target = np.zeros((batch, 12))
        if self._expert is not None:
            self._expert.reset(batch)

    def begin(self, rows: BoolArray, generators: list[np.random.Generator]) -> None:
        """Begin new episodes.

        Args:
            rows: ``(B,)`` True for the robots that begin an episode.
            generators: B random generators, one for each robot.
        """
        q = np.zeros((self.batch, 19))
        v = np.zeros((self.batch, 18))
        for row in np.flatnonzero(rows).tolist():
            start = self._draw(generators[row])
            q[row] = start.q[0]
            v[row] = start.v[0]
            self.tick[row] = start.tick[0]
            self.command[row] = start.command[0]
        self._simulator.reset(q, v, rows)
        self._elapsed[rows] = 0
        self._falls.reset(rows)
        if self._expert is not None:
            self._expert.forget(rows)
            self._ask(self._simulator.state, rows)

    def _draw(self, rng: np.random.Generator) -> Starts:
        """Draw one initial state."""
        if self._stored is not None:
            row = int(rng.integers(len(self._stored)))
            return self._stored[row : row + 1]
        low, high = np.array(self._config.commands.axes).T
        start = at_rest(standing(self.robot), rng.uniform(low, high)[None])
        return replace(start, tick=rng.integers(self._period, size=1))

    def decide(self, action: Array | Float32Array, rows: BoolArray) -> Decided:
        """Carry out one decision of some robots.

        Args:
            action: ``(B, 12)`` targets as fractions of ``task.action_range`` from the nominal pose.
            rows: ``(B,)`` True for the robots that move; the others are left as they are.

        Raises:
            ValueError: The action of a robot that moves is not finite.
        """
        wrong = rows & ~np.isfinite(action).all(axis=1)
        if wrong.any():
            raise ValueError(f"the action of robot {int(wrong.argmax())} is not finite")
        target = self.robot.nominal[7:] + self.task.action_range * np.asarray(action, float)
        limit = self.robot.torque_limit
        moving = rows.copy()
        fell = np.zeros(self.batch, bool)
        ticks = np.zeros(self.batch)
        effort = np.zeros(self.batch)
        velocity = np.zeros((self.batch, 3))
        state = self._simulator.state
        for _ in range(self._skip):
            torque = clip_torque(pd(target, state.q, state.v, self._spec), limit)
            if self.robot.enforce_speed_limit:
                torque = stop_speeding(torque, state.v[:, 6:], self.robot.speed_limit)
            self._simulator.step(torque, moving)
            state = self._simulator.state
            self.tick += moving
            self._elapsed += moving
            ticks += moving
            effort += np.where(moving, ((torque / limit) ** 2).mean(axis=1), 0.0)
            with np.errstate(over="ignore", invalid="ignore"):  # of a robot that has blown up
                reached = heading_velocity(state.rotation, state.v)
                velocity += np.where(moving[:, None], reached, 0.0)
            lost = self._lost(state) & moving
            if np.count_nonzero(lost):
                fell |= lost
                moving = moving & ~lost
            if self._expert is not None:
                self._ask(state, moving)
            if not np.count_nonzero(moving):
                break
        return self._decided(rows, fell, ticks, effort, velocity)

    def _decided(
        self, rows: BoolArray, fell: BoolArray, ticks: Array, effort: Array, velocity: Array
    ) -> Decided:
        """The reward and the end of the episodes, from sums over the ticks of a decision."""
        ran_away = np.asarray(
            ~np.isfinite(velocity).all(axis=1)
        )  # numbers of a robot that has blown up
        count = np.maximum(ticks, 1.0)
        mean = np.where(ran_away[:, None], 0.0, velocity / count[:, None])
        reward = reward_rate(self.task, mean, self.command, effort / count)
        reward *= ticks / TICKS_PER_SECOND
        return Decided(
            reward=np.where(rows & ~ran_away, reward, 0.0),
            terminated=fell,
            truncated=rows & ~fell & (self._elapsed >= self._end),
            velocity=np.where(rows[:, None], mean, 0.0),
        )

    def _lost(self, state: State) -> BoolArray:
        """``(B,)`` True where a robot has fallen, as the engine judges it."""
        lost = self._falls.judge(state, self._simulator.body_contact, self._elapsed)
        return lost | self._simulator.blown_up

    def _ask(self, state: State, rows: BoolArray) -> None:
        """Ask the expert about some robots; it plans on its grid, as it does for DAGGER."""
        if self._expert is None or not np.count_nonzero(rows):
            return
        torque = self._expert.torque(state, self.tick, self.command, rows)
        torque = clip_torque(torque, self.robot.torque_limit)
        target = target_of(torque, state.q, state.v, self._spec)
        self._expert_target = np.where(rows[:, None], target, self._expert_target)

    @property
    def expert_action(self) -> Float32Array:
        """``(B, 12)`` actions with which the PD law gives the expert's torque at this instant.

        They are not clipped to [-1, 1]. A robot that has fallen keeps the last one before its fall.
        """
        offset = self._expert_target - self.robot.nominal[7:]
        return (offset / self.task.action_range).astype(np.float32)

    @property
    def observation(self) -> Float32Array:
        """``(B, 47)`` what a policy of this package sees (`learning.observation`)."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a robot that has blown up
            seen = network_input(
                self._simulator.state, self.tick, self.command, self._spec.observation
            )
        return np.clip(np.nan_to_num(seen, posinf=MOST_SEEN), -MOST_SEEN, MOST_SEEN)


def reward_rate(task: WalkingTask, velocity: Array, command: Array, effort: Array) -> Array:
    """``(n,)`` the reward per second of a robot that has not fallen.

    Args:
        task: The weights.
        velocity: ``(n, 3)`` vx, vy [m/s] and yaw rate [rad/s] in the heading frame.
        command: ``(n, 3)`` the commanded values of the same.
        effort: ``(n,)`` the mean squared share of the torque limits.
    """
    error = velocity - command
    reward = task.tracking * np.exp(-(error[:, :2] ** 2).sum(axis=1) / task.velocity_scale**2)
    reward += task.turning * np.exp(-((error[:, 2] / task.yaw_rate_scale) ** 2))
    return reward + task.alive - task.effort * effort
