"""The files of a run's own: all that a run knows are among them, and what lies beside is not."""

import pytest

from surefoot.config import MOST_GAITS, Config
from surefoot.runs.layout import (
    CONFIG_FILE,
    METRICS_FILE,
    OWN,
    STARTS_FILES,
    run_that_owns,
)
from surefoot.runs.run import Run


@pytest.fixture
def run(tmp_path) -> Run:
    """A folder that looks like that of a run."""
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / CONFIG_FILE).write_text("{}")
    (folder / METRICS_FILE).touch()
    return Run(folder, Config())


def test_every_file_that_a_run_knows_belongs_to_it(run):
    known = [
        run.metrics_path,
        run.expert_path,
        run.policy_path(3),
        run.checkpoint_path(0),
        run.summary_path("a"),
        run.trace_path("a"),
        run.gate_path("history", 1),
        run.dataset.shard_path("a"),
        *(run.folder / name for name in OWN),
    ]
    assert [run_that_owns(path) for path in known] == [run.folder] * len(known)


def test_what_lies_beside_belongs_to_nobody(run, tmp_path):
    for path in (run.folder / "play.mp4", run.folder / "mine/config.json", tmp_path / CONFIG_FILE):
        assert run_that_owns(path) is None


def test_a_link_belongs_to_the_run_that_it_lies_in_or_points_into(run, tmp_path):
    link = tmp_path / "report.json"
    link.symlink_to(run.folder / CONFIG_FILE)
    assert run_that_owns(link) == run.folder
    (run.folder / CONFIG_FILE).rename(tmp_path / "elsewhere.json")
    (run.folder / CONFIG_FILE).symlink_to(tmp_path / "elsewhere.json")
    assert run_that_owns(run.folder / CONFIG_FILE) == run.folder


def test_a_config_of_another_program_is_no_run(tmp_path):
    (tmp_path / CONFIG_FILE).write_text("{}")
    assert run_that_owns(tmp_path / CONFIG_FILE) is None
    assert run_that_owns(tmp_path / CONFIG_FILE, new_run=tmp_path) == tmp_path


def test_a_run_has_a_file_of_initial_states_for_each_gait_that_a_policy_may_have():
    assert len(STARTS_FILES) == MOST_GAITS
    assert f"starts-{MOST_GAITS - 1}.npz" in OWN
