"""Time of a plan by stage, over the horizon and half of it, cold and warm, on one core.

Figures of one machine and moment: trust the ratios.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from surefoot.config import Config, ExpertConfig
from surefoot.mpc.expert import Expert, make_planner
from surefoot.mpc.planner import LAST_NODE, PlanStages
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import rollout
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from surefoot.types import Command, MotionPlan, State

WARM_ROBOTS, WARM_SECONDS = 12, 0.5
"""Warm plans are the replans of so many robots, each for so long from a perturbed start on."""

Timed = list[tuple[float, PlanStages]]
"""Wall time [s] and result of plans."""


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


def times_of(timed: Timed) -> Times:
    """Summarize the wall times of plans [ms]."""
    ms = np.array([seconds for seconds, _ in timed]) * 1e3
    return Times(
        median=float(np.median(ms)),
        p99=float(np.percentile(ms, 99)),
        stages=StageTimes(
            contacts=_median_ms(timed, "contacts"),
            centroidal=_median_ms(timed, "centroidal"),
            kinematics=_median_ms(timed, "kinematics"),
            inverse_dynamics=_median_ms(timed, "inverse_dynamics"),
        ),
    )


def _median_ms(timed: Timed, stage: str) -> float:
    """Median wall time of one stage of plans [ms]."""
    return 1e3 * float(np.median([plan.seconds[stage] for _, plan in timed]))


def plan_table(figures: dict[str, Any]) -> str:
    """The figures of `bench_plan` as a table."""
    stages = [field.name for field in fields(StageTimes)]
    columns = "".join(f"{stage:>18}" for stage in stages)
    lines = [f"{'nodes':<7}{'start':<6}{'median':>8}{'p99':>8}{columns}{'ADMM':>7}   [ms]"]
    for prefix in ("", "half_"):
        nodes = "/".join(map(str, figures[prefix + "nodes"]))
        for start, name in (("cold", prefix), ("warm", prefix + "warm_")):
            times = figures[name + "plan_ms"]
            row = "".join(f"{getattr(times.stages, stage):>18.2f}" for stage in stages)
            lines.append(
                f"{nodes:<7}{start:<6}{times.median:>8.2f}{times.p99:>8.2f}{row}"
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
