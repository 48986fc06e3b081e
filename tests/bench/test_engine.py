"""The engine's throughput and its lower bound, on a clock that the test moves."""

from dataclasses import replace
from typing import Any

import pytest

import surefoot.bench.engine as engine_module
from surefoot.bench.engine import bare_rate, bench_engine, rollout_times
from surefoot.config import Config, PolicyConfig, RobotConfig
from surefoot.mpc.expert import make_planner
from surefoot.rollouts.engine import rollout
from surefoot.sim import make_simulator

SMALL = Config(policy=PolicyConfig(hidden=(32, 32)))
STEP = 1e-3
"""[s] that a step of the simulator takes on the clock."""
NETWORK = 5e-4
"""[s] that the bare network takes on the clock."""
PLAN = 2e-3
"""[s] that a plan takes on the clock."""
OVERHEAD = 0.05
"""[s] that a rollout takes besides its steps on the clock."""


@pytest.fixture
def clock(monkeypatch):
    """A clock on which steps, plans, the network and rollouts take what the constants say."""
    now = [0.0]
    monkeypatch.setattr(engine_module.time, "perf_counter", lambda: now[0])

    def make_slow_simulator(*args):
        simulator = make_simulator(*args)
        step = simulator.step

        def slow_step(*torque_and_mask):
            now[0] += STEP
            step(*torque_and_mask)

        monkeypatch.setattr(simulator, "step", slow_step)
        return simulator

    def make_slow_planner(*args):
        planner = make_planner(*args)
        plan = planner.plan

        def slow_plan(*args):
            now[0] += PLAN
            return plan(*args)

        monkeypatch.setattr(planner, "plan", slow_plan)
        return planner

    def slow_rollout(*args):
        now[0] += OVERHEAD
        return rollout(*args)

    monkeypatch.setattr(engine_module, "make_simulator", make_slow_simulator)
    monkeypatch.setattr(engine_module, "make_planner", make_slow_planner)
    monkeypatch.setattr(engine_module, "rollout", slow_rollout)
    monkeypatch.setattr(engine_module, "median_seconds", lambda function, repeats: NETWORK)
    monkeypatch.setattr(engine_module, "_two_processes", lambda config, batch: 1.5)
    return now


def test_the_ratio_is_the_overhead_of_the_engine(clock):
    speed = bench_engine(SMALL, batch=5, seconds=0.1)
    whole = 100 * STEP + OVERHEAD
    lower_bound = 100 * (STEP + NETWORK)
    assert speed.batch == 5
    assert speed.robot_ms_per_s == pytest.approx(500 / whole)
    assert speed.floor_robot_ms_per_s == pytest.approx(500 / lower_bound)
    assert speed.ratio == pytest.approx(whole / lower_bound)
    assert speed.two_processes == 1.5
    assert bare_rate(SMALL, 5, 0.1) == pytest.approx(500 / lower_bound)


def test_the_share_of_plans_is_that_of_a_second_of_the_expert(clock):
    speed = bench_engine(SMALL, batch=5, seconds=0.1)
    plans = 5 * 20 * PLAN
    steps = 1000 * STEP
    assert speed.plan_share == pytest.approx(plans / (plans + steps + OVERHEAD))
    assert speed.floor_plan_share == pytest.approx(plans / (plans + steps))


@pytest.mark.parametrize("model", ["solo12", "go2", "anymal_c"])
def test_every_robot_stands_in_a_benchmark(model):
    """With the gains of its policies, Go2 sags below its safety bounds after 0.7 s."""
    assert rollout_times(replace(SMALL, robot=RobotConfig(model)), 2, 2.0).stood


def test_a_robot_that_falls_is_no_benchmark_but_has_a_rate(monkeypatch):
    standing = engine_module.standing_policy

    def limp_policy(config):
        policy = standing(config)
        last: Any = policy.network.linear[-1]
        last.bias.data.zero_()
        return policy

    monkeypatch.setattr(engine_module, "standing_policy", limp_policy)
    with pytest.raises(RuntimeError, match="did not stand"):
        bare_rate(SMALL, 5, 1.0)
    times = rollout_times(SMALL, 5, 1.0)
    assert not times.stood
    assert 0.0 < times.robot_seconds <= 5.0


def test_the_rate_of_a_process_is_that_of_its_rollout(clock):
    rate = engine_module._standing_rate((SMALL, 5, 0.1))
    assert rate == pytest.approx(500 / (100 * STEP + OVERHEAD))


def test_two_processes_are_compared_with_one(monkeypatch):
    rates = {"warming up": [1.0] * 4, "one process": [100.0], "two processes": [90.0, 80.0]}
    asked = {}

    def run_chunks(function, chunks, workers, title):
        assert function is engine_module._standing_rate
        asked[title] = (len(chunks), workers.count)
        return rates[title]

    monkeypatch.setattr(engine_module, "map_chunks", run_chunks)
    assert engine_module._two_processes(SMALL, 5, 1.0) == pytest.approx(1.7)
    assert asked == {"warming up": (4, 2), "one process": (1, 1), "two processes": (2, 2)}
