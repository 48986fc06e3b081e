"""Plans are timed by stage, over both horizons, cold and warm."""

from dataclasses import fields, replace

import pytest

import surefoot.bench.plan as plan_module
from surefoot.bench.plan import StageTimes, bench_plan, cold_plans, plan_table, times_of
from surefoot.config import Config
from surefoot.scenarios.starts import load_starts


@pytest.fixture(scope="module")
def times():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan_module, "WARM_UP_PLANS", 1)
        patch.setattr(plan_module, "WARM_ROBOTS", 1)
        return bench_plan(Config(), plans=5)


@pytest.mark.parametrize("name", ["", "warm_", "half_", "half_warm_"])
def test_each_kind_of_plan_is_timed_by_stage(times, name):
    measured = getattr(times, f"{name}plan_ms")
    assert 0 < measured.median <= measured.p99
    stages = [getattr(measured.stages, field.name) for field in fields(StageTimes)]
    assert min(stages) > 0
    assert max(stages) <= measured.median
    assert getattr(times, f"{name}iterations") >= 1


def test_half_the_horizon_is_half_the_nodes(times):
    assert times.plans == 5
    assert times.nodes == (20, 10)
    assert times.half_nodes == (10, 5)


def test_the_wall_time_of_a_plan_is_counted_once(monkeypatch):
    clock = iter(range(1000))
    monkeypatch.setattr(plan_module.time, "perf_counter", lambda: float(next(clock)))
    timed = cold_plans(Config(), 3)
    assert [plan.seconds for plan in timed] == [1.0, 1.0, 1.0]
    assert times_of(timed).median == 1e3


def test_plans_begin_in_the_states_that_are_given():
    stored = load_starts()
    few = replace(stored, grid=stored.grid | {"test": stored["test"][:2]})
    assert len(cold_plans(Config(), 5, few)) == 2


def test_the_table_has_a_row_for_each_kind(times):
    header, *rows = plan_table(times).splitlines()
    assert header.split()[:4] == ["nodes", "start", "median", "p99"]
    assert [row.split()[:2] for row in rows] == [
        ["20/10", "cold"],
        ["20/10", "warm"],
        ["10/5", "cold"],
        ["10/5", "warm"],
    ]
    assert rows[1].split()[2] == f"{times.warm_plan_ms.median:.2f}"
    assert rows[3].split()[-1] == f"{times.half_warm_iterations:.1f}"
    assert len({len(row) for row in rows}) == 1
