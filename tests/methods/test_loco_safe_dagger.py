"""LocoSafeDAGGER with the real planner: what enters D, the same bits always, kills at any stage."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import BehaviorCloningConfig, ExpertData
from surefoot.learning.dataset import Frames
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import load
from surefoot.learning.train import fit
from surefoot.methods.loco_safe_dagger import collection, loco_safe_dagger
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.jobs import play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.run import Run, create, open_run
from surefoot.scenarios.starts import load_starts
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.killed import Killed
from tests.fakes.learning import spec_of
from tests.fakes.runs import collected, fingerprint, stages_of, trained
from tests.fakes.small_runs import RESCUING, RESCUING_STAGES


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Run:
    run = create(tmp_path_factory.mktemp("finished") / "run", RESCUING)
    loco_safe_dagger(run, workers=Workers(1))
    return run


def test_stages_follow_the_algorithm(finished):
    assert stages_of(finished) == RESCUING_STAGES
    assert sorted(path.name for path in finished.policy_path(0).parent.iterdir()) == [
        "000.safetensors",
        "001.safetensors",
        "002.safetensors",
    ]
    # One shard a chunk of three episodes.
    chunks = {"iteration_000": 8, "iteration_001": 2, "iteration_002": 2}
    assert finished.dataset.shards == tuple(
        f"{i}-{n:03d}" for i in chunks for n in range(chunks[i])
    )
    assert finished.best_policy_path in [finished.policy_path(i) for i in range(3)]


def of_iterations(run: Run, iterations) -> Frames:
    frames = run.dataset.load()
    return frames[np.isin(frames.episode // 100_000, list(iterations))]


def test_each_policy_is_trained_on_all_data_so_far(finished):
    frames = [collected(finished, i).dataset_frames for i in range(3)]
    assert frames[0] < frames[1] < frames[2] == finished.dataset.frames
    assert [trained(finished, i).frames for i in range(3)] == frames
    policies = [load(finished.policy_path(i)) for i in range(3)]
    for i, policy in enumerate(policies):
        digest = collected(finished, i).dataset_hash
        assert policy.provenance["dataset_hash"] == digest
        assert policy.provenance["iteration"] == i
        # The normalizers are those of the pre-training.
        assert (policy.network.mean == policies[0].network.mean).all()


@pytest.mark.parametrize("i", [0, 1, 2])
def test_each_policy_is_what_training_the_last_one_on_that_data_gives(finished, i):
    if i == 0:
        seed = int(finished.seed("network", 0).generate_state(1)[0])
        network = PolicyNetwork(RESCUING.policy, seed)
    else:
        network = load(finished.policy_path(i - 1)).network
    frames = of_iterations(finished, range(i + 1))
    order = int(finished.seed("order", i).generate_state(1)[0])
    result = fit(network, frames, RESCUING.training, spec_of(RESCUING.policy), 1, order)
    after = load(finished.policy_path(i)).network.state_dict()
    before = network.state_dict()
    for name, tensor in result.network.state_dict().items():
        assert (tensor == after[name]).all(), name
    assert (before["linear.0.weight"] != after["linear.0.weight"]).any()


@pytest.mark.parametrize("i", [1, 2])
def test_the_last_policy_drives_the_next_rollouts(finished, i):
    job = collection(finished, i)
    assert job.policy == finished.policy_path(i - 1)
    assert (job.episodes.duration, job.episodes.tail) == (0.6, 0.1)
    assert len(job.starts) == 4


def test_pretraining_starts_are_nominal_and_first_perturbations(finished):
    job = collection(finished, 0)
    stored = load_starts()
    assert len(job.starts) == 2 * (1 + 10)
    rows = stored.rows("train")[0][:, [0, 19]]
    assert set(job.starts.id[2:]) == set(stored["train"].id[rows.ravel()])
    # The nominal ones stand still.
    np.testing.assert_array_equal(job.starts.q[:2], np.tile(standing(solo12()), (2, 1)))
    np.testing.assert_array_equal(job.starts.v[:2], 0.0)
    np.testing.assert_array_equal(job.starts.tick[:2], 0)
    np.testing.assert_array_equal(job.starts.command[:2, 0], [0.0, 0.3])
    pretraining = of_iterations(finished, [0])
    assert pretraining.expert_drove.all()
    assert len(pretraining) == 22 * 120


def test_the_same_run_again_has_the_same_bits(finished, tmp_path):
    """With more processes, too, of which some have less to do."""
    run = create(tmp_path / "run", RESCUING)
    loco_safe_dagger(run, Workers(3))
    assert fingerprint(run) == fingerprint(finished)


def test_another_seed_gives_other_data(finished, tmp_path):
    run = create(
        tmp_path / "run", replace(RESCUING, seed=12, method=replace(RESCUING.method, iterations=0))
    )
    loco_safe_dagger(run, workers=Workers(1))
    # The stored starts of the pre-training are the same for every seed; the network is not.
    hashes = [collected(each, 0).dataset_hash for each in (run, finished)]
    assert hashes[0] == hashes[1]
    assert run.policy_path(0).read_bytes() != finished.policy_path(0).read_bytes()
    drawn = [(run, 1), (finished, 1), (finished, 2)]
    ids = {tuple(collection(each, i).starts.id.tolist()) for each, i in drawn}
    assert len(ids) == 3


@pytest.mark.thorough
def test_a_run_killed_at_every_stage_ends_with_the_same_bits(finished, tmp_path, monkeypatch):
    """Killed twice at each stage, when its work is done: before and after it is written down."""
    append_metrics = Run.append_metrics
    killed = []

    def append_and_die(run, record):
        stage = (record.stage, record.iteration)
        killed.append(stage)
        if killed.count(stage) == 2:
            append_metrics(run, record)
        raise Killed

    monkeypatch.setattr(Run, "append_metrics", append_and_die)
    for _ in range(2 * len(RESCUING_STAGES)):
        with pytest.raises(Killed):
            loco_safe_dagger(create(tmp_path / "run", RESCUING, resume=True), workers=Workers(1))
    loco_safe_dagger(create(tmp_path / "run", RESCUING, resume=True), workers=Workers(1))
    assert killed == [stage for stage in RESCUING_STAGES for _ in range(2)]
    assert fingerprint(open_run(tmp_path / "run")) == fingerprint(finished)


def test_a_finished_run_is_not_touched_again(finished, monkeypatch):
    before = fingerprint(finished)
    times = {path: path.stat().st_mtime_ns for path in finished.folder.rglob("*")}
    monkeypatch.setattr("surefoot.runs.collecting.run_chunk", None)
    monkeypatch.setattr("surefoot.runs.stages.fit", None)
    assert (
        loco_safe_dagger(open_run(finished.folder), workers=Workers(1)) == finished.best_policy_path
    )
    assert fingerprint(finished) == before
    assert {path: path.stat().st_mtime_ns for path in finished.folder.rglob("*")} == times


@pytest.mark.parametrize("iteration", [1, 2])
def test_only_what_the_expert_drove_enters_the_dataset(finished, iteration):
    """Against the rollouts themselves, played once more; blocks are told apart by hand."""
    job = collection(finished, iteration)
    rollouts, _ = play_out(job)
    shard = of_iterations(finished, [iteration])
    assert shard.expert_drove.all()
    fell = 0
    for robot, episode in enumerate(job.episode):
        length = int(rollouts.length[robot])
        drove = rollouts.expert_drove[robot, :length].tolist()
        kept = [t for t in range(length) if drove[t]]
        if rollouts.outcome[robot] == Outcome.FELL:
            fell += 1
            last_policy = max(t for t in range(length) if not drove[t])
            kept = [t for t in kept if t < last_policy]
        frames = shard[shard.episode == episode]
        np.testing.assert_array_equal(
            frames.tick, rollouts.starts.tick[robot] + np.array(kept, int)
        )
        np.testing.assert_array_equal(frames.q, rollouts.q[robot, kept])
        np.testing.assert_array_equal(frames.v, rollouts.v[robot, kept])
        np.testing.assert_array_equal(frames.torque, rollouts.torque[robot, kept])
        if length == 700:  # the tail, whole
            assert (
                frames.tick[-100:].tolist()
                == (rollouts.starts.tick[robot] + np.arange(600, 700)).tolist()
            )
    cost = collected(finished, iteration)
    assert cost.falls == fell
    assert cost.frames_kept == len(shard)
    assert set(np.unique(shard.episode)) <= set(job.episode)
    assert 0 < cost.expert_share < 1


def test_metrics_are_valid_json(finished):
    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    for line in (finished.folder / "metrics.jsonl").read_text().splitlines():
        json.loads(line, parse_constant=refuse)


def test_the_cost_of_a_collection_agrees_with_its_rollouts(finished):
    rollouts, expert = play_out(collection(finished, 1))
    cost = collected(finished, 1)
    proper = rollouts.happened[:, :600]
    assert cost.episodes == 4
    assert cost.expert_share == (rollouts.expert_drove[:, :600] & proper).sum() / proper.sum()
    driven = (rollouts.expert_drove & rollouts.happened).sum()
    assert cost.expert_seconds == pytest.approx(driven / 1000)
    assert cost.expert_share_with_tail == pytest.approx(driven / rollouts.length.sum())
    assert cost.plans == expert.plans.sum() > 0


def test_episode_ids_are_unique_over_all_iterations(finished):
    ids = [collection(finished, i).episode for i in range(3)]
    together = np.concatenate(ids)
    assert len(np.unique(together)) == len(together) == 22 + 4 + 4
    for i, of_iteration in enumerate(ids):
        assert (of_iteration // 100_000 == i).all()
    assert finished.dataset.episodes <= len(together)


def test_a_run_of_another_method_is_refused(tmp_path):
    run = create(tmp_path / "run", replace(RESCUING, method=BehaviorCloningConfig()))
    with pytest.raises(TypeError, match="configured for behavior_cloning, not for loco_safe"):
        loco_safe_dagger(run, workers=Workers(1))
    assert run.metrics == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"velocities": 21}, r"method\.velocities is 21; use at most 20"),
        ({"perturbations": 8}, r"method\.perturbations is 8; use at most 7"),
        (
            {"pretraining": ExpertData(2, 8, True, 0.1)},
            r"method\.perturbations is .*; use at most 0",
        ),
        ({"pretraining": ExpertData(21, 1, True, 0.1)}, r"method\.pretraining\.velocities is 21"),
    ],
)
def test_a_parameter_out_of_range_is_an_error_before_any_work(
    tmp_path, monkeypatch, change, message
):
    monkeypatch.setattr("surefoot.runs.collecting.run_chunk", None)
    run = create(tmp_path / "run", replace(RESCUING, method=replace(RESCUING.method, **change)))
    with pytest.raises(ValueError, match=message):
        loco_safe_dagger(run, workers=Workers(1))
    assert run.metrics == []


OFTEN = [3, 1, 8]
"""Numbers of records after which each of the stages collect, train and validate is the next one."""
NUMBERS = [*OFTEN, *(n for n in range(len(RESCUING_STAGES)) if n not in OFTEN)]


@pytest.mark.parametrize("lines", first_often(len(OFTEN), NUMBERS))
def test_stages_whose_records_are_lost_are_done_again_to_the_same_bits(finished, tmp_path, lines):
    """Though the dataset holds the frames of later iterations by then."""
    shutil.copytree(finished.folder, tmp_path / "run")
    path = tmp_path / "run" / "metrics.jsonl"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:lines]))
    run = create(tmp_path / "run", RESCUING, resume=True)
    loco_safe_dagger(run, workers=Workers(1))
    assert fingerprint(run) == fingerprint(finished)


@pytest.mark.parametrize("iteration", first_often(2, [0, 2, 1]))
def test_a_policy_that_is_lost_is_trained_again_to_the_same_bits(finished, tmp_path, iteration):
    shutil.copytree(finished.folder, tmp_path / "run")
    open_run(tmp_path / "run").policy_path(iteration).unlink()
    run = create(tmp_path / "run", RESCUING, resume=True)
    loco_safe_dagger(run, workers=Workers(1))
    assert fingerprint(run) == fingerprint(finished)
