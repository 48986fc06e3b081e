"""Speed of the engine, compared with a lower bound that is measured in the same run.

The lower bound on the time of a rollout is the time of the simulator's bare steps plus that of the
bare network. The figures depend on the machine and the moment: trust the ratios. Next: `train`,
`end_to_end`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from surefoot.config import Config
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, policy_spec
from surefoot.mpc.expert import make_expert, make_planner
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel, standing
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly, SafetySwitch
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import Starts, at_rest, starts_of
from surefoot.sim import make_simulator
from surefoot.types import TICKS_PER_SECOND, Command, MotionPlan, State
from surefoot.workers import Workers, map_chunks

STIFFER = 4.0
"""How many times as stiff as its own policies' a robot stands in a benchmark. With their gains, Go2
sags below its safety bounds within a second; the gains do not change what a tick costs."""


@dataclass(frozen=True)
class EngineSpeed:
    """Throughput of robots that a policy drives, on one core, with monitor and recording.

    Attributes:
        batch: Number of robots that are simulated together.
        robot_ms_per_s: Robot-milliseconds that are simulated in a second of wall time.
        floor_robot_ms_per_s: The same for bare steps and the bare network, which is an upper bound.
        ratio: Wall time over its lower bound; 1 at best.
        two_processes: Throughput of two processes over that of one.
        plan_share: Share of the wall time that goes into plans when the expert drives.
        floor_plan_share: The same share if there were only plans and bare steps.
    """

    batch: int
    robot_ms_per_s: float
    floor_robot_ms_per_s: float
    ratio: float
    two_processes: float
    plan_share: float
    floor_plan_share: float


@dataclass(frozen=True)
class RolloutTimes:
    """Wall times of a rollout.

    Attributes:
        rollout: Time of the rollout [s].
        lower_bound: Time of its bare steps and of the bare network [s].
        steps: Time of its bare steps [s].
        robot_seconds: Simulated time of all robots together, less if some fell [s].
        stood: Whether all robots stood, within their safety bounds.
    """

    rollout: float
    lower_bound: float
    steps: float
    robot_seconds: float
    stood: bool

    def of_standing(self) -> RolloutTimes:
        """The same times.

        Raises:
            RuntimeError: A robot did not stand.
        """
        if not self.stood:
            raise RuntimeError("a robot did not stand in the benchmark; its figures mean nothing")
        return self


def bench_engine(config: Config, batch: int = 20, seconds: float = 2.0) -> EngineSpeed:
    """Measure the throughput of the engine, on one core.

    Args:
        config: Configuration of robot, simulator, policy and expert.
        batch: Number of robots that are simulated together.
        seconds: Duration of a rollout [s].

    Raises:
        RuntimeError: A robot did not stand.
    """
    times = rollout_times(config, batch, seconds).of_standing()
    robot_ms = batch * seconds * TICKS_PER_SECOND
    two_processes = _two_processes(config, batch)
    plan_share, floor_plan_share = _plan_shares(config, batch, times.steps / seconds)
    return EngineSpeed(
        batch=batch,
        robot_ms_per_s=robot_ms / times.rollout,
        floor_robot_ms_per_s=robot_ms / times.lower_bound,
        ratio=times.rollout / times.lower_bound,
        two_processes=two_processes,
        plan_share=plan_share,
        floor_plan_share=floor_plan_share,
    )


def bare_rate(config: Config, batch: int = 20, seconds: float = 2.0) -> float:
    """Robot-milliseconds per second of bare steps and the bare network, on one core.

    Args:
        config: Configuration of robot, simulator and policy.
        batch: Number of robots that are simulated together.
        seconds: Duration of a rollout [s].

    Raises:
        RuntimeError: A robot did not stand.
    """
    times = rollout_times(config, batch, seconds).of_standing()
    return batch * seconds * TICKS_PER_SECOND / times.lower_bound


def rollout_times(config: Config, batch: int, seconds: float) -> RolloutTimes:
    """Median wall times of a rollout and of its parts.

    The policy holds the nominal pose, whatever its hidden layers compute, so the robots stand.
    The lower bound is the simulator's bare step under the same torques plus the network alone,
    timed right after.

    Args:
        config: Configuration of robot, simulator and policy.
        batch: Number of robots that are simulated together.
        seconds: Duration of a rollout [s].
    """
    robot = load_robot(config.robot)
    config = with_own_values(config, robot)
    policy = standing_policy(config)
    starts = _standing(robot, batch)
    simulator = make_simulator(robot, batch, config.simulation)
    # The expert is never needed where the robots stand within the bounds.
    arbiter = SafetySwitch(SafetyMonitor(Bounds(config.safety), 2.0))
    network = _network_alone(policy, batch)
    stood = True
    robot_seconds = []
    whole = []
    lower_bound = []
    steps = []
    for _ in range(5):
        began = time.perf_counter()
        rollouts = rollout(simulator, Episodes(starts, seconds), arbiter, policy, policy)
        whole.append(time.perf_counter() - began)
        fell = rollouts.outcome == Outcome.FELL
        stood = stood and not (fell.any() or rollouts.expert_drove.any())
        robot_seconds.append(rollouts.length.sum() / TICKS_PER_SECOND)
        ticks = rollouts.q.shape[1]
        simulator.reset(starts.q, starts.v)
        physics = 0.0
        for tick in range(ticks):
            torque = np.ascontiguousarray(rollouts.torque[:, tick])
            began = time.perf_counter()
            simulator.step(torque)
            physics += time.perf_counter() - began
        steps.append(physics)
        lower_bound.append(physics + ticks * median_seconds(network, 400))
    return RolloutTimes(
        rollout=float(np.median(whole)),
        lower_bound=float(np.median(lower_bound)),
        steps=float(np.median(steps)),
        robot_seconds=float(np.median(robot_seconds)),
        stood=stood,
    )


def _two_processes(config: Config, batch: int, seconds: float = 4.0) -> float:
    """Throughput of two processes over that of one process."""
    chunks = [(config, batch, seconds)] * 2
    for _ in map_chunks(_standing_rate, [(config, batch, 0.1)] * 4, Workers(2), "warming up"):
        pass
    one = map_chunks(_standing_rate, chunks[:1], Workers(1), "one process")
    two = map_chunks(_standing_rate, chunks, Workers(2), "two processes")
    return sum(two) / one[0]


def _standing_rate(chunk: tuple[Config, int, float]) -> float:
    """Robot-ms per second of one process."""
    config, batch, seconds = chunk
    robot = load_robot(config.robot)
    policy = standing_policy(config)
    starts = _standing(robot, batch)
    simulator = make_simulator(robot, batch, config.simulation)
    began = time.perf_counter()
    rollout(simulator, Episodes(starts, seconds), PolicyOnly(), policy, policy)
    return batch * seconds * TICKS_PER_SECOND / (time.perf_counter() - began)


def _plan_shares(config: Config, batch: int, steps: float) -> tuple[float, float]:
    """Shares of the wall time that go into plans when the expert drives.

    Args:
        config: Configuration of robot, simulator and expert.
        batch: Number of robots that are simulated together.
        steps: Wall time of the bare steps of one simulated second [s].

    Returns:
        The share of the rollout's wall time, and the share of plans and bare steps alone.
    """
    robot = load_robot(config.robot)
    planner = make_planner(robot, config)
    spent = 0.0

    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        nonlocal spent
        began = time.perf_counter()
        result = planner.plan(state, tick, command)
        spent += time.perf_counter() - began
        return result

    expert = make_expert(robot, config, plan)
    simulator = make_simulator(robot, batch, config.simulation)
    starts = starts_of(config)["nominal"][np.arange(batch)]
    rollout(simulator, Episodes(starts, 0.1), ExpertOnly(), expert)
    spent = 0.0
    began = time.perf_counter()
    rollout(simulator, Episodes(starts, 1.0), ExpertOnly(), expert)
    whole = time.perf_counter() - began
    return spent / whole, spent / (spent + steps)


def _standing(robot: RobotModel, batch: int) -> Starts:
    """Robots at rest on their feet."""
    return at_rest(standing(robot), np.zeros((batch, 3)))


def standing_policy(config: Config) -> Policy:
    """A policy of the configured network that holds the nominal pose, stiffly (`STIFFER`)."""
    robot = load_robot(config.robot)
    own = policy_spec(config)
    # The damping keeps its ratio.
    spec = replace(own, kp=STIFFER * own.kp, kd=math.sqrt(STIFFER) * own.kd)
    network = PolicyNetwork(config.policy, inputs=spec.observation.input_size)
    with torch.no_grad():
        last: Any = network.linear[-1]
        last.weight.zero_()
        last.bias.copy_(torch.from_numpy(robot.nominal[7:]))
    return Policy(network, spec, np.zeros((2, 3)), robot.name)


def _network_alone(policy: Policy, batch: int) -> Callable[[], object]:
    """The policy's network and nothing else."""
    size = policy.spec.observation.input_size
    inputs = np.random.default_rng(0).normal(size=(batch, size)).astype(np.float32)
    return lambda: policy.forward(inputs)


def median_seconds(function: Callable[[], object], repeats: int) -> float:
    """Median wall time of a call [s].

    Args:
        function: What is called.
        repeats: Number of calls.
    """
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        times.append(time.perf_counter() - began)
    return float(np.median(times))
