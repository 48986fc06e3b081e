"""What a study keeps of a run is read back if it is what the study asks for."""

from dataclasses import replace

import pytest

from surefoot.files import write_json
from surefoot.robots.scaling import with_own_values
from surefoot.runs.initial_states import keep_starts
from surefoot.runs.run import CONFIG_FILE, Setup
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.study.cells import cells_of
from surefoot.study.folder import StudyError, StudySetup, results_folder, run_config, save_setup
from surefoot.study.results import read_cell
from tests.fakes.study_folders import paper_like


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
