"""Stages: one that was killed is done again, of a collection only the chunks that are missing."""

from dataclasses import replace

import numpy as np
import pytest

import surefoot.runs.stages
from surefoot.config import ExpertData
from surefoot.learning.dataset import Dataset, DatasetError
from surefoot.methods.behavior_cloning import behavior_cloning, collection
from surefoot.runs.run import Run, RunError, create, open_run
from surefoot.runs.stages import choose_best_policy, collect_data
from surefoot.types import MotionPlan
from surefoot.workers import Workers
from tests.fakes.runs import Killed, fingerprint, validated_record
from tests.fakes.small_runs import CLONING, CLONING_STAGES


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Run:
    run = create(tmp_path_factory.mktemp("finished") / "run", CLONING)
    assert behavior_cloning(run, workers=Workers(1)) == run.policy_path(0)
    return run


@pytest.mark.parametrize("function", ["run_and_store", "fit", "save", "evaluate"])
def test_a_run_killed_inside_a_stage_ends_with_the_same_bits(
    finished, tmp_path, monkeypatch, function
):
    """Killed right after the stage's main work, with nothing written down."""
    original = getattr(surefoot.runs.stages, function)

    def work_and_die(*args, **kwargs):
        original(*args, **kwargs)
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(surefoot.runs.stages, function, work_and_die)
        with pytest.raises(Killed):
            behavior_cloning(create(tmp_path / "run", CLONING), workers=Workers(1))
    run = open_run(tmp_path / "run")
    assert len(run.metrics) < len(CLONING_STAGES)
    behavior_cloning(run, workers=Workers(1))
    assert fingerprint(run) == fingerprint(finished)


def test_chunks_that_are_done_are_not_run_again(finished, tmp_path, monkeypatch):
    """Killed when the second of four chunks is stored, in the middle of a collection."""
    ran = []
    run_chunk = surefoot.runs.stages.run_chunk
    append = Dataset.append

    def counted(job):
        ran.append(job.episode[0])
        return run_chunk(job)

    def store_and_die(dataset, name, frames):
        append(dataset, name, frames)
        if name == "iteration_000-001":
            raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(Dataset, "append", store_and_die)
        with pytest.raises(Killed):
            behavior_cloning(create(tmp_path / "run", CLONING), workers=Workers(1))
    monkeypatch.setattr(surefoot.runs.stages, "run_chunk", counted)
    run = open_run(tmp_path / "run")
    assert run.dataset.episodes == 12 and run.metrics == []
    behavior_cloning(run, workers=Workers(1))
    assert ran == [12, 18]
    assert fingerprint(run) == fingerprint(finished)


def stiff(state, tick, command):
    """A user's own MPC: stand, stiffly."""
    rows = np.zeros((100, 12))
    return MotionPlan(np.tile(state.q[7:], (100, 1)), rows, rows)


def test_a_collection_begun_by_another_expert_is_refused(finished, tmp_path, monkeypatch):
    def store_and_die(dataset, name, frames):
        append(dataset, name, frames)
        raise Killed

    append = Dataset.append
    with monkeypatch.context() as patch:
        patch.setattr(Dataset, "append", store_and_die)
        with pytest.raises(Killed):
            behavior_cloning(create(tmp_path / "run", CLONING), workers=Workers(1))
    with pytest.raises(ValueError, match="another expert than stiff"):
        behavior_cloning(open_run(tmp_path / "run"), workers=Workers(1), plan=stiff)
    # And nothing of the other was stored: with the first one the run resumes.
    behavior_cloning(open_run(tmp_path / "run"), workers=Workers(1))
    assert fingerprint(open_run(tmp_path / "run")) == fingerprint(finished)


def test_resuming_over_other_data_is_refused(finished, tmp_path):
    """A shard of other frames under the name that the stage wants is never silently taken."""
    other = replace(CLONING, method=replace(CLONING.method, data=ExpertData(1, 1, False, 0.1)))
    run = create(tmp_path / "run", CLONING)
    run.dataset.append("iteration_000-000", finished.dataset.load()[:100])
    with pytest.raises(DatasetError, match="already holds other frames"):
        collect_data(run, 0, collection(Run(run.folder, other), 0), Workers(1))
    assert run.metrics == []


@pytest.mark.parametrize(
    ("successes", "winner"),
    [
        ([90, 95, 93], 1),
        ([95, 95, 93], 1),
        ([95, 95, 95], 2),  # among equals the one that has seen most
        ([95, 93, 95], 2),
        ([0, 0, 0], 2),
    ],
)
def test_the_policy_with_most_successes_is_chosen_and_of_equals_the_last(
    tmp_path, successes, winner
):
    run = create(tmp_path / "run", CLONING)
    for i, count in enumerate(successes):
        run.append_metrics(validated_record(i, successes=count))
    assert choose_best_policy(run, 2).best_iteration == winner
    assert run.best_policy_path == run.policy_path(winner)


@pytest.mark.parametrize("valid", [False, True])
def test_an_expert_that_gives_up_at_once_leaves_nothing_behind(tmp_path, valid):
    """Its plans are not valid, or not finite; one that has been fixed starts from nothing."""
    works = False

    def plan(state, tick, command):
        reference = np.tile(state.q[7:], (100, 1))
        if works:
            return MotionPlan(reference, 0 * reference, 0 * reference)
        return MotionPlan(np.nan * reference, 0 * reference, 0 * reference, valid)

    run = create(tmp_path / "run", CLONING)
    with pytest.raises(RunError, match=r"gave up on all \d+ rollouts in their first tick"):
        behavior_cloning(run, Workers(1), plan)
    assert run.metrics == []
    assert run.dataset.shards == ()
    works = True
    behavior_cloning(run, Workers(1), plan)
    assert run.collected(0) is not None
