"""Behaviour cloning in the small: what is kept, the same bits always, and kills at any stage."""

from dataclasses import replace

import numpy as np
import pytest

import surefoot.runs.stages
from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    EvaluationConfig,
    ExpertData,
    LocoSafeDaggerConfig,
    PolicyConfig,
    TrainingConfig,
)
from surefoot.learning.dataset import Dataset, DatasetError
from surefoot.methods.behavior_cloning import behavior_cloning, collection
from surefoot.rollouts.jobs import play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.run import Run, create, open_run
from surefoot.runs.sampling import expert_rollouts, keep_unless_failed
from surefoot.types import MotionPlan
from surefoot.workers import Workers
from tests.fakes.rollouts import blank
from tests.fakes.runs import fingerprint

CONFIG = replace(
    Config(),
    method=BehaviorCloningConfig(data=ExpertData(2, 1, False, 0.1), epochs=2),
    chunk=6,
    policy=PolicyConfig(hidden=(16, 16)),
    training=TrainingConfig(batch=64, schedule="cosine"),
    evaluation=EvaluationConfig(duration=0.05, episodes=3),
)
STAGES = [("collect", 0), ("train", 0), ("validate", 0), ("best", 0)]


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Run:
    run = create(tmp_path_factory.mktemp("finished") / "run", CONFIG)
    assert behavior_cloning(run, workers=Workers(1)) == run.policy_path(0)
    return run


def test_the_run_holds_the_experts_rollouts(finished):
    assert [(line["stage"], line["iteration"]) for line in finished.metrics] == STAGES
    record, _ = play_out(collection(finished, 0))
    frames = finished.dataset.load()
    assert len(frames) == 20 * 100
    np.testing.assert_array_equal(frames.q, record.q.reshape(-1, 19))
    np.testing.assert_array_equal(frames.torque, record.torque.reshape(-1, 12))
    np.testing.assert_array_equal(frames.episode, np.repeat(np.arange(20), 100))
    assert frames.expert_drove.all()
    figures = finished.done("collect", 0)
    assert figures["expert_share"] == figures["expert_share_with_tail"] == 1.0
    assert figures["expert_seconds"] == 2.0
    assert figures["plans"] == 40
    assert figures["failed_episodes"] == []


def test_the_same_run_again_has_the_same_bits(finished, tmp_path):
    run = create(tmp_path / "run", CONFIG)
    behavior_cloning(run, workers=Workers(2))
    assert fingerprint(run) == fingerprint(finished)


class Killed(BaseException):
    """Nothing in the package may catch this."""


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
            behavior_cloning(create(tmp_path / "run", CONFIG), workers=Workers(1))
    run = open_run(tmp_path / "run")
    assert len(run.metrics) < len(STAGES)
    behavior_cloning(run, workers=Workers(1))
    assert fingerprint(run) == fingerprint(finished)


def test_chunks_that_are_done_are_not_run_again(finished, tmp_path, monkeypatch):
    """Killed when the second of four chunks is stored, in the middle of a collection."""
    ran, run_chunk, append = [], surefoot.runs.stages.run_chunk, Dataset.append

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
            behavior_cloning(create(tmp_path / "run", CONFIG), workers=Workers(1))
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
            behavior_cloning(create(tmp_path / "run", CONFIG), workers=Workers(1))
    with pytest.raises(ValueError, match="another expert than stiff"):
        behavior_cloning(open_run(tmp_path / "run"), workers=Workers(1), plan=stiff)
    # And nothing of the other was stored: the first one goes on.
    behavior_cloning(open_run(tmp_path / "run"), workers=Workers(1))
    assert fingerprint(open_run(tmp_path / "run")) == fingerprint(finished)


def test_resuming_over_other_data_is_refused(finished, tmp_path, monkeypatch):
    """A shard of other frames under the name that the stage wants is never silently taken."""
    other = replace(CONFIG, method=replace(CONFIG.method, data=ExpertData(1, 1, False, 0.1)))
    run = create(tmp_path / "run", CONFIG)
    run.dataset.append("iteration_000-000", finished.dataset.load()[:100])
    with pytest.raises(DatasetError, match="already holds other frames"):
        surefoot.runs.stages.collect(run, 0, collection(Run(run.folder, other), 0), Workers(1))
    assert run.metrics == []


def test_starts_are_velocities_by_phases_by_perturbations():
    job = expert_rollouts(Config(), ExpertData(4, 2, True, 1.0))
    assert len(job.starts) == 4 * (1 + 2 * 10)
    assert len(np.unique(job.episode)) == len(job.starts)
    stored = job.starts.id[4:]
    assert (job.starts.id[:4] == -1).all()  # at rest, of no stored set
    assert len(np.unique(stored)) == len(stored)
    speeds, counts = np.unique(np.round(job.starts.command[:, 0], 6), return_counts=True)
    assert len(speeds) == 4
    assert (speeds[0], speeds[-1]) == (0.0, 0.3)
    assert (counts == 21).all()
    assert len(np.unique(job.starts.tick)) == 10
    one = expert_rollouts(Config(), ExpertData(1, 1, False, 1.0))
    assert len(one.starts) == 10


def test_failed_rollouts_are_dropped_whole():
    T = 6
    record = blank(
        4,
        T,
        length=np.array([6, 4, 6, 3]),
        outcome=np.array([Outcome.SUCCESS, Outcome.FELL, Outcome.STALLED, Outcome.DIVERGED]),
    )
    np.testing.assert_array_equal(
        keep_unless_failed(record), np.repeat([[True], [False], [True], [False]], T, axis=1)
    )


def test_a_run_of_another_method_is_refused(tmp_path):
    run = create(tmp_path / "run", replace(CONFIG, method=LocoSafeDaggerConfig()))
    with pytest.raises(
        TypeError, match="configured for loco_safe_dagger, not for behavior_cloning"
    ):
        behavior_cloning(run, workers=Workers(1))
    with pytest.raises(TypeError, match="loco_safe_dagger"):
        collection(run, 0)
    assert run.metrics == []


def test_there_is_one_collection_only(finished):
    with pytest.raises(ValueError, match="no iteration 1"):
        collection(finished, 1)
