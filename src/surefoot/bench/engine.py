"""Speed of engine and training, each beside what it could be at best, measured in the same run.

The engine beside bare physics plus the bare network; a training step beside PyTorch's eager one and
its matrix products. Figures of one machine and moment: trust the ratios. See also ``bench_plan``
and ``bench_run``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from surefoot.config import Config
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.policy import Policy
from surefoot.mpc.expert import Expert, make_planner
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly, SafetySwitch
from surefoot.rollouts.engine import Episodes, rollout
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import Starts, at_rest, load_starts
from surefoot.sim import make_simulator
from surefoot.types import TICKS_PER_SECOND, Command, MotionPlan, State, to_ticks
from surefoot.workers import Workers, map_chunks


def bench_engine(config: Config, batch: int = 20, seconds: float = 2.0) -> dict[str, Any]:
    """Throughput of policy-driven robots, one core, watched by the monitor and recorded.

    Returns:
        ``robot_ms_per_s``, ``floor_robot_ms_per_s``, ``ratio`` (our time over the
        floor's, 1 at best), ``batch``; ``two_processes``: how many times more two processes do
        than one; ``plan_share``: share of the time that goes into plans where the expert drives
        all the time, ``floor_plan_share`` if there were only plans and bare steps.
    """
    mine, least, steps = _engine_times(config, batch, seconds)
    robot_ms = batch * seconds * TICKS_PER_SECOND
    return {
        "batch": batch,
        "robot_ms_per_s": robot_ms / mine,
        "floor_robot_ms_per_s": robot_ms / least,
        "ratio": mine / least,
        "two_processes": _two_processes(config, batch),
        **_expert_shares(config, batch, steps / seconds),
    }


def engine_floor(config: Config, batch: int = 20, seconds: float = 2.0) -> float:
    """Robot-ms per second of bare steps and the bare network, one core."""
    _, least, _ = _engine_times(config, batch, seconds)
    return batch * seconds * TICKS_PER_SECOND / least


def _engine_times(config: Config, batch: int, seconds: float) -> tuple[float, float, float]:
    """Wall time [s] of a rollout, of its floor, and of the bare steps in that.

    The policy holds the nominal pose, whatever its hidden layers compute, so that the robots stand.
    The floor is the simulator's bare step under the same torques plus the network alone, timed
    right after.
    """
    robot, policy = solo12(config.robot), standing_policy(config)
    starts, simulator = _standing(batch), make_simulator(robot, batch, config.simulation)
    # Who would take over is not asked: the robots stand within the bounds.
    arbiter = SafetySwitch(SafetyMonitor(Bounds(config.safety), 2.0))
    network = _network_alone(policy, batch)
    ours, floor, steps = [], [], []
    for _ in range(5):
        began = time.perf_counter()
        record = rollout(simulator, Episodes(starts, seconds), arbiter, policy, policy)
        ours.append(time.perf_counter() - began)
        if (record.outcome == Outcome.FELL).any() or record.expert_drove.any():
            raise RuntimeError("a robot did not stand in the benchmark; its figures mean nothing")
        ticks = record.q.shape[1]
        simulator.reset(starts.q, starts.v)
        physics = 0.0
        for tick in range(ticks):
            torque = np.ascontiguousarray(record.torque[:, tick])
            began = time.perf_counter()
            simulator.step(torque)
            physics += time.perf_counter() - began
        steps.append(physics)
        floor.append(physics + ticks * _seconds(network, 400))
    return float(np.median(ours)), float(np.median(floor)), float(np.median(steps))


def _two_processes(config: Config, batch: int, seconds: float = 4.0) -> float:
    """Throughput of two processes over that of one."""
    chunks = [(config, batch, seconds)] * 2
    for _ in map_chunks(_standing_rate, [(config, batch, 0.1)] * 4, Workers(2), "warming up"):
        pass
    one = map_chunks(_standing_rate, chunks[:1], Workers(1), "one process")
    two = map_chunks(_standing_rate, chunks, Workers(2), "two processes")
    return sum(two) / one[0]


def _standing_rate(chunk: tuple[Config, int, float]) -> float:
    """Robot-ms per second of one process."""
    config, batch, seconds = chunk
    robot, policy, starts = solo12(config.robot), standing_policy(config), _standing(batch)
    simulator = make_simulator(robot, batch, config.simulation)
    began = time.perf_counter()
    rollout(simulator, Episodes(starts, seconds), PolicyOnly(), policy, policy)
    return batch * seconds * TICKS_PER_SECOND / (time.perf_counter() - began)


def _expert_shares(config: Config, batch: int, steps: float) -> dict[str, float]:
    """Where the time goes when the expert drives; ``steps``: bare ones, per simulated second."""
    robot, planner, spent = solo12(config.robot), make_planner(solo12(config.robot), config), 0.0

    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        nonlocal spent
        began = time.perf_counter()
        result = planner.plan(state, tick, command)
        spent += time.perf_counter() - began
        return result

    expert = Expert(plan, config.expert.kp, config.expert.kd)
    simulator = make_simulator(robot, batch, config.simulation)
    starts = load_starts()["nominal"][np.arange(batch)]
    rollout(simulator, Episodes(starts, 0.1), ExpertOnly(), expert)
    spent, began = 0.0, time.perf_counter()
    rollout(simulator, Episodes(starts, 1.0), ExpertOnly(), expert)
    whole = time.perf_counter() - began
    return {"plan_share": spent / whole, "floor_plan_share": spent / (spent + steps)}


def _standing(batch: int) -> Starts:
    """Robots at rest on their feet."""
    return at_rest(standing(solo12()), np.zeros((batch, 3)))


def standing_policy(config: Config) -> Policy:
    """A policy of the configured network that holds the nominal pose."""
    network = PolicyNetwork(config.policy)
    with torch.no_grad():
        last: Any = network.linear[-1]
        last.weight.zero_()
        last.bias.copy_(torch.from_numpy(solo12(config.robot).nominal[7:]))
    return Policy(network, config.policy, to_ticks(config.gait.period), np.zeros((2, 3)))


def _network_alone(policy: Policy, batch: int) -> Callable[[], object]:
    """The policy's network and nothing else."""
    inputs = np.random.default_rng(0).normal(size=(batch, INPUT_SIZE)).astype(np.float32)
    return lambda: policy.forward(inputs)


def _seconds(function: Callable[[], object], repeats: int) -> float:
    """Median time of a call [s]."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        times.append(time.perf_counter() - began)
    return float(np.median(times))
