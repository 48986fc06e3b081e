"""Speed, each beside what it could be at best, measured in the same run on one core.

A plan by stage, cold and warm; the engine beside bare physics plus bare matrix products; a training
step beside its matrix products. Figures of one machine and moment: trust the ratios.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from surefoot.config import Config, ExpertConfig
from surefoot.dataset import Frames
from surefoot.engine import ExpertOnly, PolicyOnly, SafetySwitch, rollout
from surefoot.mpc.expert import Expert, make_planner
from surefoot.mpc.planner import LAST_NODE, PlanStages
from surefoot.observation import INPUT_SIZE
from surefoot.policy import Policy, PolicyNetwork
from surefoot.robot import solo12
from surefoot.safety import HandBack, Outcome, SafetyMonitor
from surefoot.sim import make_simulator
from surefoot.starts import load_starts
from surefoot.train import fit
from surefoot.types import TICKS_PER_SECOND, Command, MotionPlan, State, to_ticks

WARM_ROBOTS, WARM_SECONDS = 12, 0.5
"""Warm plans are the replans of so many robots, each for so long from a perturbed start on."""

Timed = list[tuple[float, PlanStages]]
"""Wall time [s] and result of plans."""


def bench_plan(config: Config, plans: int = 300) -> dict[str, Any]:
    """Time of plans from `test` starts, one core: over the horizon and half of it, cold and warm.

    Returns:
        ``plan_ms`` (cold), ``warm_plan_ms``, and both again of half the horizon, as
        ``half_plan_ms`` and ``half_warm_plan_ms``: see `times_of`; ``iterations`` and so on: mean
        of ADMM's; ``nodes``, ``half_nodes``: centroidal and kinematic; ``plans``.
    """
    figures: dict[str, Any] = {"plans": len(load_starts()["test"][:plans])}
    for prefix, expert in (("", config.expert), ("half_", _half_horizon(config.expert))):
        horizon = replace(config, expert=expert)
        figures[prefix + "nodes"] = [expert.centroidal.nodes, expert.kinematic.nodes]
        for name, timed in (("", cold_plans(horizon, plans)), ("warm_", warm_plans(horizon))):
            iterations = [plan.centroidal.iterations for _, plan in timed]
            figures[f"{prefix}{name}plan_ms"] = times_of(timed)
            figures[f"{prefix}{name}iterations"] = float(np.mean(iterations))
    return figures


def cold_plans(config: Config, plans: int = 300) -> Timed:
    """A plan for each of the first `test` starts, after a few that warm up the machine."""
    planner = make_planner(solo12(config.robot), config)
    starts = load_starts()["test"][:plans]
    nothing = np.zeros((len(starts), 4, 3))  # a plan depends on q and v only
    states = State(starts.q, starts.v, nothing[:, 0], nothing, nothing[..., 0] > 0)

    def plan(row: int) -> tuple[float, PlanStages]:
        began = time.perf_counter()
        stages = planner.solve(states[row], int(starts.tick[row]), Command(*starts.command[row]))
        return time.perf_counter() - began, stages

    for row in range(min(10, len(starts))):
        plan(row)
    return [plan(row) for row in range(len(starts))]


def warm_plans(config: Config) -> Timed:
    """Replans of walking robots, each from the robot's plan before."""
    robot = solo12(config.robot)
    planner, starts = make_planner(robot, config), load_starts()["test"]
    simulator = make_simulator(robot, 1, config.simulation)
    timed: Timed = []
    previous: PlanStages | None = None

    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        nonlocal previous
        began = time.perf_counter()
        stages = planner.solve(state, tick, command, previous)
        if previous is not None and previous.motion.valid:
            timed.append((time.perf_counter() - began, stages))
        previous = stages
        return stages.motion

    expert = Expert(plan, config.expert.kp, config.expert.kd)
    for row in range(WARM_ROBOTS):
        previous = None
        rollout(simulator, robot, starts[row : row + 1], WARM_SECONDS, ExpertOnly(), expert)
    return timed


