"""What a job measures of a policy: how far it imitates the expert."""

import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

import surefoot.study.folder as folder
import surefoot.study.work as work
from surefoot.config import Config
from surefoot.config.json_io import from_json, to_json
from surefoot.config.studies import named_study
from surefoot.config.study import Measurement, Setting, Technique
from surefoot.evaluation.imitation import ImitationError
from surefoot.study.cells import jobs_of, measured_options, measurements_of
from surefoot.study.folder import PolicyTest, save_setup

ERROR = ImitationError("starts", "28d8", 60, 4800, 61.5, 210.0, None)


def test_the_imitation_error_of_a_policy_is_kept_beside_its_hash(tmp_path, monkeypatch):
    path = tmp_path / "007.safetensors"
    path.write_bytes(b"a policy")
    asked = []

    def measured(config, policy, workers):
        asked.append((config, policy, workers.count))
        return ERROR

    monkeypatch.setattr(work, "imitation_error", measured)
    policy = work.MeasuredPolicy(7, 12_000, path)
    test = work._measure(Config(), policy, Measurement("imitation", "i", "imitation"))
    assert asked == [(Config(), path, 1)]
    assert test.imitation == ERROR
    assert (test.iteration, test.frames, test.robustness, test.pushes) == (7, 12_000, None, None)
    assert test.sha256 is not None and len(test.sha256) == 64
    tests = folder.Tests("imitation", (test, replace(test, iteration=8)), True)
    assert from_json(folder.Tests, to_json(tests)) == tests


def test_results_from_before_the_imitation_error_are_read():
    values = to_json(PolicyTest(0, None, None))
    del values["imitation"]
    assert from_json(PolicyTest, values) == PolicyTest(0, None, None)


def test_the_expert_does_not_deviate_from_itself():
    with pytest.raises(AssertionError):
        work._measure(Config(), work.MeasuredPolicy(), Measurement("i", "i", "imitation"))


def test_the_same_expert_has_the_same_results_in_another_setting(tmp_path):
    settings = (Setting("few", "few"), Setting("many", "many", {"training.weight_decay": 0.3}))
    study = replace(named_study("smoke"), settings=settings, comparisons=())
    first, second = [job for job in jobs_of(study) if job.cell.technique == "expert"]
    for name in measurements_of(study, first.cell):
        asked = measured_options(study, first.cell, name)
        measured = folder.Tests(name, (PolicyTest(0, None, None),), True, asked)
        folder.save_tests(tmp_path, first.cell, measured)
        assert folder.read_tests(tmp_path, study, second.cell, name) is None
    save_setup(tmp_path, folder.StudySetup(study, None, "1.0", "float32"))
    assert work.do_job(tmp_path, second.name)
    for name in measurements_of(study, first.cell):
        measured = folder.read_tests(tmp_path, study, first.cell, name)
        copied = folder.read_tests(tmp_path, study, second.cell, name)
        assert measured is not None and copied is not None and copied.finished
        assert copied.policies == measured.policies
        assert copied.options == measured_options(study, second.cell, name)


def test_what_was_measured_of_another_policy_is_measured_again(tmp_path, monkeypatch, caplog):
    """A run that was lost and made again, on another processor, has other policies."""
    study = replace(named_study("smoke"), settings=(Setting("all", "all"),))
    setup = folder.StudySetup(study, None, "0", "float32")
    job = next(job for job in jobs_of(study) if job.kind == "measure" and job.needs)
    path = tmp_path / "policy"
    path.write_bytes(b"the policy")
    monkeypatch.setattr(work, "_policies_of", lambda *_: [work.MeasuredPolicy(1, 10, path)])
    monkeypatch.setattr(work, "config_for", lambda _, config: config)
    monkeypatch.setattr(work, "_measure", lambda _, p, __: PolicyTest(1, 10, p.sha256))
    for name in measurements_of(study, job.cell):
        asked = measured_options(study, job.cell, name)
        former = folder.Tests(name, (PolicyTest(1, 10, "ab"),), True, asked)
        folder.save_tests(tmp_path, job.cell, former)
    for _ in range(2):
        work.measure_cell(tmp_path, setup, job, work.Slice(60.0))
    assert caplog.text.count("of other policies") == len(measurements_of(study, job.cell))
    for name in measurements_of(study, job.cell):
        tests = folder.read_tests(tmp_path, study, job.cell, name)
        assert tests is not None
        assert [each.sha256 for each in tests.policies] == [work.MeasuredPolicy(path=path).sha256]


def test_time_in_which_a_job_does_not_compute_is_no_work():
    piece = work.Slice(2400.0)
    time.sleep(0.2)
    assert piece.spent < 0.1


def test_only_jobs_that_train_record_a_precision(tmp_path):
    techniques = (
        Technique("expert", "expert", "expert"),
        Technique("clone", "BC", "behavior_cloning", trainings=2),
        Technique("safe", "LocoSafeDAGGER", "loco_safe_dagger"),
        Technique("loco", "LocoDAGGER", "loco_dagger"),
    )
    study = replace(named_study("smoke"), techniques=techniques, comparisons=(), seeds=(0,))
    setup = folder.StudySetup(study, None, "0", "bfloat16")
    records = [work.job_record(tmp_path, setup, job, work.Slice(1.0), True) for job in setup.jobs]
    assert {record.job: record.precision for record in records} == {
        "measure--expert": "",
        "data--clone--seed-0": "",
        "train--clone--seed-0": "bfloat16",
        "measure--clone--seed-0": "",
        "train--clone--seed-0-training-1": "bfloat16",
        "measure--clone--seed-0-training-1": "",
        "policy--safe--seed-0": "bfloat16",
        "train--safe--seed-0": "bfloat16",
        "measure--safe--seed-0": "",
        "train--loco--seed-0": "bfloat16",
        "measure--loco--seed-0": "",
    }


def test_a_measurement_in_pybullet_records_its_version(tmp_path):
    measurements = (
        Measurement("test", "test"),
        Measurement("other", "other", options={"simulation.backend": "bullet"}),
    )
    study = replace(named_study("smoke"), measurements=measurements, comparisons=())
    setup = folder.StudySetup(study, None, "0", "float32")
    for job in setup.jobs:
        record = work.job_record(tmp_path, setup, job, work.Slice(1.0), True)
        assert ("pybullet" in record.versions) == (job.kind == "measure")


def test_an_error_before_the_first_stage_is_done_is_the_one_that_is_told(tmp_path, monkeypatch):
    study = replace(named_study("smoke"), settings=(Setting("all", "all"),))
    setup = folder.StudySetup(study, None, "0", "float32")
    job = next(job for job in jobs_of(study) if job.kind == "train" and not job.needs)

    def give_up(run, workers, plan):
        raise RuntimeError("the expert gave up in all rollouts")

    methods = {name: SimpleNamespace(train=give_up) for name in work.METHODS}
    monkeypatch.setattr(work, "METHODS", methods)
    with pytest.raises(RuntimeError, match="gave up in all rollouts"):
        work.train_cell(tmp_path, setup, job, work.Slice(10.0))
    assert not folder.results_folder(tmp_path, job.cell).exists()
