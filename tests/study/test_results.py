"""What a study keeps of a run is read back if it is what the study asks for."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import pytest

import surefoot.config.study
from surefoot.config import OtherGait
from surefoot.config.gait_table import GAITS
from surefoot.config.json_io import read_json
from surefoot.config.studies import named_study
from surefoot.files import write_json
from surefoot.robots.scaling import with_own_values
from surefoot.runs.initial_states import keep_starts
from surefoot.runs.layout import CONFIG_FILE
from surefoot.runs.metrics import format_line
from surefoot.runs.run import Run, open_run
from surefoot.runs.setup import Setup
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.study.cells import cells_of, jobs_of, measured_options
from surefoot.study.folder import (
    JobRecord,
    PolicyTest,
    StudyError,
    StudySetup,
    Tests,
    read_study,
    results_folder,
    run_config,
    save_job,
    save_policy,
    save_run,
    save_setup,
    save_tests,
)
from surefoot.study.results import _common_part, read_cell, read_results
from surefoot.study.state import finished_jobs
from tests.fakes.results import robustness
from tests.fakes.runs import collected_record
from tests.fakes.study_folders import paper_like, write_study


@pytest.fixture
def study(tmp_path):
    """The folder of a study with initial states of its own, and its setup; a cell has results."""
    starts = tmp_path / "mine.npz"
    save_starts(load_starts("solo12-trot-v1"), starts)
    asked = paper_like(1)
    settings = [
        replace(each, options={**each.options, "start_set": str(starts)}) for each in asked.settings
    ]
    asked = replace(asked, settings=tuple(settings))
    setup = StudySetup(asked, "c0ffee", "0.1.0", "float32")
    folder = tmp_path / "study"
    save_setup(folder, setup)
    cell = cells_of(asked)[1]
    results = results_folder(folder, cell)
    results.mkdir(parents=True)
    _, written, starts_hash = keep_starts(results, with_own_values(run_config(setup, cell)))
    write_json(results / CONFIG_FILE, Setup(written, {}, None, starts_hash))
    (results / "metrics.jsonl").write_bytes(b"")
    return folder, setup, cell


def test_a_study_with_initial_states_of_its_own_is_read_back(study, tmp_path):
    folder, setup, cell = study
    result = read_cell(folder, setup, cell)
    assert result is not None
    assert result.config.start_set == str(results_folder(folder, cell).resolve() / "starts.npz")
    (tmp_path / "mine.npz").unlink()  # as on another machine
    assert read_cell(folder, setup, cell) == result


def test_only_a_cell_with_a_policy_has_a_copy_of_the_initial_states(study, tmp_path):
    folder, setup, cell = study
    run = open_run(results_folder(folder, cell))
    other = cells_of(setup.study)[2]
    kept = results_folder(folder, other)
    save_run(folder, other, run)
    assert not (kept / "starts.npz").exists()
    result = read_cell(folder, setup, cell)
    assert result is not None
    (run.folder / "starts.npz").rename(tmp_path / "starts.npz")
    assert read_cell(folder, setup, cell) == result  # it is read without them
    (tmp_path / "starts.npz").rename(run.folder / "starts.npz")
    policy = tmp_path / "policy"
    policy.write_bytes(b"the policy")
    finished = SimpleNamespace(folder=run.folder, best_policy_path=policy)
    save_policy(folder, other, cast(Run, finished))
    assert (kept / "policy.safetensors").read_bytes() == b"the policy"
    assert load_starts(str(kept / "starts.npz")).hash == load_starts("solo12-trot-v1").hash


def test_results_are_read_whatever_the_preset_has_become_since(study, monkeypatch):
    folder, setup, cell = study
    before = read_cell(folder, setup, cell)
    preset = surefoot.config.study.preset

    def longer(method, name):
        config = preset(method, name)
        return replace(config, training=replace(config.training, learning_rate=1e-5))

    monkeypatch.setattr(surefoot.config.study, "preset", longer)
    assert run_config(setup, cell).training.learning_rate == 1e-5
    assert read_cell(folder, setup, cell) == before


def test_results_of_other_options_or_of_another_method_are_refused(study):
    folder, setup, cell = study
    technique = setup.study.technique(cell.technique)
    others = [replace(technique, options={**technique.options, "training.batch": 7})]
    others += [replace(technique, method="dagger", options={})]
    for other in others:
        techniques = tuple(other if each is technique else each for each in setup.study.techniques)
        changed_study = replace(setup.study, techniques=techniques, comparisons=(), claims="none")
        with pytest.raises(StudyError, match="results of another configuration"):
            read_cell(folder, replace(setup, study=changed_study), cell)


def test_runs_with_their_own_copies_of_initial_states_are_read_together(study):
    """Each run names the file in its own folder."""
    folder, setup, cell = study
    asked = replace(setup.study, seeds=(0, 1))
    save_setup(folder, replace(setup, study=asked))
    [other] = [
        each for each in cells_of(asked) if each.technique == cell.technique and each.seed == 1
    ]
    for each in (cell, other):
        write_run(folder, replace(setup, study=asked), each)
    results = read_results(folder).of(cell.technique, cell.setting)
    assert len({result.config.start_set for result in results}) == 2


def test_runs_of_several_gaits_whose_copies_are_not_all_there_are_read_together(study):
    """Results of earlier versions have the initial states of the first gait alone."""
    folder, setup, cell = study
    result = read_cell(folder, setup, cell)
    assert result is not None

    def elsewhere(name):
        other = OtherGait(GAITS["walk"], start_set=f"/lost/{name}/starts-1.npz")
        return replace(result.config, other_gaits=(other,), start_set=f"/lost/{name}/starts.npz")

    assert _common_part(elsewhere("seed-0")) == _common_part(elsewhere("seed-1"))


def write_run(folder, setup, cell):
    """What a study keeps of a run that has collected its first data."""
    results = results_folder(folder, cell)
    _, written, starts_hash = keep_starts(results, with_own_values(run_config(setup, cell)))
    write_json(results / CONFIG_FILE, Setup(written, {}, None, starts_hash))
    (results / "metrics.jsonl").write_bytes(format_line(collected_record(0)) + b"\n")


@pytest.mark.parametrize("has_begun", [False, True])
def test_a_run_that_has_kept_nothing_yet_is_of_no_other_configuration(
    tmp_path, monkeypatch, has_begun
):
    """It has a record of a job alone; a preset that has changed since says nothing of it."""
    asked = paper_like(2)
    folder = write_study(tmp_path / "study", asked, without=("loco_safe_dagger/seed-1",))
    cell = next(each for each in cells_of(asked) if each.name == "loco_safe_dagger/seed-1")
    save_job(folder, cell, JobRecord("policy", "c0ffee", ("one",), {}, "", "2026", 1.0, True))
    preset = surefoot.config.study.preset

    def longer(method, name):
        config = preset(method, name)
        return replace(config, training=replace(config.training, learning_rate=1e-5))

    monkeypatch.setattr(surefoot.config.study, "preset", longer)
    if has_begun:
        write_run(folder, read_study(folder), cell)
        with pytest.raises(StudyError, match=r"configurations \(training\.learning_rate\)"):
            read_results(folder)
    else:
        assert cell.name in read_results(folder).missing


@pytest.fixture
def measured(tmp_path):
    """The folder of a small study, in which the expert is measured, and its setup."""
    study = named_study("smoke")
    setup = StudySetup(study, None, "0.1.0", "float32")
    save_setup(tmp_path, setup)
    cell = cells_of(study)[0]
    measurement = study.measurements[0]
    options = measured_options(study, cell, measurement.name)
    test = PolicyTest(0, None, None, robustness=robustness(9, 10))
    save_tests(tmp_path, cell, Tests(measurement.name, (test,), True, options))
    job = f"measure--{cell.name}"
    save_job(tmp_path, cell, JobRecord(job, None, ("one",), {}, "", "2026", 1.0, True))
    return tmp_path, setup


def changed(study, part, **changes):
    """A study in which the first of its techniques or measurements is another."""
    first, *others = getattr(study, part)
    return replace(study, **{part: (replace(first, **changes), *others)})


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [("measurements", "evaluation.episodes", 7), ("techniques", "simulation.friction", 0.5)],
)
def test_what_was_measured_with_other_options_is_refused(measured, part, name, value):
    folder, setup = measured
    first = getattr(setup.study, part)[0]
    study = changed(setup.study, part, options={**first.options, name: value})
    with pytest.raises(StudyError, match=f"measured with other options \\({name}\\)"):
        read_cell(folder, replace(setup, study=study), cells_of(study)[0])
    with pytest.raises(StudyError, match="measured with other options"):
        finished_jobs(folder, study, jobs_of(study))


def test_a_measurement_may_have_another_title(measured):
    folder, setup = measured
    study = changed(setup.study, "measurements", title="another")
    assert read_cell(folder, replace(setup, study=study), cells_of(study)[0]) is not None


def test_measurements_of_earlier_versions_do_not_say_their_options(measured):
    folder, setup = measured
    cell = cells_of(setup.study)[0]
    name = setup.study.measurements[0].name
    path = results_folder(folder, cell) / "tests" / f"{name}.json"
    values = read_json(path)
    del values["options"]
    write_json(path, values)
    study = changed(setup.study, "measurements", split="select")
    assert read_cell(folder, replace(setup, study=study), cell) is not None


def test_results_from_other_initial_states_are_refused(study, tmp_path):
    folder, setup, cell = study
    starts = load_starts("solo12-trot-v1")
    (tmp_path / "mine.npz").unlink()
    slower = {
        split: replace(each, command=0.5 * each.command) for split, each in starts.grid.items()
    }
    save_starts(replace(starts, grid=slower), tmp_path / "mine.npz")
    with pytest.raises(StudyError, match="results of another configuration"):
        read_cell(folder, setup, cell)
