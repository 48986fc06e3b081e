"""Cells and jobs of a study: their names, their order, and what several share."""

from dataclasses import replace

import pytest

import surefoot.config.study
from surefoot.config.json_io import from_json, to_json
from surefoot.config.studies import named_study
from surefoot.config.study import Measurement, Setting, StudyConfig, Technique
from surefoot.study.cells import (
    beginnings_of,
    cell_config,
    cells_of,
    find_job,
    jobs_of,
    measurements_of,
    trained_configs,
)
from surefoot.study.folder import StudySetup

CLONING = Technique("clone", "BC", "behavior_cloning", trainings=2)
STUDY = StudyConfig(
    name="mine",
    title="My study",
    techniques=(
        Technique("expert", "expert", "expert"),
        CLONING,
        Technique("safe", "LocoSafeDAGGER", "loco_safe_dagger"),
        Technique("loco", "LocoDAGGER", "loco_dagger"),
    ),
    measurements=(Measurement("test", "test"), Measurement("imitation", "i", "imitation")),
    seeds=(3, 4),
)


def test_every_run_is_a_cell_seed_by_seed_and_the_expert_is_one_alone():
    assert [cell.name for cell in cells_of(STUDY)] == [
        "expert",
        "clone/seed-3",
        "clone/seed-3-training-1",
        "safe/seed-3",
        "loco/seed-3",
        "clone/seed-4",
        "clone/seed-4-training-1",
        "safe/seed-4",
        "loco/seed-4",
    ]


def test_cells_of_several_settings_lie_in_folders_of_their_settings():
    settings = (Setting("a", "A"), Setting("b", "B", {"policy.hidden": (32,)}))
    names = [cell.name for cell in cells_of(replace(STUDY, settings=settings))]
    assert names[:3] == ["a/expert", "a/clone/seed-3", "a/clone/seed-3-training-1"]
    assert "b/loco/seed-4" in names
    assert len(set(names)) == len(names)


def test_trainings_of_a_seed_have_its_data_and_weights_of_their_own():
    _, first, second, *_ = cells_of(STUDY)
    a = cell_config(STUDY, first)
    b = cell_config(STUDY, second)
    assert a.seed == b.seed == 3
    assert a.training.seed is None
    assert b.training.seed not in (None, 3, 4)
    assert replace(b, training=a.training) == a


def test_all_configurations_together_are_those_of_each_cell():
    configs = trained_configs(STUDY)
    assert [cell.name for cell in configs] == [
        c.name for c in cells_of(STUDY) if c.name != "expert"
    ]
    assert all(config == cell_config(STUDY, cell) for cell, config in configs.items())


def test_methods_share_their_pretraining_and_trainings_their_data():
    needs = {job.name: job.needs for job in jobs_of(STUDY)}
    [policy] = needs["train--safe--seed-3"]
    assert policy == "policy--safe--seed-3"
    assert needs["train--loco--seed-3"] == (policy,)
    assert needs["train--safe--seed-4"] != (policy,)
    [data] = needs["train--clone--seed-3"]
    assert data == "data--clone--seed-3"
    assert needs["train--clone--seed-3-training-1"] == (data,)


def test_a_setting_that_changes_the_first_policy_is_not_shared():
    technique = Technique("safe", "S", "loco_safe_dagger")
    settings = (
        Setting("plain", "plain"),
        Setting("pushed", "pushed", {"collection.pushes": 1}),
        Setting("small", "small", {"policy.hidden": (32,)}),
    )
    study = replace(STUDY, techniques=(technique,), settings=settings, seeds=(0,))
    needs = {job.name: job.needs for job in jobs_of(study)}
    assert needs["train--plain--safe--seed-0"] == needs["train--pushed--safe--seed-0"]
    # The data is the same, but there is no other cell left to share it with.
    assert needs["train--small--safe--seed-0"] == ()


def test_settings_that_only_measure_otherwise_share_the_data_of_behavior_cloning():
    settings = tuple(
        Setting(f"{seconds}s", "S", {"evaluation.duration": seconds}) for seconds in (2, 4)
    )
    technique = Technique("clone", "BC", "behavior_cloning")
    study = replace(STUDY, techniques=(technique,), settings=settings, seeds=(0,))
    [share] = [job for job in jobs_of(study) if job.kind == "share"]
    assert (share.name, share.shared) == ("data--2s--clone--seed-0", "data")
    needs = {job.name: job.needs for job in jobs_of(study)}
    assert needs["train--2s--clone--seed-0"] == needs["train--4s--clone--seed-0"] == (share.name,)


def test_a_job_comes_after_those_that_it_needs_and_measurements_after_the_training():
    before: set[str] = set()
    for job in jobs_of(STUDY):
        assert before.issuperset(job.needs)
        assert job.name not in before
        before.add(job.name)
    assert find_job(jobs_of(STUDY), "measure--clone--seed-3").needs == ("train--clone--seed-3",)


def test_the_expert_is_measured_but_not_trained_nor_compared_with_itself():
    jobs = [job for job in jobs_of(STUDY) if job.cell.technique == "expert"]
    assert [job.name for job in jobs] == ["measure--expert"]
    assert measurements_of(STUDY, jobs[0].cell) == ("test",)


def test_an_expert_is_measured_once_for_all_settings_in_which_it_is_the_same():
    settings = (
        Setting("short", "few epochs", {"starts": "nominal"}),
        Setting("again", "many", {"training.weight_decay": 0.3, "collection.pushes": 1}),
        Setting("slow", "a slower gait", {"gait.period": 0.6}),
    )
    study = replace(STUDY, settings=settings)
    jobs = [job for job in jobs_of(study) if job.cell.technique == "expert"]
    assert [(job.name, job.kind, job.needs) for job in jobs] == [
        ("measure--short--expert", "measure", ()),
        ("measure--again--expert", "copy", ("measure--short--expert",)),
        ("measure--slow--expert", "measure", ()),
    ]


def test_an_unknown_job_is_named_with_the_nearest():
    with pytest.raises(ValueError, match="did you mean 'measure--clone--seed-3'"):
        find_job(jobs_of(STUDY), "measure--clone--seed-33")


def test_a_study_keeps_its_jobs_when_presets_change(monkeypatch):
    """The jobs run the code that the study began with, which knows only the jobs of its presets."""
    techniques = (
        Technique("plain", "P", "loco_safe_dagger"),
        Technique("decay", "D", "loco_safe_dagger", options={"training.weight_decay": 0.3}),
    )
    study = replace(STUDY, techniques=techniques, comparisons=())
    setup = StudySetup(study, None, "0", "float32", beginnings_of(study))
    before = setup.jobs
    assert before == jobs_of(study)
    preset = surefoot.config.study.preset

    def decaying(method, name):
        config = preset(method, name)
        return replace(config, training=replace(config.training, weight_decay=0.3))

    monkeypatch.setattr(surefoot.config.study, "preset", decaying)
    assert jobs_of(study) != before
    assert from_json(StudySetup, to_json(setup)).jobs == before


def test_the_paper_study_pretrains_once_for_each_seed():
    shared = [job for job in jobs_of(named_study("paper")) if job.kind == "share"]
    assert len(shared) == 3
