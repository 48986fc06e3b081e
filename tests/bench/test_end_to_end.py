"""Times of whole runs and evaluations add up, and so do their lower bounds."""

from dataclasses import replace

import pytest

import surefoot.bench.end_to_end as end_to_end
from surefoot.bench.end_to_end import (
    BareRates,
    BoundedTime,
    StageWork,
    bench_end_to_end,
    bench_evaluation,
    end_to_end_table,
    stage_time,
)
from surefoot.bench.train import TrainSpeed
from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    EvaluationConfig,
    ExpertData,
    PolicyConfig,
)
from surefoot.runs.run import open_run
from surefoot.workers import Workers
from tests.fakes.learning import FLOAT32

METHOD = BehaviorCloningConfig(ExpertData(2, 1, False, 0.1), epochs=2)
SHORT = replace(
    Config(),
    policy=PolicyConfig(hidden=(32, 32)),
    training=FLOAT32,
    method=METHOD,
    evaluation=EvaluationConfig(duration=0.1, episodes=20),
)


def test_a_lower_bound_is_the_sum_of_its_parts():
    work = [
        StageWork("collect", 10.0, robot_seconds=30.0, plans=200),
        StageWork("train", 5.0, steps=400),
        StageWork("collect", 20.0, robot_seconds=60.0, plans=400),
        StageWork("gate_history", 7.0, steps=100),
    ]
    rates = BareRates(plan_ms=2.0, robot_ms_per_s=45_000.0, step_ms=3.0)
    collect = stage_time(work, "collect", 2, rates)
    assert collect.seconds == 30.0
    # 90 s of robots take 2 s, 600 plans 1.2 s; two processes share them.
    assert collect.floor_seconds == pytest.approx(1.6)
    train = stage_time(work, "train", 2, rates)
    assert train.seconds == 5.0
    assert train.floor_seconds == pytest.approx(1.2)  # one process
    assert stage_time(work, "validate", 2, rates) == BoundedTime(0.0, 0.0)


def test_an_evaluation_is_compared_with_its_bare_steps(monkeypatch):
    monkeypatch.setattr(end_to_end, "bare_rate", lambda config: 50_000.0)
    speed = bench_evaluation(SHORT, Workers(1))
    assert (speed.episodes, speed.workers) == (20, 1)
    assert speed.floor_seconds == pytest.approx(20 * 100 / 50_000.0)
    assert speed.seconds > 0
    assert speed.ratio == pytest.approx(speed.seconds / speed.floor_seconds)


def test_a_run_is_measured_from_nothing_to_its_best_policy(monkeypatch, tmp_path):
    bare = TrainSpeed(256, 4.0, 6.0, 10.0, "float32", 1.0, 0.4, 3.0, 1.25)
    monkeypatch.setattr(end_to_end, "bare_rate", lambda config: 50_000.0)
    monkeypatch.setattr(end_to_end, "bench_train", lambda config: bare)
    folder = tmp_path / "run"
    speed = bench_end_to_end(SHORT, Workers(1), folder)
    run = open_run(folder)
    assert run.best_policy_path.exists()
    assert (speed.method, speed.workers) == ("behavior_cloning", 1)
    # The stages' own times do not exceed the whole.
    stages = (speed.collect, speed.train, speed.validate)
    assert all(stage.seconds > 0 and stage.floor_seconds > 0 for stage in stages)
    assert sum(stage.seconds for stage in stages) + speed.other_seconds == pytest.approx(
        speed.seconds
    )
    assert speed.other_seconds >= 0
    # 20 expert rollouts of 0.1 s with two plans each, and 20 of a policy.
    plans = 20 * 2 * speed.plan_ms / 1e3
    robots = 20 * 100 / speed.floor_robot_ms_per_s
    assert speed.collect.floor_seconds == pytest.approx(plans + robots)
    assert speed.validate.floor_seconds == pytest.approx(robots)
    assert 0 <= speed.select_successes <= 20


def test_the_table_has_a_row_for_each_stage():
    stage = BoundedTime(4.0, 2.0)
    speed = end_to_end.EndToEndSpeed(
        "dagger", 2, 13.0, stage, BoundedTime(3.0, 3.0), stage, 2.0, 2.0, 7.5e4, 3.0, 99
    )
    rows = [row.split() for row in end_to_end_table(speed).splitlines()]
    assert rows[1:] == [
        ["collect", "4.0", "2.0", "2.00"],
        ["train", "3.0", "3.0", "1.00"],
        ["validate", "4.0", "2.0", "2.00"],
        ["other", "2.0"],
        ["all", "13.0"],
    ]
