"""Values of runs: the paper's failure count, only finished runs, seeds with several trainings."""

from dataclasses import replace

import pytest

from surefoot.runs.metrics import Collected
from surefoot.study.paper_runs import early_half, first_iteration, late_half, second_on, third_on
from surefoot.study.results import read_results
from surefoot.study.run_values import (
    best_value,
    dataset_frames,
    direction_impulses,
    early_error,
    expert_share,
    failed,
    falls_per_minute,
    fell,
    is_trained,
    iterations_collected,
    largest_rise,
    mean_impulse,
    measured_robustness,
    paper_failures,
    rollouts,
    runs_of,
    share_with_tail,
    shares_of,
    solves,
    solves_per_second,
    successes,
    tracking_error,
    unpushed,
)
from tests.fakes.runs import collected_record
from tests.fakes.studies import FakeRun, study_results
from tests.fakes.study_folders import paper_like, write_study

RUN = FakeRun(
    falls=(4, 2, 0, 2),
    falls_expert_driving=(1, 2, 0, 0),
    diverged=(0, 1, 0, 0),
    share=(0.4, 0.1, 0.2, 0.1),
    plans=(1000, 2000, 3000, 2000),
    frames=500_000,
    successes=(50, 60, 70, 80, 90),
    errors=((0.5, 1, 1), (0.4, 1, 1), (0.2, 1, 1), (0.1, 1, 1), (0.05, 2, 3)),
    impulse=(1.0, 2.0),
)


def cell_of(run):
    """The cell of a run of LocoDAGGER."""
    return study_results({"loco_dagger-0.5": [run]}).cells[0]


def test_a_rollout_of_loco_dagger_fails_if_it_falls_under_the_policy_or_the_mpc_diverges():
    record = collected_record(1, falls=5, falls_expert_driving=2, diverged=1)
    assert paper_failures(record, "loco_dagger") == 4


def test_a_rollout_of_loco_safe_dagger_fails_if_the_mpc_diverges():
    record = collected_record(1, falls=5, falls_expert_driving=2, diverged=1)
    assert paper_failures(record, "loco_safe_dagger") == 1


def test_the_gate_of_safe_dagger_is_counted_like_that_of_loco_safe_dagger():
    record = collected_record(1, falls=5, falls_expert_driving=2, diverged=1)
    assert paper_failures(record, "safe_dagger") == 1


def test_failures_and_falls_of_some_iterations_are_added_up():
    cell = cell_of(RUN)
    assert failed(iterations_collected(cell), "loco_dagger") == (3 + 1 + 0 + 2, 160)
    assert failed(third_on(cell), "loco_dagger") == (2, 80)
    assert fell(second_on(cell)) == (4, 120)
    assert fell(first_iteration(cell)) == (4, 40)


def test_the_pre_training_is_no_iteration():
    cell = cell_of(RUN)
    assert [record.iteration for record in iterations_collected(cell)] == [1, 2, 3, 4]
    assert rollouts(cell) == 160
    assert solves(cell) == 8000
    assert solves_per_second(cell) == pytest.approx(8000 / 1600)
    assert falls_per_minute(cell) == pytest.approx(8 / (4 * 440 / 60))
    assert dataset_frames(cell) == 500_000


def test_the_share_of_the_expert_and_its_largest_rise():
    cell = cell_of(RUN)
    assert expert_share(iterations_collected(cell)) == pytest.approx(0.2)
    assert expert_share(early_half(cell)) == pytest.approx(0.25)
    assert expert_share(late_half(cell)) == pytest.approx(0.15)
    assert largest_rise(cell) == pytest.approx(0.1)
    assert share_with_tail(cell) == pytest.approx((0.2 + 0.1) / 1.1)
    falling = cell_of(FakeRun(share=(1.0, 0.5, 0.25)))
    assert largest_rise(falling) == pytest.approx(-0.25)


def test_an_iteration_that_could_afford_no_rollout_has_no_share_of_the_expert():
    cell = cell_of(FakeRun(share=(0.4, 0.0, 0.2), plans=(5, 0, 5)))
    empty = iterations_collected(cell)[1]
    none = replace(empty, episodes=0, expert_share=0.0, expert_share_with_tail=0.0)
    metrics = tuple(none if record is empty else record for record in cell.metrics)
    cell = replace(cell, metrics=metrics)
    records = iterations_collected(cell)
    assert [record.episodes > 0 for record in records] == [True, False, True]
    assert expert_share(records) == pytest.approx(0.3)
    assert expert_share(records[1:2]) is None
    assert share_with_tail(cell) == pytest.approx((0.3 + 0.1) / 1.1)
    assert largest_rise(cell) == pytest.approx(-0.2)


def test_robustness_and_errors_are_those_of_a_policy():
    cell = cell_of(RUN)
    assert successes(measured_robustness(cell, "test", 0)) == (50, 100)
    assert successes(measured_robustness(cell, "test", -1)) == (90, 100)
    assert tracking_error(measured_robustness(cell, "test", -1), 2) == 3
    assert early_error(cell, "test", 0) == pytest.approx(0.3)


def test_nothing_is_counted_in_no_time_at_all():
    cell = cell_of(RUN)
    metrics = tuple(
        replace(each, rollout_seconds=0.0, rollout_seconds_with_tail=0.0)
        if isinstance(each, Collected)
        else each
        for each in cell.metrics
    )
    assert falls_per_minute(replace(cell, metrics=metrics)) is None
    assert solves_per_second(replace(cell, metrics=metrics)) is None


def test_impulses_are_those_of_the_best_policy():
    cell = cell_of(RUN)
    assert mean_impulse(cell, "push") == 1.5
    assert direction_impulses(cell, "push") == (1.0, 2.0)
    assert direction_impulses(cell, "nothing") is None
    assert unpushed(cell, "push") == (2, 2)
    assert unpushed(cell, "nothing") is None


def test_nothing_is_taken_of_a_run_that_is_not_finished():
    cell = cell_of(FakeRun(falls=(1, 2), finished=False))
    assert not is_trained(cell)
    assert iterations_collected(cell) == []
    assert measured_robustness(cell, "test", -1) is None
    for value_of in (solves, solves_per_second, falls_per_minute, dataset_frames, rollouts):
        assert value_of(cell) is None
    assert expert_share(iterations_collected(cell)) is None
    assert mean_impulse(cell, "push") is None
    assert best_value([cell], "test", "robustness") is None
    assert runs_of([cell], solves) is None
    assert shares_of([cell], lambda each: fell(iterations_collected(each))) is None


def test_a_value_of_the_best_policy_by_measure():
    cells = study_results({"loco_dagger-0.5": [RUN, FakeRun()]}).cells
    success = best_value(cells, "test", "robustness")
    assert success is not None
    assert (success.values, success.rollouts) == ((0.9, 0.95), (100, 100))
    impulse = best_value(cells, "push", "impulse")
    assert impulse is not None
    assert impulse.values == (1.5, 2.0)


def test_trainings_of_a_seed_have_the_mean_share_and_the_rollouts_of_one(tmp_path):
    study = paper_like(1)
    cloning = replace(study.technique("behavior_cloning"), trainings=2)
    study = replace(study, techniques=(cloning,), comparisons=(), seeds=(0,), claims="none")
    results = read_results(write_study(tmp_path / "two", study, iterations=1))
    counts = iter([(1, 10), (20, 30)])
    runs = shares_of(results.cells, lambda cell: next(counts))
    assert runs is not None
    assert runs.values == pytest.approx([0.5 * (1 / 10 + 20 / 30)])
    assert runs.rollouts == (10,)
