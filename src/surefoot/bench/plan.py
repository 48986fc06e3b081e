"""Wall time of an MPC plan by stage, over the horizon and half of it, cold and warm, on one core.

A cold plan starts from nothing, as all plans of a dataset do; a warm one starts from the robot's
previous plan. The times depend on the machine and the moment: trust the ratios. Next: `engine`.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from surefoot.config import Config, ExpertConfig
from surefoot.mpc.expert import make_expert, make_planner
from surefoot.mpc.planner import LAST_NODE, PlanStages
from surefoot.mpc.schedule import horizon
from surefoot.robots.load import load_robot
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.scenarios.starts import StartSet, starts_of
from surefoot.sim import make_simulator
from surefoot.types import Command, MotionPlan, State

WARM_ROBOTS = 12
"""Number of robots whose replans are the warm plans."""
WARM_SECONDS = 0.5
"""[s] that each of these robots walks, from a perturbed initial state on."""
WARM_UP_PLANS = 10
"""Plans that warm up the machine and are not counted."""


@dataclass(frozen=True)
class TimedPlan:
    """A plan and how long it took.

    Attributes:
        seconds: Wall time [s].
        stages: The plan, with its stages.
    """

    seconds: float
    stages: PlanStages


@dataclass(frozen=True)
class StageTimes:
    """Median wall time of each stage of a plan.

    Attributes:
        contacts: Time of the footholds [ms].
        centroidal: Time of the centroidal solve [ms].
        kinematics: Time of the kinematic solve [ms].
        inverse_dynamics: Time of the torques [ms].
    """

    contacts: float
    centroidal: float
    kinematics: float
    inverse_dynamics: float


@dataclass(frozen=True)
class Times:
    """Wall time of many plans.

    Attributes:
        median: Median of the whole plan [ms].
        p99: 99th percentile of the whole plan [ms].
        stages: Median of each stage [ms].
    """

    median: float
    p99: float
    stages: StageTimes


@dataclass(frozen=True)
class PlanTimes:
    """Wall time of plans from `test` initial states, on one core.

    Attributes:
        plans: Number of cold plans.
        nodes: Centroidal and kinematic nodes of the horizon.
        plan_ms: Times of cold plans.
        iterations: Mean number of ADMM iterations of cold plans.
        warm_plan_ms: Times of warm plans.
        warm_iterations: Mean number of ADMM iterations of warm plans.
        half_nodes: Centroidal and kinematic nodes of half the horizon.
        half_plan_ms: Times of cold plans over half the horizon.
        half_iterations: Mean number of ADMM iterations of cold plans over half the horizon.
        half_warm_plan_ms: Times of warm plans over half the horizon.
        half_warm_iterations: Mean number of ADMM iterations of warm plans over half the horizon.
    """

    plans: int
    nodes: tuple[int, int]
    plan_ms: Times
    iterations: float
    warm_plan_ms: Times
    warm_iterations: float
    half_nodes: tuple[int, int]
    half_plan_ms: Times
    half_iterations: float
    half_warm_plan_ms: Times
    half_warm_iterations: float


def bench_plan(config: Config, plans: int = 300) -> PlanTimes:
    """Measure plans over the horizon and over half of it, cold and warm.

    Args:
        config: Configuration of robot, gait and expert.
        plans: Number of cold plans, each from another `test` initial state.
    """
    half = replace(config, expert=_half_horizon(config))
    cold = cold_plans(config, plans)
    warm = warm_plans(config)
    half_cold = cold_plans(half, plans)
    half_warm = warm_plans(half)
    return PlanTimes(
        plans=len(cold),
        nodes=horizon(config.gait, config.expert),
        plan_ms=times_of(cold),
        iterations=_mean_iterations(cold),
        warm_plan_ms=times_of(warm),
        warm_iterations=_mean_iterations(warm),
        half_nodes=horizon(half.gait, half.expert),
        half_plan_ms=times_of(half_cold),
        half_iterations=_mean_iterations(half_cold),
        half_warm_plan_ms=times_of(half_warm),
        half_warm_iterations=_mean_iterations(half_warm),
    )


def cold_plans(config: Config, plans: int = 300, stored: StartSet | None = None) -> list[TimedPlan]:
    """Plan once from each of the first `test` initial states, after a few plans to warm up.

    Args:
        config: Configuration of robot, gait and expert.
        plans: Number of plans, at most one for each initial state.
        stored: The set of initial states; None takes that of the configuration.
    """
    planner = make_planner(load_robot(config.robot), config)
    starts = (stored or starts_of(config))["test"][:plans]
    nothing = np.zeros((len(starts), 4, 3))  # a plan depends on q and v only
    states = State(starts.q, starts.v, nothing[:, 0], nothing, nothing[..., 0] > 0)

    def plan(row: int) -> TimedPlan:
        began = time.perf_counter()
        stages = planner.solve(states[row], int(starts.tick[row]), Command(*starts.command[row]))
        return TimedPlan(time.perf_counter() - began, stages)

    for row in range(min(WARM_UP_PLANS, len(starts))):
        plan(row)
    return [plan(row) for row in range(len(starts))]


def warm_plans(config: Config) -> list[TimedPlan]:
    """Replan for walking robots, each plan starting from the same robot's previous plan.

    Args:
        config: Configuration of robot, gait, expert and simulator.
    """
    robot = load_robot(config.robot)
    planner = make_planner(robot, config)
    starts = starts_of(config)["test"]
    simulator = make_simulator(robot, 1, config.simulation)
    timed: list[TimedPlan] = []
    previous: PlanStages | None = None

    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        nonlocal previous
        began = time.perf_counter()
        stages = planner.solve(state, tick, command, previous)
        if previous is not None and previous.motion.valid:
            timed.append(TimedPlan(time.perf_counter() - began, stages))
        previous = stages
        return stages.motion

    expert = make_expert(robot, config, plan)
    for row in range(WARM_ROBOTS):
        previous = None
        episodes = Episodes(starts[row : row + 1], WARM_SECONDS)
        rollout(simulator, episodes, ExpertOnly(), expert)
    return timed


def times_of(timed: Sequence[TimedPlan]) -> Times:
    """Summarize the wall times of plans [ms]."""
    seconds = [plan.seconds for plan in timed]
    return Times(
        median=_median_ms(seconds),
        p99=1e3 * float(np.percentile(seconds, 99)),
        stages=StageTimes(
            contacts=_median_ms([plan.stages.seconds.contacts for plan in timed]),
            centroidal=_median_ms([plan.stages.seconds.centroidal for plan in timed]),
            kinematics=_median_ms([plan.stages.seconds.kinematics for plan in timed]),
            inverse_dynamics=_median_ms([plan.stages.seconds.inverse_dynamics for plan in timed]),
        ),
    )


def plan_table(times: PlanTimes) -> str:
    """The times of plans as a table for people."""
    lines = [
        f"{'nodes':<7}{'start':<6}{'median':>8}{'p99':>8}{'contacts':>18}{'centroidal':>18}"
        f"{'kinematics':>18}{'inverse_dynamics':>18}{'ADMM':>7}   [ms]",
        _plan_row(times.nodes, "cold", times.plan_ms, times.iterations),
        _plan_row(times.nodes, "warm", times.warm_plan_ms, times.warm_iterations),
        _plan_row(times.half_nodes, "cold", times.half_plan_ms, times.half_iterations),
        _plan_row(times.half_nodes, "warm", times.half_warm_plan_ms, times.half_warm_iterations),
    ]
    return "\n".join(lines)


def _plan_row(nodes: tuple[int, int], start: str, times: Times, iterations: float) -> str:
    """One row of `plan_table`."""
    stages = times.stages
    return (
        f"{f'{nodes[0]}/{nodes[1]}':<7}{start:<6}{times.median:>8.2f}{times.p99:>8.2f}"
        f"{stages.contacts:>18.2f}{stages.centroidal:>18.2f}{stages.kinematics:>18.2f}"
        f"{stages.inverse_dynamics:>18.2f}{iterations:>7.1f}"
    )


def _median_ms(seconds: Sequence[float]) -> float:
    """Median of wall times [s], in ms."""
    return 1e3 * float(np.median(seconds))


def _mean_iterations(timed: Sequence[TimedPlan]) -> float:
    """Mean number of ADMM iterations of plans."""
    return float(np.mean([plan.stages.centroidal.iterations for plan in timed]))


def _half_horizon(config: Config) -> ExpertConfig:
    """Half the nodes, but no fewer than a plan needs."""
    expert = config.expert
    whole = horizon(config.gait, expert)
    kinematic = max(LAST_NODE + 1, whole.kinematic // 2)
    centroidal = max(kinematic, whole.centroidal // 2)
    return replace(
        expert,
        centroidal=replace(expert.centroidal, nodes=centroidal),
        kinematic=replace(expert.kinematic, nodes=kinematic),
    )
