"""What a whole run cost, from what is recorded of its iterations."""

from dataclasses import fields, replace

import numpy as np
import pytest

from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.collection_cost import collection_cost
from surefoot.runs.metrics import Best, StageRecord
from surefoot.runs.run_cost import StageSeconds, run_cost
from tests.fakes.comparisons import ten_rollouts
from tests.fakes.runs import collected_record, gate_record, trained_record, validated_record


def random_summary(rng, n: int, T: int, tail: int, drove: float, fell: float, query: bool = False):
    """n random episodes; ``drove`` is the expert's mean share."""
    failed = rng.random(n) < fell
    proper = np.where(failed, rng.integers(T // 2, T, n), T)
    counts = {field.name: rng.integers(0, 50, n) for field in fields(Summary)}
    chosen = {
        "query": np.full(n, query),
        "outcome": np.where(failed, int(Outcome.FELL), int(Outcome.SUCCESS)),
        "proper_ticks": proper,
        "ticks": proper + np.where(failed, 0, tail),
        "expert_ticks": np.round(proper * (drove if drove == 1 else rng.random(n) * drove)).astype(
            int
        ),
        "tilted_far": rng.random((n, 2)) < 0.3,
        "expert_drove_last": rng.random(n) < 0.5,
        "expert_drove_before": rng.random(n) < 0.5,
    }
    return Summary(**(counts | chosen))


@pytest.mark.parametrize("tail", [0, 1000])
@pytest.mark.parametrize("queries", [False, True])
@pytest.mark.parametrize("fell", [0.0, 0.4])
@pytest.mark.parametrize("early", [False, True])
def test_the_cost_of_a_run_is_pooled_exactly(tail, queries, fell, early):
    """From the records of the iterations alone, as if all rollouts had been in one.

    Those of early versions hold no time of the rollouts.
    """
    rng = np.random.default_rng(int(tail + 10 * fell) + queries)
    T = 5000
    records = []
    parts = []
    for i in range(5):
        tail = 0 if queries else tail
        drove = 1.0 if i == 0 or (i == 1 and queries) else 0.8**i
        part = random_summary(rng, 10 + i, T, 0 if i == 0 else tail, drove, fell)
        if queries and i > 0:
            part = join_summaries([part, random_summary(rng, 50, 1000, 0, 1.0, fell, query=True)])
        record = collected_record(i, seconds=2.0, **vars(collection_cost(part)))
        assert record.rollout_seconds == part.proper_ticks[~part.query].sum() / 1000
        assert record.rollout_seconds_with_tail == part.ticks[~part.query].sum() / 1000
        if early:
            record = replace(record, rollout_seconds=None, rollout_seconds_with_tail=None)
        records.append(record)
        parts.append(part)
    cost = run_cost(records, T / 1000)
    pooled = collection_cost(join_summaries(parts[1:]))
    assert cost.episodes == pooled.episodes
    assert cost.falls == pooled.falls
    assert cost.takeovers == pooled.takeovers
    assert cost.expert_share == pytest.approx(pooled.expert_share, rel=1e-9)
    assert cost.falls_per_robot_minute == pytest.approx(pooled.falls_per_robot_minute, rel=1e-9)
    assert cost.expert_share is not None and cost.expert_share < 0.99
    everything = collection_cost(join_summaries(parts))
    assert cost.expert_seconds == pytest.approx(everything.expert_seconds)
    assert cost.plans == everything.plans
    assert cost.frames_kept == everything.frames_kept
    assert cost.queries_failed == everything.queries_failed
    assert cost.recoveries_tilted == everything.recoveries_tilted
    assert cost.near_falls == everything.near_falls
    assert cost.near_falls_in_tail == everything.near_falls_in_tail
    assert cost.pretraining_episodes == 10
    assert cost.seconds == StageSeconds(collect=10.0, train=0, validate=0, gates=0)


def test_rollouts_that_the_expert_gave_up_on_count_as_long_as_they_lasted():
    """It drove alone and no robot fell, so that nothing but the time itself says how long."""
    rng = np.random.default_rng(0)
    part = random_summary(rng, 10, 5000, 0, 1.0, 0.0)
    short = np.where(np.arange(10) < 4, 100, 5000)
    outcome = np.where(np.arange(10) < 4, int(Outcome.DIVERGED), int(Outcome.SUCCESS))
    part = replace(part, ticks=short, proper_ticks=short, expert_ticks=short, outcome=outcome)
    asked = random_summary(rng, 20, 1000, 0, 1.0, 0.0, query=True)
    mixed = random_summary(rng, 10, 5000, 0, 0.5, 0.0)
    records = [
        collected_record(i, **vars(collection_cost(summary)))
        for i, summary in enumerate([part, join_summaries([part, asked]), mixed])
    ]
    share = run_cost(records, 5.0).expert_share
    assert share == pytest.approx((30.4 + mixed.expert_ticks.sum() / 1000) / 80.4, rel=1e-12)


def test_in_a_series_of_sizes_only_the_time_of_the_last_policy_counts():
    records: list[StageRecord] = [ten_rollouts(0)]
    for size in range(3):
        records.append(trained_record(size, seconds=10.0 * (size + 1)))
        records.append(validated_record(size, seconds=size + 1.0))
    records.append(Best(best_iteration=2))
    assert run_cost(records, 0.0).seconds == StageSeconds(100.0, 30.0, 3.0, 0)
    # In an iterative method each policy continues from the one before.
    records += [ten_rollouts(i) for i in (1, 2)]
    assert run_cost(records, 6.0).seconds == StageSeconds(300.0, 60.0, 6.0, 0)


def test_iterations_whose_budget_affords_no_rollout_have_trained_too():
    records: list[StageRecord] = [ten_rollouts(0)]
    nothing = vars(collection_cost(None))
    records += [collected_record(i, seconds=0.0, **nothing) for i in (1, 2)]
    records += [trained_record(i, seconds=10.0 * (i + 1)) for i in range(3)]
    cost = run_cost(records, 6.0)
    assert cost.episodes is None
    assert cost.seconds == StageSeconds(100.0, 60.0, 0, 0)


def test_the_training_of_gates_has_its_time():
    records: list[StageRecord] = [ten_rollouts(i) for i in (0, 1)]
    records.append(gate_record("classifier", 0, seconds=2.0))
    records.append(gate_record("history", 1, seconds=3.0))
    assert run_cost(records, 6.0).seconds == StageSeconds(200.0, 0, 0, 5.0)
