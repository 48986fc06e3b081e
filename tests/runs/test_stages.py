"""Stages: one that was killed is done again, of a collection only the chunks that are missing."""

from dataclasses import replace

import numpy as np
import pytest

import surefoot.learning.train
import surefoot.runs.collecting
import surefoot.runs.stages
from surefoot.config import (
    BudgetConfig,
    DartConfig,
    ExpertData,
    Gait,
    LocoSafeDaggerConfig,
    RobotConfig,
    SafeDaggerConfig,
)
from surefoot.evaluation import imitation
from surefoot.evaluation.mirror_error import mirror_error_in_starts
from surefoot.learning.dataset import Dataset
from surefoot.learning.policy import PolicyFileError, load
from surefoot.methods import METHODS
from surefoot.methods.behavior_cloning import behavior_cloning, collection
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.runs.layout import RunError
from surefoot.runs.run import Run, create, open_run
from surefoot.runs.stages import choose_best_policy, collect_data, training_data
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.types import MotionPlan
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.killed import Killed
from tests.fakes.runs import fingerprint, trained, validated_record
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


def test_a_run_may_train_on_mirror_images_and_resume(finished, tmp_path, monkeypatch):
    """The data are those of any run, the policy is another, and a kill does not change it."""
    mirrored = replace(CLONING, training=replace(CLONING.training, mirror="left_right"))
    whole = create(tmp_path / "whole" / "run", mirrored)
    behavior_cloning(whole, workers=Workers(1))
    plain = trained(finished, 0)
    record = trained(whole, 0)
    assert whole.dataset.hash == finished.dataset.hash
    assert (record.frames, record.episodes) == (plain.frames, plain.episodes)
    assert record.steps == plain.steps
    save_checkpoint = surefoot.learning.train.save_checkpoint

    def save_and_die(*args):
        save_checkpoint(*args)
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(surefoot.learning.train, "save_checkpoint", save_and_die)
        with pytest.raises(Killed):
            behavior_cloning(create(tmp_path / "run", mirrored), workers=Workers(1))
    behavior_cloning(open_run(tmp_path / "run"), workers=Workers(1))
    assert fingerprint(open_run(tmp_path / "run")) == fingerprint(whole) != fingerprint(finished)


def test_auto_mirrors_where_robot_and_gait_allow_it_and_nothing_elsewhere(finished):
    auto = replace(CLONING, training=replace(CLONING.training, mirror="auto"))
    uneven = replace(auto, gait=Gait(offsets=(0.0, 0.5, 0.5, 0.25)))
    data = finished.dataset
    assert training_data(auto, data).hash != data.hash
    assert training_data(uneven, data) is data
    with pytest.raises(ValueError, match=r"training\.mirror none"):
        named = replace(uneven, training=replace(uneven.training, mirror="left_right"))
        training_data(named, data)


def test_chunks_that_are_done_are_not_run_again(finished, tmp_path, monkeypatch):
    """Killed when the second of four chunks is stored, in the middle of a collection."""
    ran = []
    run_chunk = surefoot.runs.collecting.run_chunk
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
    monkeypatch.setattr(surefoot.runs.collecting, "run_chunk", counted)
    run = open_run(tmp_path / "run")
    assert run.dataset.episodes == 12 and run.metrics == []
    behavior_cloning(run, workers=Workers(1))
    assert ran == [12, 18]
    assert fingerprint(run) == fingerprint(finished)


@pytest.mark.thorough  # `test_budget.py` has it in one process
def test_a_budget_ends_at_the_same_rollout_for_any_number_of_processes(tmp_path):
    """Seven rollouts of two solves each, of 0.75 s; the first chunk has six."""
    records = []
    for count in (1, 2):
        run = create(tmp_path / str(count), replace(CLONING, budget=BudgetConfig(0.75)))
        record = collect_data(run, 0, collection(run, 0), Workers(count))
        assert (record.episodes, record.plans, len(run.dataset.shards)) == (7, 14, 2)
        records.append(replace(record, seconds=0.0))
    assert records[0] == records[1]


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
    with pytest.raises(RunError, match="is lost, and playing the rollouts again gave others"):
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


@pytest.mark.parametrize(
    ("lost", "winner"),
    [
        ([1, 30, 3], 2),  # by chance
        ([0, 1, 12], 0),  # not by chance
        ([5, 2, 2], 2),
    ],
)
def test_a_policy_that_was_trained_to_collect_has_to_be_better_beyond_chance(
    tmp_path, lost, winner
):
    config = replace(CLONING, method=LocoSafeDaggerConfig(steps_before_last=100))
    run = create(tmp_path / "run", config)
    for i, count in enumerate(lost):
        outcomes = "1" * count + "0" * (100 - count)
        changes = {"successes": 100 - count, "outcomes": outcomes, "initial_states": "0-99"}
        run.append_metrics(validated_record(i, **changes))
    assert choose_best_policy(run, 2).best_iteration == winner


