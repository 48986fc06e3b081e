"""The work of runs with a budget, and of trainings of a number of steps."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from surefoot.config import METHODS, BudgetConfig, ExpertData
from surefoot.config.presets import preset
from surefoot.config.single_gaits import each_gait
from surefoot.config.study import Measurement, StudyConfig, Technique
from surefoot.mpc.gaits import with_gaits
from surefoot.study import estimate as module
from surefoot.study.cells import Cell, StudyJob, jobs_of
from surefoot.study.estimate import (
    Estimate,
    Rates,
    estimate_study,
    expert_work,
    first_work,
    read_estimate,
    training_work,
)
from surefoot.study.state import JobState, JobStatus


@pytest.mark.parametrize("name", METHODS)
def test_a_budget_limits_the_solves_of_a_run(name):
    config = preset(name)
    limited = replace(config, budget=BudgetConfig(20.0))
    assert training_work(config).plans > 5000
    assert training_work(limited).plans == pytest.approx(400)
    first = 400 if name == "behavior_cloning" else 200
    assert first_work(limited).plans == pytest.approx(first)
    assert training_work(limited).robot_seconds < training_work(config).robot_seconds
    roomy = replace(config, budget=BudgetConfig(1e6))
    assert training_work(roomy) == training_work(config)


@pytest.mark.parametrize("name", METHODS)
def test_steps_are_those_of_all_trainings(name):
    config = preset(name)
    method = replace(config.method, steps=100)
    if name == "behavior_cloning":
        method = replace(method, frames=(1_000, 2_000))
        assert training_work(replace(config, method=method)).steps == 300
    else:
        method = replace(method, pretraining_steps=50, steps_before_last=None)
        assert training_work(replace(config, method=method)).steps == 1050
        method = replace(method, steps_before_last=10)
        assert training_work(replace(config, method=method)).steps == 50 + 9 * 10 + 100


def test_cells_of_one_gait_and_of_several_are_measured_each(monkeypatch):
    techniques = (Technique("one", "1", "dagger"), Technique("two", "2", "dagger"))
    several = with_gaits(preset("dagger"), ["trot", "bound"])
    configs = {"one": each_gait(several)[0], "two": several}
    monkeypatch.setattr(module, "cell_config", lambda study, cell: configs[cell.technique])
    monkeypatch.setattr(module, "completed", lambda config: config)
    measured = []

    def measure(config):
        measured.append(len(config.gaits))
        return Rates(1.0, 1.0, 1.0)

    monkeypatch.setattr(module, "measure_rates", measure)
    study = StudyConfig("mine", "My study", techniques, (Measurement("test", "test"),))
    estimate_study(study, jobs_of(study))
    assert sorted(measured) == [1, 2]


def test_cells_of_other_batches_are_measured_each(monkeypatch):
    """The time of a step depends on its batch, and that of a rollout on its robots."""
    techniques = [Technique(name, name, "dagger") for name in ("one", "two", "three", "again")]
    plain = preset("dagger")
    configs = {
        "one": plain,
        "two": replace(plain, training=replace(plain.training, batch=64)),
        "three": replace(plain, chunk=3),
        "again": plain,
    }
    monkeypatch.setattr(module, "cell_config", lambda study, cell: configs[cell.technique])
    monkeypatch.setattr(module, "completed", lambda config: config)
    measured = []

    def measure(config):
        measured.append((config.training.batch, config.chunk))
        return Rates(1.0, 1.0, 1.0)

    monkeypatch.setattr(module, "measure_rates", measure)
    study = StudyConfig("mine", "My study", tuple(techniques), (Measurement("test", "test"),))
    estimate_study(study, jobs_of(study))
    usual = plain.training.batch
    assert sorted(measured) == sorted([(usual, plain.chunk), (64, plain.chunk), (usual, 3)])


def test_an_estimate_of_other_jobs_is_not_taken(monkeypatch, tmp_path):
    rates = SimpleNamespace(seconds=lambda work: 1.0)
    monkeypatch.setattr(module, "completed", lambda config: config)
    monkeypatch.setattr(module, "measure_rates", lambda config: rates)
    study = StudyConfig(
        "mine", "My study", (Technique("one", "1", "dagger"),), (Measurement("test", "test"),)
    )
    jobs = jobs_of(study)
    kept = estimate_study(study, jobs[1:], tmp_path)
    assert read_estimate(tmp_path, jobs[1:]) == kept
    assert read_estimate(tmp_path, jobs) is None
    assert set(estimate_study(study, jobs, tmp_path).seconds) == {job.name for job in jobs}


def test_what_else_the_machine_computes_does_not_count(monkeypatch):
    """Each of the measurements has a quarter of a core: the rates are those of a whole one."""
    clock = {"wall": 0.0, "processor": 0.0}

    def measures(result):
        def measure(*_: object):
            clock["wall"] += 4.0
            clock["processor"] += 1.0
            return result

        return measure

    config = preset("dagger")
    times = SimpleNamespace(rollout=2.0 * config.chunk, robot_seconds=0.5 * config.chunk)
    monkeypatch.setattr(module.time, "perf_counter", lambda: clock["wall"])
    monkeypatch.setattr(module.time, "process_time", lambda: clock["processor"])
    monkeypatch.setattr(module, "chosen_step_seconds", measures(0.004))
    monkeypatch.setattr(module, "rollout_times", measures(times))
    monkeypatch.setattr(module, "cold_plans", measures(None))
    monkeypatch.setattr(module, "times_of", lambda _: SimpleNamespace(median=8.0))
    assert module.measure_rates(config) == Rates(plan=0.002, robot_second=1.0, step=0.001)


def test_expert_data_begins_at_all_phases_of_the_gait():
    data = ExpertData(velocities=2, perturbations=3, nominal=False, duration=1.0)
    config = preset("dagger")
    assert expert_work(config, data).robot_seconds == 2 * 3 * 10
    assert expert_work(with_gaits(config, ["walk"]), data).robot_seconds == 2 * 3 * 20


def status(name, state: JobState = "ready", seconds=0.0, processors=(), needs=()):
    """How far a job is."""
    job = StudyJob(name, "train", Cell("one", "", 0, 0, name), needs=needs)
    return JobStatus(job, state, seconds, processors)


def test_what_is_left_is_scaled_by_the_jobs_that_this_processor_did():
    estimate = Estimate({"a": 10.0, "b": 10.0, "c": 10.0}, "mine")
    rest = status("c", seconds=5.0)
    assert estimate.left([status("a"), status("b"), status("c")], 1) == 30
    mine = status("a", "done", 30.0, ("mine",))
    fast = status("b", "done", 1.0, ("faster",))
    both = status("b", "done", 1.0, ("faster", "mine"))
    assert estimate.left([mine, fast, rest], 1) == 25
    assert estimate.left([mine, both, rest], 1) == 25
    assert estimate.left([fast, status("a", "done", 1.0), rest], 1) == 5


def test_what_is_left_takes_as_long_as_the_jobs_that_wait_for_each_other():
    estimate = Estimate({"train": 50.0, "measure": 10.0, "other": 5.0}, "mine")
    chain = [status("train"), status("measure", "waiting", needs=("train",)), status("other")]
    assert estimate.left(chain, 1) == 65
    assert estimate.left(chain, 2) == estimate.left(chain, 9) == 60


def test_a_running_job_keeps_its_worker_while_the_others_wait():
    estimate = Estimate({"a": 10.0, "b": 10.0, "long": 50.0}, "mine")
    assert estimate.left([status("a"), status("b"), status("long")], 2) == 60
    assert estimate.left([status("a"), status("b"), status("long", "running")], 2) == 50
