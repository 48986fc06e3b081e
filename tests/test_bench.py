"""The benchmarks measure what they name, and give the keys they promise."""

from dataclasses import replace

import pytest

from surefoot.bench import bench_engine, bench_plan, bench_train, plan_table
from surefoot.config import Config, PolicyConfig

SMALL = replace(Config(), policy=PolicyConfig(hidden=(32, 32)))


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
    ],
)
def test_figures_stand_beside_their_floor(measure, ours, floor):
    figures = measure()
    least = figures[floor or "floor_robot_ms_per_s"]
    ratio = figures[ours] / least if floor else least / figures[ours]
    assert figures["ratio"] == pytest.approx(ratio)
    assert figures[ours] > 0
    assert least > 0
