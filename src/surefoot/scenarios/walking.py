"""The expert walks at several commands at once, undisturbed and from standing still.

Settled gait cycles (`make`) and command gains (`calibration`) come from these recordings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from surefoot.config import CommandBox, Config, SafetyConfig
from surefoot.mpc.expert import make_expert
from surefoot.robots.bounds import fallen
from surefoot.robots.model import RobotModel, clip_torque, standing, stop_speeding
from surefoot.rotations import heading_velocity, rotation
from surefoot.sim import make_simulator
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray, to_ticks

MOST_SHOWN = 4
"""Maximum number of falls that a message names."""


class GaitError(ValueError):
    """A robot does not walk in a gait as it was asked to; the message has the numbers.

    Attributes:
        largest: The largest box of commands that it does walk; None if none was found or sought.
    """

    def __init__(self, message: str, largest: CommandBox | None = None) -> None:
        super().__init__(message)
        self.largest = largest


@dataclass(frozen=True)
class Walks:
    """n robots that walked in parallel, each at its own command.

    Attributes:
        tick: ``(T,)`` the gait clock of the states [ms].
        q: ``(T, n, 19)`` configurations [m, unit quaternion, rad].
        v: ``(T, n, 18)`` velocities [m/s, rad/s].
        command: ``(n, 3)`` vx, vy [m/s] and yaw rate [rad/s].
    """

    tick: IntArray
    q: Array
    v: Array
    command: Array

    def since(self, tick: int) -> Walks:
        """The part of the walks from a tick of the gait clock on."""
        rows = self.tick >= tick
        return replace(self, tick=self.tick[rows], q=self.q[rows], v=self.v[rows])

    def at(self, ticks: IntArray) -> Walks:
        """The part of the walks at some ticks of the gait clock."""
        rows = np.isin(self.tick, ticks)
        return replace(self, tick=self.tick[rows], q=self.q[rows], v=self.v[rows])

    def of(self, robots: BoolArray) -> Walks:
        """The walks of some of the robots, given by ``(n,)`` True for each of them."""
        return replace(self, q=self.q[:, robots], v=self.v[:, robots], command=self.command[robots])

    @property
    def mean_velocity(self) -> Array:
        """``(n, 3)`` mean vx, vy [m/s] and yaw rate [rad/s] in the heading frame."""
        return heading_velocity(rotation(self.q[..., 3:7]), self.v).mean(axis=0)

    def fallen(self, safety: SafetyConfig) -> BoolArray:
        """``(T, n)`` True where a robot has fallen."""
        q = np.ascontiguousarray(self.q.reshape(-1, 19))
        lost: BoolArray = fallen(q, safety)
        return lost.reshape(self.q.shape[:2])

    def lost(self, safety: SafetyConfig) -> BoolArray:
        """``(n,)`` True for robots that fell, from `SafetyConfig.grace` on, as in episodes."""
        return np.asarray(self._counted_falls(safety).any(axis=0))

    def check(self, safety: SafetyConfig, gait: str) -> None:
        """Check that no robot fell; falls count from `SafetyConfig.grace` on, as in episodes.

        Args:
            safety: The bounds beyond which a robot has fallen.
            gait: The name of the gait, for the message.

        Raises:
            GaitError: A robot fell; the message names the commands and the times.
        """
        lost = np.flatnonzero(self.lost(safety))
        if not len(lost):
            return
        seconds = self.tick[self._counted_falls(safety).argmax(axis=0)] / TICKS_PER_SECOND
        falls = [f"({_numbers(self.command[n])}) after {seconds[n]:.2f} s" for n in lost]
        more = ", ..." if len(falls) > MOST_SHOWN else ""
        raise GaitError(
            f"the gait {gait} does not carry the robot: {len(lost)} of {len(self.command)} fell, "
            f"at the commands (vx, vy, yaw rate) {', '.join(falls[:MOST_SHOWN])}{more}; use "
            "a smaller box of commands, or another gait"
        )

    def _counted_falls(self, safety: SafetyConfig) -> BoolArray:
        """``(T, n)`` True where a robot has fallen, from `SafetyConfig.grace` on."""
        return self.fallen(safety) & (self.tick >= to_ticks(safety.grace))[:, None]


def _numbers(values: Array) -> str:
    """Numbers for a message, to three digits."""
    return ", ".join(f"{value:.3g}" for value in values)


def expert_walks(
    robot: RobotModel,
    config: Config,
    command: Array,
    ticks: int,
    every: int = 1,
    progress: Callable[[int], object] | None = None,
) -> Walks:
    """Let the expert walk from standing still, on the plane whatever the terrain.

    Robots that have fallen are simulated to the end like the others.

    Args:
        robot: The robot.
        config: The gait, the expert and the simulator.
        command: ``(n, 3)`` vx, vy [m/s] and yaw rate [rad/s] of each robot.
        ticks: How long it walks [ms].
        every: The interval at which states are recorded [ms].
        progress: Called with 1 after each tick.
    """
    n = len(command)
    config = replace(config, simulation=replace(config.simulation, terrain=None))
    simulator = make_simulator(robot, n, config.simulation)
    expert = make_expert(robot, config)
    expert.reset(n)
    simulator.reset(np.tile(standing(robot), (n, 1)), np.zeros((n, 18)))
    everyone = np.ones(n, bool)
    q = []
    v = []
    for tick in range(ticks):
        state = simulator.state
        if tick % every == 0:
            q.append(state.q)
            v.append(state.v)
        torque = expert.torque(state, np.full(n, tick), command, everyone)
        torque = clip_torque(torque, robot.torque_limit)
        if robot.enforce_speed_limit:
            torque = stop_speeding(torque, state.v[:, 6:], robot.speed_limit)
        simulator.step(torque)
        if progress is not None:
            progress(1)
    return Walks(np.arange(0, ticks, every), np.array(q), np.array(v), command)