def times_of(timed: Timed) -> dict[str, Any]:
    """``median``, ``p99`` and ``stages`` (median of each) of the wall time of plans [ms]."""
    ms = np.array([seconds for seconds, _ in timed]) * 1e3
    stages = timed[0][1].seconds
    return {
        "median": float(np.median(ms)),
        "p99": float(np.percentile(ms, 99)),
        "stages": {
            stage: 1e3 * float(np.median([plan.seconds[stage] for _, plan in timed]))
            for stage in stages
        },
    }


def plan_table(figures: dict[str, Any]) -> str:
    """The figures of `bench_plan` as a table."""
    stages = list(figures["plan_ms"]["stages"])
    columns = "".join(f"{stage:>18}" for stage in stages)
    lines = [f"{'nodes':<7}{'start':<6}{'median':>8}{'p99':>8}{columns}{'ADMM':>7}   [ms]"]
    for prefix in ("", "half_"):
        nodes = "/".join(map(str, figures[prefix + "nodes"]))
        for start, name in (("cold", prefix), ("warm", prefix + "warm_")):
            times = figures[name + "plan_ms"]
            row = "".join(f"{times['stages'][stage]:>18.2f}" for stage in stages)
            lines.append(
                f"{nodes:<7}{start:<6}{times['median']:>8.2f}{times['p99']:>8.2f}{row}"
                f"{figures[name + 'iterations']:>7.1f}"
            )
    return "\n".join(lines)


def _half_horizon(expert: ExpertConfig) -> ExpertConfig:
    """Half the nodes, but no fewer than a plan needs."""
    kinematic = max(LAST_NODE + 1, expert.kinematic.nodes // 2)
    centroidal = max(kinematic, expert.centroidal.nodes // 2)
    return replace(
        expert,
        centroidal=replace(expert.centroidal, nodes=centroidal),
        kinematic=replace(expert.kinematic, nodes=kinematic),
    )


def bench_engine(config: Config, batch: int = 20, seconds: float = 2.0) -> dict[str, Any]:
    """Throughput of policy-driven robots, one core, watched by the monitor and recorded.

    The policy holds the nominal pose, whatever its hidden layers compute, so that the robots stand.
    The floor is the simulator's bare step under the same torques plus the network alone, timed
    right after.

    Returns:
        ``robot_ms_per_s``, ``floor_robot_ms_per_s``, ``ratio`` (our time over the
        floor's, 1 at best), ``batch``.
    """
    robot, policy = solo12(config.robot), standing_policy(config)
    stored = load_starts()["nominal"]
    starts = stored[np.arange(batch) % len(stored)]
    simulator = make_simulator(robot, batch, config.simulation)
    arbiter = SafetySwitch(SafetyMonitor(config.safety, 2.0, HandBack.SAFE_AND_BLOCKED))
    # Who would take over is not asked: the robots stand within the bounds.
    settled = rollout(simulator, robot, starts, 0.5, PolicyOnly(), policy, policy)
    starts = replace(starts, q=settled.q[:, -1], v=settled.v[:, -1])
    network = _network_alone(policy, batch)
    ours, floor = [], []
    for _ in range(5):
        began = time.perf_counter()
        record = rollout(simulator, robot, starts, seconds, arbiter, policy, policy)
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
        floor.append(physics + ticks * _seconds(network, 400))
    robot_ms = batch * seconds * TICKS_PER_SECOND
    mine, least = float(np.median(ours)), float(np.median(floor))
    return {
        "batch": batch,
        "robot_ms_per_s": robot_ms / mine,
        "floor_robot_ms_per_s": robot_ms / least,
        "ratio": mine / least,
    }


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


def _seconds(function: Callable[[], object], repeats: int) -> float:
    """Median time of a call [s]."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        times.append(time.perf_counter() - began)
    return float(np.median(times))


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
