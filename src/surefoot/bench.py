"""Speed, each beside what it could be at best, measured in the same run on one core.

A plan by stage; the engine beside bare physics plus bare matrix products; a training step beside
its matrix products. Figures of one machine and moment: trust the ratios.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from surefoot.config import Config, SafetyConfig
from surefoot.dataset import Frames
from surefoot.engine import PolicyOnly, rollout
from surefoot.mpc.planner import Planner
from surefoot.observation import INPUT_SIZE
from surefoot.policy import Policy, PolicyNetwork
from surefoot.robot import RobotModel, solo12
from surefoot.safety import Outcome
from surefoot.sim import make_simulator
from surefoot.starts import load_starts
from surefoot.train import fit
from surefoot.types import TICKS_PER_SECOND, Command, State, to_ticks


def bench_plan(config: Config, plans: int = 300) -> dict[str, Any]:
    """Time of cold-started plans from `test` starts, one core.

    Returns:
        ``plan_ms``: ``median``, ``p99`` and ``stages`` (median of each) [ms]; ``plans``.
    """
    robot = solo12(config.robot)
    planner = Planner(robot, config.gait, config.expert, config.simulation.friction)
    starts = load_starts()["test"][:plans]
    states = _states(robot, starts.q, starts.v)
    total, stages = [], []
    for warm_up in (True, False):
        for row in range(min(10, len(starts)) if warm_up else len(starts)):
            began = time.perf_counter()
            plan = planner.solve(states[row], int(starts.tick[row]), Command(*starts.command[row]))
            if not warm_up:
                total.append(1e3 * (time.perf_counter() - began))
                stages.append(plan.seconds)
    return {
        "plans": len(total),
        "nodes": [config.expert.centroidal.nodes, config.expert.kinematic.nodes],
        "plan_ms": {
            "median": float(np.median(total)),
            "p99": float(np.percentile(total, 99)),
            "stages": {
                stage: 1e3 * float(np.median([record[stage] for record in stages]))
                for stage in stages[0]
            },
        },
    }


def bench_engine(config: Config, batch: int = 20, seconds: float = 2.0) -> dict[str, Any]:
    """Throughput of policy-driven robots, one core.

    The policy holds the nominal pose, whatever its hidden layers compute, so that the robots stand.
    The floor is the simulator's bare step under the same torques plus the network's bare matrix
    products, timed right after.

    Returns:
        ``robot_ms_per_s``, ``floor_robot_ms_per_s``, ``ratio`` (our time over the
        floor's, 1 at best), ``batch``.
    """
    robot = solo12(config.robot)
    network = PolicyNetwork(config.policy)
    with torch.no_grad():
        last: Any = network.linear[-1]
        last.weight.zero_()
        last.bias.copy_(torch.from_numpy(robot.nominal[7:]))
    policy = Policy(network, config.policy, to_ticks(config.gait.period), np.zeros((2, 3)))
    stored = load_starts()["nominal"]
    starts = stored[np.arange(batch) % 20]
    simulator = make_simulator(robot, batch, config.simulation)
    ours, floor = [], []
    for _ in range(3):
        began = time.perf_counter()
        record = rollout(
            simulator, robot, starts, seconds, PolicyOnly(), policy, policy, safety=_NEVER_FALLS
        )
        ours.append(time.perf_counter() - began)
        if (record.outcome == Outcome.FELL).any():
            raise RuntimeError("a robot blew up in the benchmark; its figures would mean nothing")
        ticks = record.q.shape[1]
        simulator.reset(starts.q, starts.v)
        physics = 0.0
        for tick in range(ticks):
            torque = np.ascontiguousarray(record.torque[:, tick])
            began = time.perf_counter()
            simulator.step(torque)
            physics += time.perf_counter() - began
        floor.append(physics + ticks * _seconds(_network_products(network, batch), 200))
    robot_ms = batch * seconds * TICKS_PER_SECOND
    mine, least = float(np.median(ours)), float(np.median(floor))
    return {
        "batch": batch,
        "robot_ms_per_s": robot_ms / mine,
        "floor_robot_ms_per_s": robot_ms / least,
        "ratio": mine / least,
    }


_NEVER_FALLS = replace(SafetyConfig(), fall_height=(-1e9, 1e9), fall_angle=1e9)


def bench_train(config: Config, steps: int = 100) -> dict[str, Any]:
    """Time of a training step, one thread, beside its matrix products (forward and backward).

    Returns:
        ``step_ms``, ``floor_step_ms``, ``ratio``, ``batch``.
    """
    batch = config.training.batch
    training = replace(config.training, validation=0.0, threads=1)
    frames = _random_frames(steps * batch)
    network = PolicyNetwork(config.policy)
    mine, floor = [], []
    for _ in range(3):
        # The second epoch is steps only; before the first, inputs and labels are derived.
        ends: list[float] = []
        period = to_ticks(config.gait.period)
        fit(
            network,
            frames,
            training,
            config.policy,
            2,
            seed=0,
            period_ticks=period,
            progress=lambda *_, ends=ends: ends.append(time.perf_counter()),
        )
        mine.append((ends[1] - ends[0]) / steps)
        forward = _seconds(_network_products(network, batch), 30)
        floor.append(3 * forward)  # backward: one product for the inputs, one for the weights
    step, least = float(np.median(mine)), float(np.median(floor))
    return {
        "batch": batch,
        "step_ms": 1e3 * step,
        "floor_step_ms": 1e3 * least,
        "ratio": step / least,
    }


def _network_products(network: PolicyNetwork, batch: int) -> Callable[[], None]:
    """The matrix products of one forward pass and nothing else, on one thread."""
    weights = [weight for weight, _ in network.folded()]
    inputs = [torch.randn(batch, size) for size in (INPUT_SIZE, *network.hidden)]
    torch.set_num_threads(1)

    def products() -> None:
        with torch.inference_mode():
            for x, weight in zip(inputs, weights, strict=True):
                torch.mm(x, weight)

    return products


def _seconds(function: Callable[[], None], repeats: int) -> float:
    """Median time of a call [s]."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


def _states(robot: RobotModel, q: np.ndarray, v: np.ndarray) -> State:
    """Measured states of n robots."""
    simulator = make_simulator(robot, len(q))
    simulator.reset(q, v)
    return simulator.state


def _random_frames(n: int) -> Frames:
    """Frames of noise around a standing robot; the time of a step does not depend on them."""
    rng = np.random.default_rng(0)
    q = np.zeros((n, 19))
    q[:, 6] = 1.0
    q[:, 7:] = rng.standard_normal((n, 12))
    return Frames(
        q=q,
        v=rng.standard_normal((n, 18)),
        com=rng.standard_normal((n, 3)),
        feet=rng.standard_normal((n, 4, 3)),
        contacts=np.ones((n, 4), dtype=bool),
        tick=np.arange(n),
        command=np.zeros((n, 3)),
        torque=rng.standard_normal((n, 12)),
        expert_drove=np.ones(n, dtype=bool),
        episode=np.zeros(n, dtype=np.int64),
        outcome=np.zeros(n, dtype=np.int8),
    )