def scaled(gain: float):
    """A user's own MPC: stand, with a feed-forward torque; all of them have one name."""
    return lambda state, tick, command: MotionPlan(
        np.tile(state.q[7:], (100, 1)), np.zeros((100, 12)), np.full((100, 12), 0.01 * gain)
    )


def killed_after_the_first_chunk(run: Run, monkeypatch, plan):
    append = Dataset.append

    def store_and_die(dataset, name, frames):
        append(dataset, name, frames)
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(Dataset, "append", store_and_die)
        with pytest.raises(Killed):
            behavior_cloning(run, Workers(1), plan)


def test_an_own_expert_whose_gain_has_changed_since_is_refused(tmp_path, monkeypatch):
    """One that another processor rounds differently is not."""
    run = create(tmp_path / "run", CLONING)
    killed_after_the_first_chunk(run, monkeypatch, scaled(1.0))
    with pytest.raises(RunError, match=r"torque is up to 0\.001 N m apart \(tolerance 1e-06\)"):
        behavior_cloning(open_run(run.folder), Workers(1), scaled(0.9))
    with pytest.raises(RunError, match="not with the package's own planner"):
        behavior_cloning(open_run(run.folder), Workers(1))
    assert len(run.dataset.shards) == 1
    collect_data(run, 0, collection(run, 0, scaled(1.0 + 1e-7)), Workers(1))
    record = run.collected(0)
    assert record is not None and record.expert == "scaled.<locals>.<lambda>"
    with pytest.raises(RunError, match="which has changed since"):  # although it is done
        collect_data(run, 0, collection(run, 0, scaled(0.9)), Workers(1))


def test_an_own_expert_of_an_earlier_version_is_known_by_its_name(tmp_path, monkeypatch):
    run = create(tmp_path / "run", CLONING)
    killed_after_the_first_chunk(run, monkeypatch, scaled(1.0))
    run.expert_path.unlink()
    with pytest.raises(ValueError, match="another expert than stiff"):
        behavior_cloning(run, Workers(1), stiff)
    collect_data(run, 0, collection(run, 0, scaled(1.0)), Workers(1))
    assert not run.expert_path.exists()  # what began it is not known any more


def test_the_packages_planner_leaves_no_identity(finished):
    assert not finished.expert_path.exists()


def test_a_first_collection_that_leaves_no_frame_leaves_nothing_behind(tmp_path):
    """The expert has a plan for the initial states only, until it is mended."""
    longer = replace(CLONING, method=replace(CLONING.method, data=ExpertData(2, 1, False, 0.2)))
    run = create(tmp_path / "run", longer)
    begun = collection(run, 0).starts.v
    works = False

    def plan(state, tick, command):
        valid = works or bool((begun == state.v).all(axis=1).any())
        return replace(scaled(1.0)(state, tick, command), valid=valid)

    message = r"no frame is left of 20 rollouts of the expert .*plan: it gave up on 20, .*try again"
    with pytest.raises(RunError, match=message):
        behavior_cloning(run, Workers(1), plan)
    assert run.metrics == []
    assert run.dataset.shards == ()
    works = True
    collect_data(run, 0, collection(run, 0, plan), Workers(1))
    assert run.dataset.frames > 0


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


BRIEF = {
    "pretraining": ExpertData(2, 1, False, 0.12),
    "pretraining_epochs": 1,
    "iterations": 1,
    "velocities": 2,
    "perturbations": 1,
    "T": 0.6,
    "epochs": 1,
}


@pytest.fixture(scope="module")
def go2_starts(tmp_path_factory) -> str:
    """The file of a set in which a Go2 stands."""
    stored = load_starts()
    q = standing(load_robot("go2"))
    grid = {
        split: replace(starts, q=np.tile(q, (len(starts), 1)), v=np.zeros_like(starts.v))
        for split, starts in stored.grid.items()
    }
    path = tmp_path_factory.mktemp("starts") / "go2.npz"
    save_starts(replace(stored, grid=grid, robot="go2"), path)
    return str(path)


@pytest.mark.parametrize(
    "method", first_often(1, [SafeDaggerConfig(**BRIEF), DartConfig(**BRIEF), CLONING.method])
)
def test_the_policies_of_a_run_belong_to_its_robot(tmp_path, monkeypatch, go2_starts, method):
    config = replace(CLONING, robot=RobotConfig("go2"), start_set=go2_starts, method=method)
    run = create(tmp_path / "run", with_own_values(config))
    best = METHODS[method.name].train(run, Workers(1), None)
    assert load(best, "go2").robot == "go2"
    assert mirror_error_in_starts(run.config, best, load_starts(go2_starts)["select"][:2])
    frames = run.dataset.load(run.dataset.shards)
    monkeypatch.setattr(imitation, "expert_states", lambda *_, **__: frames)
    assert imitation.imitation_error(run.config, best, Workers(1)).starts == "starts"
    with pytest.raises(PolicyFileError, match="robot 'go2', expected 'solo12'"):
        load(best, "solo12")
