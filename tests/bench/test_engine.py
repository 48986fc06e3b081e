"""The benchmarks measure what they name, and give the keys they promise."""

from dataclasses import replace

import pytest

from surefoot.bench.end_to_end import STAGES, bench_end_to_end, bench_evaluation, bench_table
from surefoot.bench.engine import bench_engine
from surefoot.bench.plan import bench_plan, plan_table
from surefoot.bench.train import bench_train
from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    EvaluationConfig,
    ExpertData,
    PolicyConfig,
)
from surefoot.workers import Workers

METHOD = BehaviorCloningConfig(ExpertData(2, 1, False, 0.1), epochs=2)
SMALL = replace(Config(), policy=PolicyConfig(hidden=(32, 32)))
SHORT = replace(SMALL, method=METHOD, evaluation=EvaluationConfig(duration=0.1, episodes=20))


def test_a_plan_is_timed_by_stage_horizon_and_start():
    figures = bench_plan(Config(), plans=5)
    assert figures["plans"] == 5
    assert figures["nodes"] == [20, 10]
    assert figures["half_nodes"] == [10, 5]
    for name in ("", "warm_", "half_", "half_warm_"):
        times = figures[name + "plan_ms"]
        assert times.keys() == {"median", "p99", "stages"}
        assert 0 < times["median"] <= times["p99"]
        stages = {"contacts", "centroidal", "kinematics", "inverse_dynamics"}
        assert times["stages"].keys() == stages
        assert all(value > 0 for value in times["stages"].values())
        assert figures[name + "iterations"] >= 1
    header, *rows = plan_table(figures).splitlines()
    assert [row.split()[:2] for row in rows] == [
        ["20/10", "cold"],
        ["20/10", "warm"],
        ["10/5", "cold"],
        ["10/5", "warm"],
    ]
    assert len({len(row) for row in rows}) == 1
    assert header.split()[:4] == ["nodes", "start", "median", "p99"]


@pytest.mark.parametrize(
    ("measure", "ours", "floor"),
    [
        (lambda: bench_engine(SMALL, batch=5, seconds=0.1), "robot_ms_per_s", None),
        (lambda: bench_train(SMALL, steps=5), "step_ms", "floor_step_ms"),
        (lambda: bench_evaluation(SHORT, Workers(2)), "seconds", "floor_seconds"),
    ],
)
def test_figures_stand_beside_their_floor(measure, ours, floor):
    figures = measure()
    least = figures[floor or "floor_robot_ms_per_s"]
    ratio = figures[ours] / least if floor else least / figures[ours]
    assert figures["ratio"] == pytest.approx(ratio)
    assert figures[ours] > 0
    assert least > 0


def test_engine_tells_processes_and_the_share_of_plans():
    figures = bench_engine(SMALL, batch=5, seconds=0.1)
    assert 0.5 < figures["two_processes"] < 4.0
    assert 0.0 < figures["plan_share"] < 1.0
    assert 0.0 < figures["floor_plan_share"] < 1.0


def test_end_to_end_accounts_for_the_whole_run():
    figures = bench_end_to_end(SHORT, Workers(2))
    spent = sum(figures[stage]["seconds"] for stage in STAGES) + figures["other_seconds"]
    assert spent == pytest.approx(figures["seconds"])
    assert all(figures[stage]["floor_seconds"] > 0 for stage in STAGES)
    assert figures["method"] == "behavior_cloning"
    rows = bench_table("end_to_end", figures).splitlines()
    assert [row.split()[0] for row in rows] == ["stage", *STAGES, "other", "all"]
