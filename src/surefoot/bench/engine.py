"""Speed of engine and training, each beside what it could be at best, measured in the same run.

The engine beside bare physics plus the bare network; a training step beside PyTorch's eager one and
its matrix products. Figures of one machine and moment: trust the ratios. See also ``bench_plan``
and ``bench_run``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from surefoot.config import Config, TrainingConfig
from surefoot.learning.dataset import Frames
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.policy import Policy, PolicyNetwork
from surefoot.learning.train import fit, has_bfloat16
from surefoot.mpc.expert import Expert, make_planner
from surefoot.robots.model import solo12, standing
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly, SafetySwitch
from surefoot.rollouts.engine import rollout
from surefoot.safety.gates import Bounds, Outcome, SafetyMonitor
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
    rollout(simulator, robot, starts, seconds, PolicyOnly(), policy, policy)
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
    rollout(simulator, robot, starts, 0.1, ExpertOnly(), expert)
    spent, began = 0.0, time.perf_counter()
    rollout(simulator, robot, starts, 1.0, ExpertOnly(), expert)
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


def bench_train(config: Config, steps: int = 100) -> dict[str, Any]:
    """Time of a training step, one thread, beside PyTorch's eager float32 and its matrix products.

    Returns:
        ``step_ms`` in the configured precision; ``eager_step_ms``, the same step in float32, and
        ``ratio_to_eager``; ``floor_step_ms``, the products of a step in the configured precision,
        forward and backward, and ``ratio`` to it; ``batch``, ``precision``.
    """
    batch, period = config.training.batch, to_ticks(config.gait.period)
    training = replace(config.training, validation=0.0, threads=1, device="cpu")
    frames = _random_frames(steps * batch)
    network = PolicyNetwork(config.policy)
    short = training.precision == "bfloat16" and has_bfloat16(torch.device("cpu"))

    def step_of(training: TrainingConfig) -> float:
        # The second epoch is steps only; before the first, inputs and labels are derived.
        ends: list[float] = []
        progress = lambda *_: ends.append(time.perf_counter())  # noqa: E731
        fit(network, frames, training, config.policy, 2, 0, period, progress)
        return (ends[1] - ends[0]) / steps

    rounds = [
        (
            step_of(training),
            step_of(replace(training, precision="float32")),
            # Backward: one product for the inputs, one for the weights.
            3 * _seconds(_network_products(network, batch, short), 30),
        )
        for _ in range(3)
    ]
    step, eager, least = (1e3 * float(np.median(times)) for times in zip(*rounds, strict=True))
    return {
        "batch": batch,
        "precision": "bfloat16" if short else "float32",
        "step_ms": step,
        "eager_step_ms": eager,
        "ratio_to_eager": step / eager,
        "floor_step_ms": least,
        "ratio": step / least,
    }


def _network_products(network: PolicyNetwork, batch: int, short: bool) -> Callable[[], None]:
    """The matrix products of one forward pass and nothing else, on one thread."""
    kind = torch.bfloat16 if short else torch.float32
    weights = [weight.to(kind) for weight, _ in network.folded()]
    inputs = [torch.randn(batch, size, dtype=kind) for size in (INPUT_SIZE, *network.hidden)]
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
