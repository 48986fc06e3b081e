"""Every algorithm on a toy with a known answer: who drove, what was kept, labelled, counted.

The plant is linear and the expert an LQR (``toy.py``), so that a test computes for itself what the
expert answers in any state. Engine, methods and stages are the real ones.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

import toy
from surefoot.arbiters import ExpertOnly, RandomMix, SafetySwitch
from surefoot.classifier import load_classifier
from surefoot.config import (
    Config,
    DisturbanceConfig,
    EvaluationConfig,
    PolicyConfig,
    SafetyConfig,
    TrainingConfig,
)
from surefoot.disturbance import draw
from surefoot.episodes import Job, play_out, run_chunk
from surefoot.examples import held_out
from surefoot.files import load_arrays
from surefoot.gates import Deviation
from surefoot.method_config import (
    BehaviorCloningConfig,
    DaggerConfig,
    ExpertData,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    SafeDaggerConfig,
)
from surefoot.methods import behavior_cloning as bc
from surefoot.methods import dagger, loco_dagger, loco_safe_dagger, safe_dagger
from surefoot.methods.stages import collect
from surefoot.observation import network_input
from surefoot.policy import Policy, PolicyNetwork, load, save
from surefoot.run import Run, create, open_run
from surefoot.safety import Outcome, SafetyMonitor
from surefoot.starts import load_starts
from surefoot.summary import Summary, join
from surefoot.train import fit
from surefoot.types import State
from surefoot.workers import Workers
from toy import FLAT, Worlds, plan

LIMIT, GRID, ALARM = 2.7, 50, 0.03
KP, KD = 3.0, 0.05  # the expert's
POWERS = np.array([np.linalg.matrix_power(toy.A - toy.B @ toy.K, n) for n in range(100)])
FREE = (-1e4, 1e4)
SAFETY = SafetyConfig(hip_abduction=FREE, hip_flexion=FREE, knee=FREE)  # roll and height decide
HEIGHT_ONLY = replace(SAFETY, roll_pitch=1e4, fall_angle=1e4)
FIRST = ExpertData(2, 1, True, 0.2)  # 22 episodes
COMMON = {
    "pretraining": FIRST,
    "pretraining_epochs": 2,
    "iterations": 2,
    "velocities": 3,
    "perturbations": 2,
    "T": 0.7,
    "epochs": 1,
}
METHODS = {
    "behavior_cloning": BehaviorCloningConfig(data=FIRST, epochs=2, frames=(700, 2600)),
    "dagger": DaggerConfig(**COMMON, p=0.6),
    "safe_dagger": SafeDaggerConfig(**COMMON, unsafe_share=0.3),
    "loco_dagger-0.5": LocoDaggerConfig(**COMMON, alpha=0.5, N_query=3, T_query=0.12),
    "loco_dagger-0.8": LocoDaggerConfig(**COMMON, alpha=0.8, N_query=2, T_query=0.51),
    "loco_safe_dagger": LocoSafeDaggerConfig(
        **COMMON, T_block=0.15, T_end=0.1, guard=("relaxing", "classifier"), alarm=ALARM
    ),
}
CONFIG = replace(
    Config(),
    chunk=6,
    seed=5,
    safety=SAFETY,
    policy=PolicyConfig(hidden=(16, 16)),
    training=TrainingConfig(batch=64, validation=0.25),
    collection=DisturbanceConfig(pushes=2, impulse=(0.1, 0.4), gentle=0.5),
    evaluation=EvaluationConfig(duration=0.02, episodes=3),
)
RUN = {
    "behavior_cloning": bc.behavior_cloning,
    "dagger": dagger.dagger,
    "safe_dagger": safe_dagger.safe_dagger,
    "loco_dagger": loco_dagger.loco_dagger,
    "loco_safe_dagger": loco_safe_dagger.loco_safe_dagger,
}
COLLECTION = {
    "behavior_cloning": bc.collection,
    "dagger": dagger.collection,
    "safe_dagger": safe_dagger.collection,
    "loco_dagger": loco_dagger.collection,
    "loco_safe_dagger": loco_safe_dagger.collection,
}
every_method = pytest.mark.parametrize("name", METHODS)
in_every_iteration = pytest.mark.parametrize(
    ("name", "i"),
    [
        ("behavior_cloning", 0),
        *((n, i) for n in METHODS if n != "behavior_cloning" for i in (1, 2)),
    ],
)


@pytest.fixture(scope="module", autouse=True)
def toys():
    """Every simulator of this file is a toy."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("surefoot.episodes.make_simulator", Worlds())
        yield


def run_method(folder, config) -> Run:
    run = create(folder / "run", config)
    RUN[run.method](run, Workers(1), plan)
    return run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A finished run of each method."""
    done = {}

    def finished(name) -> Run:
        if name not in done:
            config = replace(CONFIG, method=METHODS[name])
            done[name] = run_method(tmp_path_factory.mktemp(name), config)
        return done[name]

    return finished


def collection(run, i) -> Job:
    return COLLECTION[run.method](run, i, plan)


def replayed(run, i):
    """The rollouts of an iteration, played once more: (job, record), and those that follow."""
    job = collection(run, i)
    pairs = [(job, play_out(job)[0])]
    if job.then is not None and (more := job.then(*pairs[0])) is not None:
        pairs.append((more, play_out(more)[0]))
    return pairs


def figures_of(run, stage, i) -> dict:
    done = run.done(stage, i)
    assert done is not None
    return done


def kept_in(run, i):
    frames = run.dataset.load()
    return frames[frames.episode // 100_000 == i]


# --- what the test computes for itself


def angles(q):
    """(..., 2) roll and pitch."""
    euler = Rotation.from_quat(q[..., 3:7].reshape(-1, 4)).as_euler("ZYX")
    return euler[:, [2, 1]].reshape(*q.shape[:-1], 2)


def has_fallen(q, safety):
    (low, high), angle = safety.fall_height, np.radians(safety.fall_angle)
    return (q[..., 2] < low) | (q[..., 2] > high) | (np.abs(angles(q)) > angle).any(-1)


def outside(record, share=1.0):
    """(B, T) True where height, roll or pitch leaves the paper's table, or a share of it."""
    z, limit = record.com[..., 2], np.radians(25.0 * share)
    low = z < 0.20 - share * 0.05
    return low | (z > 1.0) | (np.abs(angles(record.q)) > limit).any(-1)


def spans(mask):
    """[(first, last)] of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def answers(record, asked, invalid=()):
    """(B, T, 12) the expert's torque: LQR plans of the grid ticks and takeovers, followed.

    A plan made t ticks ago predicts the error (A - B K)^t e. Without a valid one, the last goes on.
    """
    torque, asked = np.zeros(record.torque.shape), asked & record.happened
    for b in range(len(asked)):
        clock = record.starts.tick[b] + np.arange(asked.shape[1])
        for first, last in spans(asked[b]):
            grid = (clock % GRID == 0) & ~np.isin(clock, invalid)
            made = [first, *(t for t in range(first + 1, last + 1) if grid[t])]
            for begin, end in zip(made, [*made[1:], last + 1], strict=True):
                q, v = record.q[b, begin:end], record.v[b, begin:end]
                goal = toy.goal_of(clock[begin], record.starts.command[b])
                error = POWERS[: end - begin] @ (toy.x_of(q[0], v[0]) - goal)
                x = error + goal
                free = -error @ toy.K.T + KP * (x[:, 1:13] - q[:, 7:]) + KD * (x[:, 14:] - v[:, 6:])
                torque[b, begin:end] = np.clip(free, -LIMIT, LIMIT)
    return torque


def alarms(classifier, record, alarm):
    """(B, T) True where a classifier's network, in float64 by hand, is beyond the alarm's."""
    clock = record.starts.tick[:, None] + np.arange(record.q.shape[1])
    state = State(record.q, record.v, record.com, record.feet, record.contacts)
    x = rows = network_input(state, clock, record.starts.command[:, None], 500)
    for weight, bias in classifier.layers[:-1]:
        x = np.maximum(x.astype(float) @ weight + bias, 0.0)
    weight, bias = classifier.layers[-1]
    p = 1.0 / (1.0 + np.exp(-(x @ weight + bias)[..., 0]))
    # Where float32 decides, the network itself is asked.
    close = np.abs(p - alarm) < 1e-6
    assert close.mean() < 1e-3
    own = classifier.probability(rows.reshape(-1, 47)).reshape(p.shape)
    return np.where(close, own, p) > alarm


def driven(violation, block, T):
    """(T,) who drives when the rule is: safe again, and at least a block since the takeover."""
    drives, since = np.zeros(T, bool), None
    for t in range(T):
        if since is None and violation[t]:
            since = t
        elif since is not None and not violation[t] and t - since >= block:
            since = None
        drives[t] = since is not None
    return drives


def last_block(drove, length):
    """(T,) the expert's block that ends at a robot's end, if it drove there."""
    block, t = np.zeros(len(drove), bool), length - 1
    while t >= 0 and drove[t]:
        block[t], t = True, t - 1
    return block


def kept(run, i, part, record):
    """(B, T) what the method should keep of its rollouts, or of those that follow (part 1)."""
    failed = np.isin(record.outcome, [Outcome.FELL, Outcome.DIVERGED])
    happened = np.arange(record.q.shape[1]) < record.length[:, None]
    if i == 0 or part == 1:
        return happened & ~failed[:, None]
    if run.method == "dagger":
        return happened
    if run.method == "loco_dagger":
        return np.zeros_like(happened)
    keep = happened & record.expert_drove
    for b in np.flatnonzero(failed):
        keep[b] &= ~last_block(record.expert_drove[b], record.length[b])
    return keep


# --- the toy


def test_the_toy_is_linear_and_its_expert_masters_it():
    assert np.abs(np.linalg.eigvals(toy.A - toy.B @ toy.K)).max() < 1.0
    assert np.abs(np.linalg.eigvals(toy.A)).max() > 1.0
    rng = np.random.default_rng(0)
    starts = load_starts()["train"][:5]
    world = toy.Toy(5)
    world.reset(starts.q, starts.v)
    for _ in range(20):
        before = [toy.x_of(q, v) for q, v in zip(world.q, world.v, strict=True)]
        torque, mask = rng.normal(size=(5, 12)), np.array([True] * 4 + [False])
        world.step(torque, mask)
        for b in range(5):
            x = toy.A @ before[b] + toy.B @ torque[b] if mask[b] else before[b]
            now = toy.x_of(world.q[b], world.v[b])
            np.testing.assert_allclose(now, x, rtol=0, atol=1e-12)
    # A world that resets to a recorded state goes on from it.
    np.testing.assert_array_equal(world.state.q[4], starts.q[4])
    made = plan(world.state[0], 130, starts.command[0])
    x = toy.x_of(world.q[0], world.v[0])
    np.testing.assert_allclose(made.joint_position[0], x[1:13], atol=1e-15)
    for t in range(99):
        x = toy.A @ x + toy.B @ made.torque[t]
    np.testing.assert_allclose(made.joint_position[99], x[1:13], atol=1e-9)
    np.testing.assert_allclose(made.joint_velocity[99], x[14:], atol=1e-9)


# --- all methods


@in_every_iteration
def test_the_dataset_is_what_the_method_keeps_with_the_experts_labels(runs, name, i):
    """Every array of every frame; and nothing else."""
    run, total = runs(name), 0
    frames = kept_in(run, i)
    assert len(frames)
    for part, (job, record) in enumerate(replayed(run, i)):
        keep = kept(run, i, part, record)
        asked = record.happened if run.method == "dagger" and i else record.expert_drove
        torque = answers(record, asked)
        drove = record.expert_drove & record.happened
        np.testing.assert_allclose(record.torque[drove], torque[drove], rtol=0, atol=1e-9)
        for b, episode in enumerate(job.episode):
            mine, when = frames[frames.episode == episode], np.flatnonzero(keep[b])
            np.testing.assert_array_equal(mine.tick, record.starts.tick[b] + when)
            for field in ("q", "v", "com", "feet", "contacts", "expert_drove"):
                recorded = getattr(record, field)[b, when]
                np.testing.assert_array_equal(getattr(mine, field), recorded, err_msg=field)
            assert (mine.command == record.starts.command[b]).all()
            assert (mine.outcome == record.outcome[b]).all()
            np.testing.assert_allclose(mine.torque, torque[b, when], rtol=0, atol=1e-9)
            total += len(when)
    assert total == len(frames)


@in_every_iteration
def test_figures_are_those_of_the_rollouts(runs, name, i):
    """Counted again, tick by tick; a fall is one by the test's own bounds and dynamics."""
    run = runs(name)
    figures, pairs = figures_of(run, "collect", i), replayed(run, i)
    takeovers = expert = policy = falls = 0
    record = pairs[0][1]
    T = record.duration
    for b in range(len(record.length)):
        length, before = int(record.length[b]), None
        ticks = record.expert_drove[b, : min(length, T)].tolist()
        for drove in ticks:
            takeovers += drove and before is False
            before = drove
        takeovers += ticks[0] and not all(ticks)
        expert, policy = expert + sum(ticks), policy + len(ticks) - sum(ticks)
        lies = has_fallen(record.q[b, :length], SAFETY)
        assert not lies[500:].any()
        if record.outcome[b] == Outcome.FELL:
            falls += 1
            q, v = record.q[b, length - 1], record.v[b, length - 1]
            x = toy.A @ toy.x_of(q, v) + toy.B @ record.torque[b, length - 1]
            assert np.degrees(abs(x[0])) > 29.0  # a push may do the rest
        else:
            assert length == record.q.shape[1]
    assert (figures["takeovers"], figures["falls"]) == (takeovers, falls)
    assert figures["expert_share"] == pytest.approx(expert / (expert + policy), abs=1e-12)
    assert figures["episodes"] == len(record.length)
    ticks = sum(int(r.length.sum()) for _, r in pairs)
    assert figures["robot_seconds"] == pytest.approx(ticks / 1000)
    drove = sum(int((r.expert_drove & r.happened).sum()) for _, r in pairs)
    assert figures["expert_seconds"] == pytest.approx(drove / 1000)
    plans = 0
    for _, each in pairs:
        asked = each.happened if run.method == "dagger" and i else each.expert_drove
        asked = asked & each.happened
        clock = each.starts.tick[:, None] + np.arange(asked.shape[1])
        fresh = np.concatenate([asked[:, :1], asked[:, 1:] & ~asked[:, :-1]], axis=1)
        plans += int((asked & (fresh | (clock % GRID == 0))).sum())
    assert (figures["plans"], figures["invalid_plans"]) == (plans, 0)


@pytest.mark.parametrize("name", list(METHODS)[2:])
def test_all_that_iterate_begin_with_the_same_data(runs, name):
    first, mine = (figures_of(runs(each), "collect", 0) for each in ("dagger", name))
    assert {**mine, "seconds": 0} == {**first, "seconds": 0}


@every_method
def test_frames_are_conserved(runs, name):
    """In the shards, in the summaries, in the metrics."""
    run, running = runs(name), 0
    ids = []
    for i in range(1 if run.method == "behavior_cloning" else 3):
        shards = [s for s in run.dataset.shards if s.startswith(f"iteration_{i:03d}")]
        frames = run.dataset.load(shards)
        summary = join([load_arrays(run.summary(name), Summary) for name in shards])
        count = {e: int((frames.episode == e).sum()) for e in summary.episode.tolist()}
        assert summary.kept.tolist() == list(count.values())
        assert len(frames) == sum(count.values()) == figures_of(run, "collect", i)["frames_kept"]
        running += len(frames)
        assert figures_of(run, "collect", i)["dataset_frames"] == running
        ids += summary.episode.tolist()
    assert len(set(ids)) == len(ids)
    assert run.dataset.frames == running
    assert run.dataset.episodes == len(np.unique(run.dataset.load().episode))


def bits(run) -> dict:
    """All that a run leaves behind, apart from how long things took."""
    metrics = [{k: v for k, v in line.items() if k != "seconds"} for line in run.metrics]
    networks = {
        str(path.relative_to(run.folder)): path.read_bytes()
        for part in ("policies", "gates")
        for path in sorted((run.folder / part).glob("*"))
    }
    return {"data": run.dataset.hash, "metrics": metrics, **networks}


SMALL = {**COMMON, "pretraining": ExpertData(2, 1, False, 0.06), "iterations": 1, "T": 0.55}
SMALL_METHODS = {
    "behavior_cloning": BehaviorCloningConfig(SMALL["pretraining"], epochs=2, frames=(500,)),
    "dagger": DaggerConfig(**SMALL),
    "safe_dagger": SafeDaggerConfig(**SMALL),
    "loco_dagger": LocoDaggerConfig(**SMALL, N_query=2, T_query=0.1),
    "loco_safe_dagger": LocoSafeDaggerConfig(**SMALL, T_block=0.1, T_end=0.1),
}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A short finished run of each method."""
    done = {}

    def finished(name) -> Run:
        if name not in done:
            config = replace(CONFIG, method=SMALL_METHODS[name])
            done[name] = run_method(tmp_path_factory.mktemp(name), config)
        return done[name]

    return finished


@pytest.mark.parametrize("name", SMALL_METHODS)
@pytest.mark.parametrize("chunk", [3, 50])
def test_chunks_do_not_matter(small, tmp_path, name, chunk):
    """Data and figures. A policy may: rows of a LocoDAGGER chunk come in another order."""
    run = run_method(tmp_path, replace(CONFIG, method=SMALL_METHODS[name], chunk=chunk))
    one, other = bits(run), bits(small(name))
    if name == "loco_dagger":
        assert one["data"] == other["data"]
        stages = [[m for m in each["metrics"] if m["stage"] == "collect"] for each in (one, other)]
        assert stages[0] == stages[1]
    else:
        assert one == other
    summaries = []
    for each in (run, small(name)):
        summary = join([load_arrays(each.summary(shard), Summary) for shard in each.dataset.shards])
        summaries.append(vars(summary[np.argsort(summary.episode)]))
    for field, array in summaries[0].items():
        np.testing.assert_array_equal(array, summaries[1][field], err_msg=field)


def test_what_would_have_been_after_the_end_counts_for_nothing(monkeypatch):
    """A robot lost 10 ms after a touchdown has the same summary alone and in company."""
    starts, summaries = load_starts()["train"][:2], []
    for batch in (1, 2):
        monkeypatch.setattr("surefoot.episodes.make_simulator", Worlds({"lost": {0: 510}}))
        some = starts[:batch]
        job = Job(CONFIG, some, np.arange(batch), ExpertOnly(), 1.1, plan=plan)
        summaries.append(run_chunk(job).summary)
    assert summaries[0].ticks.tolist() == [510]
    assert summaries[0].strict.tolist() == [False] and summaries[1].strict.tolist()[1:] == [True]
    for field, array in vars(summaries[0]).items():
        np.testing.assert_array_equal(array, getattr(summaries[1], field)[:1], err_msg=field)


class Killed(BaseException):
    """Nothing in the package may catch this."""


@pytest.mark.parametrize("name", SMALL_METHODS)
def test_killed_before_and_after_each_record(small, tmp_path, monkeypatch, name):
    config = replace(CONFIG, method=SMALL_METHODS[name])
    record, deaths = Run.record, []

    def record_and_die(run, stage, i, **figures):
        moment = deaths.count((stage, i))
        deaths.append((stage, i))
        if moment == 1:
            record(run, stage, i, **figures)
        if moment < 2:
            raise Killed
        return record(run, stage, i, **figures)

    monkeypatch.setattr(Run, "record", record_and_die)
    stages = [(line["stage"], line["iteration"]) for line in small(name).metrics]
    for _ in range(2 * len(stages)):
        with pytest.raises(Killed):
            RUN[name](create(tmp_path / "run", config, resume=True), Workers(1), plan)
    RUN[name](create(tmp_path / "run", config, resume=True), Workers(1), plan)
    assert deaths == [stage for stage in stages for _ in range(2)]
    assert bits(open_run(tmp_path / "run")) == bits(small(name))


# --- behaviour cloning


def scratch(run, size, frames):
    """What training from random weights on these frames gives."""
    seed, order = (
        int(run.seed(*s).generate_state(1)[0]) for s in (("network", 0), ("order", size))
    )
    network = PolicyNetwork(CONFIG.policy, seed)
    return fit(network, frames, CONFIG.training, CONFIG.policy, 2, order, 500).network


@pytest.mark.parametrize(("size", "episodes"), [(0, 3), (1, 13), (2, 22)])
def test_cloning_at_each_size_is_from_scratch_on_the_first_whole_episodes(runs, size, episodes):
    """700 frames are three episodes of 200, 2600 are thirteen: both end within a shard of four."""
    run = runs("behavior_cloning")
    frames = run.dataset.load()
    first = frames[frames.episode < episodes]
    assert len(first) == 200 * episodes == figures_of(run, "train", size)["frames"]
    policy = load(run.policy(size))
    assert policy.provenance["dataset_hash"] == first.hash
    for key, tensor in scratch(run, size, first).state_dict().items():
        assert torch.equal(tensor, policy.network.state_dict()[key]), key


def test_episodes_that_failed_do_not_count_in_the_series(tmp_path, monkeypatch):
    """Episode 1 is lost: 600 frames are episodes 0, 2 and 3."""
    monkeypatch.setattr("surefoot.episodes.make_simulator", Worlds({"lost": {1: 50}}))
    method = BehaviorCloningConfig(data=FIRST, epochs=2, frames=(600, 799, 800))
    run = run_method(tmp_path, replace(CONFIG, method=method))
    frames = run.dataset.load()
    assert 1 not in frames.episode and figures_of(run, "collect", 0)["failed_episodes"] == [1]
    for size, ids in enumerate([[0, 2, 3], [0, 2, 3], [0, 2, 3, 4]]):
        first = frames[np.isin(frames.episode, ids)]
        assert load(run.policy(size)).provenance["dataset_hash"] == first.hash


# --- DAGGER


def test_daggers_coin_is_thrown_at_every_tick_for_every_episode(runs):
    run = runs("dagger")
    assert replayed(run, 0)[0][1].expert_drove.all()  # beta_1 = 1
    drove = {}
    for i, p in ((1, 0.6), (2, 0.36)):
        ((job, record),) = replayed(run, i)
        assert job.ask_always
        for b, episode in enumerate(job.episode.tolist()):
            throws = record.expert_drove[b, : record.length[b]]
            n, change = len(throws), 2 * p * (1 - p)
            drove[episode] = throws
            assert n >= 500
            assert abs(throws.mean() - p) < 4 * np.sqrt(p * (1 - p) / n)
            changes = (throws[1:] != throws[:-1]).mean()
            assert abs(changes - change) < 6 * np.sqrt(change * (1 - change) / n)
        # Two episodes agree as often as two coins do.
        one, other = (drove[e][:500] for e in job.episode[:2].tolist())
        alike = p * p + (1 - p) * (1 - p)
        assert abs((one == other).mean() - alike) < 4 * np.sqrt(alike * (1 - alike) / 500)
    ticks = np.concatenate(list(drove.values()))
    assert 0.3 < ticks.mean() < 0.7


def shifted(job, by):
    """The same rollouts, each begun between two ticks of the grid."""
    return replace(job, starts=replace(job.starts, tick=job.starts.tick + by))


def test_dagger_plans_on_the_grid_wherever_it_begins_and_whoever_drives(runs):
    job = shifted(collection(runs("dagger"), 2), 17)
    record, _ = play_out(job)
    assert not record.expert_drove.all(axis=1).any()
    torque = answers(record, record.happened)
    given = record.expert_torque[record.happened]
    np.testing.assert_allclose(given, torque[record.happened], rtol=0, atol=1e-9)
    drove = record.expert_drove & record.happened
    np.testing.assert_array_equal(record.torque[drove], record.expert_torque[drove])
    policy = record.happened & ~drove
    assert (np.abs(record.torque - record.expert_torque)[policy].max(-1) > 1e-6).mean() > 0.9


# --- LocoDAGGER


@pytest.mark.parametrize("by", [0, 17])
@pytest.mark.parametrize("alpha", [0.5, 0.8])
def test_locodaggers_coin_is_thrown_once_per_expert_period(runs, alpha, by):
    run = runs(f"loco_dagger-{alpha}")
    assert replayed(run, 1)[0][1].expert_drove.all()  # alpha^0 = 1
    method = replace(run.config.method, velocities=10, perturbations=6, T=0.3)
    many = Run(run.folder, replace(run.config, method=method))
    job = shifted(replace(collection(many, 2), then=None), by)
    record, _ = play_out(job)
    assert (record.length == 300).all()
    throws = []
    for b in range(60):
        drove, clock = record.expert_drove[b], job.starts.tick[b] + np.arange(300)
        changes = 1 + np.flatnonzero(drove[1:] != drove[:-1])
        assert (clock[changes] % GRID == 0).all()
        throws.append(drove[(clock % GRID == 0) | (np.arange(300) == 0)])
    throws = np.array(throws)
    assert throws.shape == (60, 6 if by == 0 else 7)
    sd = np.sqrt(alpha * (1 - alpha))
    assert abs(throws.mean() - alpha) < 4 * sd / np.sqrt(throws.size)
    assert abs(throws[:, 0].mean() - alpha) < 4 * sd / np.sqrt(60)  # the first tick is a throw
    assert len(np.unique(throws, axis=0)) > 10


def test_the_share_of_iteration_i_is_alpha_to_the_i_minus_one(runs):
    run = runs("loco_dagger-0.5")
    for i, share in ((1, 1.0), (2, 0.5), (3, 0.25), (4, 0.125)):
        coin = collection(run, i).arbiter
        assert isinstance(coin, RandomMix)
        ids, still = np.arange(2000), np.zeros(2000, int)
        coin.reset(ids)
        nobody: State = None  # type: ignore[assignment]
        said = [coin.choose(nobody, still + 50 * t, np.zeros((2000, 3))) for t in range(20)]
        sd = np.sqrt(share * (1 - share) / 40_000)
        assert abs(np.mean(said) - share) <= 4.5 * sd


@pytest.mark.parametrize("alpha", [0.5, 0.8])
@pytest.mark.parametrize("i", [1, 2])
def test_queries_are_of_states_that_the_rollout_visited(runs, alpha, i):
    run = runs(f"loco_dagger-{alpha}")
    method = run.config.method
    (job, record), (queries, answered) = replayed(run, i)
    N, T = method.N_query, round(1000 * method.T_query)
    assert len(queries.starts) == N * len(job.starts)
    assert len(np.unique([*queries.episode, *job.episode])) == (N + 1) * len(job.starts)
    assert answered.duration == T and answered.expert_drove.all()
    seen = []
    for n, first in enumerate(queries.episode.tolist()):
        b = n // N
        start = queries.starts[n : n + 1]
        elapsed = int(start.tick[0] - record.starts.tick[b])
        seen.append(elapsed)
        failed = record.outcome[b] == Outcome.FELL
        assert 0 <= elapsed <= record.length[b] - (200 if failed else 1)
        assert start.tick[0] % GRID == 0
        np.testing.assert_array_equal(start.q[0, 2:], record.q[b, elapsed, 2:])
        np.testing.assert_array_equal(start.v[0], record.v[b, elapsed])
        np.testing.assert_array_equal(start.command[0], record.starts.command[b])
        np.testing.assert_array_equal(answered.q[n, 0], start.q[0])
        assert first // 100_000 == i
    assert len(set(seen)) > 5
    figures = figures_of(run, "collect", i)
    assert figures["queries"] == N * len(job.starts)
    failures = int((answered.outcome == Outcome.FELL).sum())
    assert figures["queries_failed"] == failures
    frames = kept_in(run, i)
    assert len(frames) == (len(queries.starts) - failures) * T == figures["frames_kept"]
    assert set(frames.episode) <= set(queries.episode)


# --- one iteration in a world made for it


def one_iteration(folder, monkeypatch, method, *scripts, safety=HEIGHT_ONLY, i=1):
    """Iteration i on a policy of random weights; only the height of the base can be unsafe."""
    config = replace(CONFIG, method=method, chunk=40, safety=safety, collection=DisturbanceConfig())
    run = create(folder / "run", config)
    network = PolicyNetwork(config.policy, 1)
    save(Policy(network, config.policy, 500, np.zeros((2, 3))), run.policy(i - 1))
    for script in scripts:
        given = script.get("heights", {})
        script["heights"] = {b: given.get(b, [(0, FLAT.height)]) for b in range(40)}
    monkeypatch.setattr("surefoot.episodes.make_simulator", Worlds(*scripts))
    figures = collect(run, i, collection(run, i), Workers(1))
    monkeypatch.setattr("surefoot.episodes.make_simulator", Worlds(*scripts))
    return run, figures, replayed(run, i)


def spells(*intervals):
    """Heights of a robot that is low, or fallen, from tick to tick and else at its height."""
    steps = [(0, FLAT.height)]
    for begin, end, height in intervals:
        steps += [(begin, height), (end, FLAT.height)]
    return steps


LOW, FALLEN, NEVER = FLAT.low, FLAT.fallen, 10**6
RESCUE = LocoSafeDaggerConfig(
    pretraining=FIRST, iterations=3, velocities=5, perturbations=2, T=0.6, T_block=0.1, T_end=0.08
)
VIOLATIONS = {
    1: spells((100, 110, LOW)),
    2: spells((100, 110, LOW), (190, 230, LOW)),
    3: spells((100, 350, LOW)),
    4: spells((580, 600, LOW)),
    5: spells((0, 5, LOW)),
    6: spells((599, 601, LOW)),
    7: spells((600, 650, LOW)),
    8: spells((100, 101, LOW), (199, 200, LOW), (300, 301, LOW)),
    9: spells((100, 101, LOW), (200, 201, LOW)),
}
TAIL = (600, 679)
BLOCKS = {
    "safe_and_blocked": [
        [TAIL],
        [(100, 199), TAIL],
        [(100, 229), TAIL],
        [(100, 349), TAIL],
        [(580, 679)],
        [(0, 99), TAIL],
        [(599, 679)],
        [TAIL],
        [(100, 199), (300, 399), TAIL],
        [(100, 200), TAIL],
    ],
    "every_violation_restarts": [
        [TAIL],
        [(100, 208), TAIL],
        [(100, 328), TAIL],
        [(100, 448), TAIL],
        [(580, 679)],
        [(0, 103), TAIL],
        [(599, 679)],
        [TAIL],
        [(100, 298), (300, 399), TAIL],
        [(100, 299), TAIL],
    ],
    "safe_or_blocked": [
        [TAIL],
        [(100, 109), TAIL],
        [(100, 109), (190, 229), TAIL],
        [(100, 199), (201, 300), (302, 349), TAIL],
        [(580, 679)],
        [(0, 4), TAIL],
        [(599, 679)],
        [TAIL],
        [(100, 100), (199, 199), (300, 300), TAIL],
        [(100, 100), (200, 200), TAIL],
    ],
}


@pytest.mark.parametrize("rule", BLOCKS)
def test_blocks_to_the_tick(tmp_path, monkeypatch, rule):
    method = replace(RESCUE, hand_back=rule)
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, method, {"heights": VIOLATIONS}
    )
    assert [spans(drove) for drove in record.expert_drove] == BLOCKS[rule]
    assert (record.length == 680).all()
    frames = run.dataset.load()
    assert frames.expert_drove.all()
    for b, episode in enumerate(job.episode):
        ticks = frames.tick[frames.episode == episode] - record.starts.tick[b]
        kept = [t for first, last in BLOCKS[rule][b] for t in range(first, last + 1)]
        assert ticks.tolist() == kept
    blocks = [
        [min(last, 599) - first + 1 for first, last in row if first < 600] for row in BLOCKS[rule]
    ]
    assert figures["takeovers"] == sum(map(len, blocks))
    assert figures["expert_share"] == sum(map(sum, blocks)) / 6000
    assert figures["expert_share_with_tail"] == (sum(map(sum, blocks)) + 800) / 6800
    assert figures["frames_kept"] == len(frames) == sum(map(sum, blocks)) + 800
    torque = answers(record, record.expert_drove)[record.expert_drove]
    np.testing.assert_allclose(record.torque[record.expert_drove], torque, rtol=0, atol=1e-9)


FALLS = [
    # heights, length, what is kept, who drove at the end and half a second before
    (spells((100, 110, LOW), (640, NEVER, FALLEN)), 640, [(100, 199)], "Xx"),  # in the tail
    (spells((100, 110, LOW), (560, 570, LOW), (640, NEVER, FALLEN)), 640, [(100, 199)], "Xx"),
    (spells((100, 110, LOW), (520, 521, LOW), (521, NEVER, FALLEN)), 521, [(100, 199)], "X."),
    (spells((100, 110, LOW), (530, NEVER, FALLEN)), 530, [(100, 199)], ".."),  # no takeover
    (spells((200, 400, FALLEN)), 680, [(200, 399), TAIL], ""),  # up again within the grace
    (spells((100, 110, LOW), (300, NEVER, FALLEN)), 500, [(100, 199)], "X."),
    (spells((450, 500, FALLEN)), 680, [(450, 549), TAIL], ""),  # up again at its last tick
    (spells((450, 501, FALLEN)), 500, [], "X."),
    (spells((680, NEVER, FALLEN)), 680, [], "X."),  # after the last tick of the tail
    (spells((600, NEVER, FALLEN)), 600, [], ".."),  # before its first
]


def test_robots_that_fall_in_the_tail_at_takeover_and_in_the_grace(tmp_path, monkeypatch):
    heights = {b: case[0] for b, case in enumerate(FALLS)}
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, RESCUE, {"heights": heights}
    )
    assert record.length.tolist() == [case[1] for case in FALLS]
    fell = np.array([bool(case[3]) for case in FALLS])
    np.testing.assert_array_equal(record.outcome, np.where(fell, Outcome.FELL, Outcome.SUCCESS))
    frames = run.dataset.load()
    for b, (_, _, spans_kept, _) in enumerate(FALLS):
        ticks = frames.tick[frames.episode == job.episode[b]] - record.starts.tick[b]
        assert ticks.tolist() == [t for a, z in spans_kept for t in range(a, z + 1)], b
    assert figures["falls"] == fell.sum() == 8
    assert figures["falls_in_tail"] == 3
    assert figures["falls_expert_driving"] == sum(case[3][:1] == "X" for case in FALLS) == 6
    # Half a second before: ticks 139 and 139, within the first block, for the two in the tail.
    assert figures["falls_expert_driving_before"] == sum(case[3][1:] == "x" for case in FALLS) == 2
    assert figures["failed_episodes"] == job.episode[fell].tolist()
    assert figures["frames_kept"] == len(frames)
    summary = load_arrays(run.summary("iteration_001-000"), Summary)
    assert summary.takeovers.tolist() == [1, 2, 2, 1, 1, 2, 1, 1, 0, 0]
    assert summary.expert_ticks.tolist() == [100, 140, 101, 100, 200, 300, 100, 50, 0, 0]


def test_a_robot_lost_at_any_tick_is_a_fall_and_its_block_goes(tmp_path, monkeypatch):
    heights = {0: spells((10, 20, LOW)), 1: spells((10, 20, LOW)), 2: spells((10, 20, LOW))}
    lost = {0: 50, 1: 111, 2: 110, 3: 0}
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, RESCUE, {"heights": heights, "lost": lost}
    )
    assert record.length.tolist() == [50, 111, 110, 0] + [680] * 6
    frames = run.dataset.load()
    count = [int((frames.episode == e).sum()) for e in job.episode]
    assert count == [0, 100, 0, 0] + [80] * 6
    assert figures["falls"] == 4


FAILING = (100, 110, 150, 300, 500, 550)


def failing(state, tick, command):
    """The toy's plan, which is not valid at some ticks of the gait clock."""
    return replace(plan(state, tick, command), valid=tick not in FAILING)


DIVERGING = [
    # the takeover, the end, what is kept, plans and how many of them were not valid
    (110, 110, [], 1, 1),  # none at the takeover
    (30, 150, [], 4, 2),  # the second in a row
    (260, 680, [(260, 459), TAIL], 5 + 2, 1),  # one is bridged by the last one's second half
    (200, 550, [(200, 399)], 4 + 3, 3),  # and an earlier block is kept
]


def test_divergence_at_a_takeover_and_within_a_block(tmp_path, monkeypatch):
    heights = {b: spells((case[0], case[0] + 5, LOW)) for b, case in enumerate(DIVERGING)}
    heights[3] = spells((200, 205, LOW), (450, 455, LOW))

    def from_zero(run, i, plan):
        job = loco_safe_dagger.collection(run, i, failing)
        return replace(job, starts=replace(job.starts, tick=np.zeros(10, int)))

    monkeypatch.setitem(COLLECTION, "loco_safe_dagger", from_zero)
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, replace(RESCUE, T_block=0.2), {"heights": heights}
    )
    summary, frames = load_arrays(run.summary("iteration_001-000"), Summary), run.dataset.load()
    for b, (_, end, kept, plans, invalid) in enumerate(DIVERGING):
        assert record.length[b] == end
        assert record.outcome[b] == (Outcome.SUCCESS if end == 680 else Outcome.DIVERGED)
        ticks = frames.tick[frames.episode == job.episode[b]]
        assert ticks.tolist() == [t for first, last in kept for t in range(first, last + 1)]
        assert (summary.plans[b], summary.invalid_plans[b]) == (plans, invalid)
    drove = record.expert_drove & record.happened
    torque = answers(record, drove, FAILING)
    np.testing.assert_allclose(record.torque[drove], torque[drove], rtol=0, atol=1e-9)
    assert (figures["diverged"], figures["falls"]) == (3, 0)
    assert figures["failed_episodes"] == job.episode[[0, 1, 3]].tolist()


@pytest.mark.parametrize("i", [1, 2, 3])
def test_relaxing_bounds_end_as_in_the_table(tmp_path, monkeypatch, i):
    """Shares 0.5, 0.75, 1 of the 5 cm between the trot's height and the table's 0.15 m."""
    bounds = [0.175, 0.1625, 0.15]
    centre = [0.176, 0.174, 0.163, 0.162, 0.151, 0.149]
    heights = {b: spells((100, 110, z + 0.01)) for b, z in enumerate(centre)}
    method = replace(RESCUE, guard=("relaxing",), tightest=0.5)
    _, _, ((_, record),) = one_iteration(tmp_path, monkeypatch, method, {"heights": heights}, i=i)
    for b, z in enumerate(centre):
        assert spans(record.expert_drove[b]) == (
            [(100, 199), TAIL] if z < bounds[i - 1] else [TAIL]
        )


@pytest.mark.parametrize("i", [1, 2])
def test_any_of_several_gates_blocks(runs, i):
    """In the finished run: bounds that relax, or the classifier that was trained before."""
    run = runs("loco_safe_dagger")
    ((_, record),) = replayed(run, i)
    by_network = alarms(load_classifier(run.gate("classifier", i - 1)), record, ALARM)
    share = {1: 0.6, 2: 1.0}[i]
    by_bounds, T = outside(record, share), record.duration
    for b, length in enumerate(np.minimum(record.length, T).tolist()):
        expected = driven((by_bounds | by_network)[b], 150, T)
        np.testing.assert_array_equal(record.expert_drove[b, :length], expected[:length])
    happened = record.happened
    assert (by_bounds & ~by_network & happened).any() and (by_network & ~by_bounds & happened).any()
    assert (record.expert_drove[:, T:] | ~happened[:, T:]).all()
    assert set((record.length - T)[~record.failed]) == {100}


# --- LocoDAGGER: rollouts that end early, queries that fail


QUERY = LocoDaggerConfig(
    pretraining=FIRST, iterations=2, velocities=3, perturbations=2, T=0.7, N_query=3, T_query=0.52
)


def test_queries_of_rollouts_that_ended_early_and_queries_that_fail(tmp_path, monkeypatch):
    main = {
        "heights": {1: spells((550, NEVER, FALLEN)), 4: spells((300, NEVER, FALLEN))},
        "lost": {2: 150, 3: 201, 5: 200},
    }
    # Robots 2 and 5 have no state 0.2 s before their end, robot 3 has its first.
    asked = {"heights": {4: spells((500, NEVER, FALLEN))}, "lost": {7: 10}}
    run, figures, ((_, record), (queries, answered)) = one_iteration(
        tmp_path, monkeypatch, QUERY, main, asked
    )
    assert record.length.tolist() == [700, 550, 150, 201, 500, 200]
    rows = [b for b in (0, 1, 3, 4) for _ in range(3)]
    base = 100_000
    ids = [base + 10_000 + 3 * b + j for b in (0, 1, 3, 4) for j in range(3)]
    assert queries.episode.tolist() == ids
    elapsed = queries.starts.tick - record.starts.tick[rows]
    assert (elapsed % GRID == 0).all() and (elapsed >= 0).all()
    latest = np.array([699, 350, 1, 300])[[0, 1, 2, 3]].repeat(3)
    assert (elapsed <= latest).all() and (elapsed[6:9] == 0).all()
    assert elapsed[:3].max() > 350  # whoever did not fall is asked about its whole rollout
    assert answered.length.tolist() == [520] * 4 + [500, 520, 520, 10] + [520] * 4
    frames = run.dataset.load()
    good = [e for n, e in enumerate(ids) if n not in (4, 7)]
    assert np.unique(frames.episode).tolist() == good
    assert len(frames) == 10 * 520 == figures["frames_kept"]
    assert (figures["queries"], figures["queries_failed"], figures["falls"]) == (12, 2, 5)


def test_no_queries_if_every_rollout_ended_too_early(tmp_path, monkeypatch):
    lost = {"lost": dict.fromkeys(range(6), 200)}
    run, figures, pairs = one_iteration(tmp_path, monkeypatch, QUERY, lost)
    assert len(pairs) == 1
    assert (figures["queries"], figures["frames_kept"], run.dataset.frames) == (0, 0, 0)
    assert (figures["falls"], figures["takeovers"]) == (6, 0)  # iteration 1 is the expert's


# --- SafeDAGGER


def deviations(run, i, frames):
    """(n,) squared deviation of policy i from the labels, each joint by its label's sigma."""
    policy = load(run.policy(i))
    state = State(frames.q, frames.v, frames.com, frames.feet, frames.contacts)
    inputs = torch.from_numpy(network_input(state, frames.tick, frames.command, 500))
    with torch.no_grad():
        target = policy.network(inputs).numpy().astype(float)
    kp, kd = CONFIG.policy.kp, CONFIG.policy.kd
    label = (frames.torque + kd * frames.v[:, 6:]) / kp + frames.q[:, 7:]
    return target - label, label


def test_tau_is_the_quantile_asked_for_of_the_frames_held_out(runs):
    run = runs("safe_dagger")
    frames = kept_in(run, 0)
    error, label = deviations(run, 0, frames)
    done = figures_of(run, "guard_classifier", 0)
    np.testing.assert_allclose(done["sigma"], label.std(axis=0), rtol=1e-4)
    apart = held_out(frames.episode, CONFIG.training.validation)
    assert 0 < apart.sum() < len(frames)
    deviation = ((error / label.std(axis=0)) ** 2).sum(axis=1)
    assert (deviation[apart] > done["tau"]).mean() == pytest.approx(0.3, abs=2 / apart.sum())
    assert done["tau"] == pytest.approx(np.quantile(deviation[apart], 0.7), rel=1e-3)
    for i in (1, 2):  # the same tau and sigma for every policy
        later = figures_of(run, "guard_classifier", i)
        assert (later["tau"], later["sigma"]) == (done["tau"], done["sigma"])


@pytest.mark.parametrize("i", [0, 1, 2])
def test_pi_safe_learns_from_all_data_so_far_without_the_frames_that_judge_it(runs, i):
    run = runs("safe_dagger")
    frames = run.dataset.load()
    frames = frames[frames.episode // 100_000 <= i]
    done = figures_of(run, "guard_classifier", i)
    judges = held_out(frames.episode, CONFIG.training.validation) & (frames.episode % 2 == 1)
    assert done["rows"] == (~judges).sum() and done.get("held_out", 0) == judges.sum()
    error, _ = deviations(run, i, frames)
    yes = ((error / done["sigma"]) ** 2).sum(axis=1) > done["tau"]
    assert done["share_yes"] == pytest.approx(yes[~judges].mean(), abs=1e-3)
    assert 0.0 < done["share_yes"] < 1.0


@pytest.mark.parametrize("i", [1, 2])
def test_the_expert_drives_exactly_where_pi_safe_says_unsafe(runs, i):
    run = runs("safe_dagger")
    ((job, record),) = replayed(run, i)
    said = alarms(load_classifier(run.gate("classifier", i - 1)), record, 0.5)
    happened = record.happened
    np.testing.assert_array_equal(record.expert_drove[happened], said[happened])
    assert 0.02 < record.expert_drove[happened].mean() < 0.98
    frames = kept_in(run, i)
    for b, episode in enumerate(job.episode):
        length, unsafe = int(record.length[b]), said[b]
        if record.failed[b]:  # an unsafe spell that ends in a fall teaches how to fall
            unsafe = unsafe & ~last_block(unsafe, length)
        ticks = frames.tick[frames.episode == episode] - record.starts.tick[b]
        assert ticks.tolist() == np.flatnonzero(unsafe[:length]).tolist()


def test_pi_safe_comes_back_and_guards_at_run_time(runs):
    run = runs("safe_dagger")
    winner = figures_of(run, "best", 0)["best_iteration"]
    classifier = load_classifier(run.gate("classifier", winner))
    switch = SafetySwitch(SafetyMonitor(Deviation(classifier, run.config, 0.5), block=0.0))
    starts = load_starts()["test"][:8]
    job = Job(run.config, starts, starts.id, switch, 0.3, policy=run.best_policy, plan=plan)
    record, _ = play_out(job)
    np.testing.assert_array_equal(record.expert_drove, alarms(classifier, record, 0.5))
    assert 0.0 < record.expert_drove.mean() < 1.0


# --- pushes


def pushed(folder, collection):
    config = replace(CONFIG, method=SMALL_METHODS["loco_safe_dagger"], collection=collection)
    run = run_method(folder, config)
    return {**bits(run), "episodes": [run.summary(s).read_bytes() for s in run.dataset.shards]}


def test_a_push_of_zero_changes_no_bit(tmp_path):
    none = pushed(tmp_path / "a", DisturbanceConfig())
    assert pushed(tmp_path / "b", DisturbanceConfig(pushes=3, impulse=(0.0, 0.0))) == none
    assert pushed(tmp_path / "c", DisturbanceConfig(pushes=3, impulse=(0.1, 0.1))) != none


def kicks(job, record, b):
    """(length - 1,) what changed a robot's roll rate besides gravity and torques [rad/s]."""
    n = int(record.length[b]) - 1
    q, v, torque = (getattr(record, name)[b] for name in ("q", "v", "torque"))
    expected = v[:n, 3] + toy.DT * (toy.GRAVITY * angles(q[:n])[:, 0] + torque[:n] @ toy.ARM)
    return v[1 : n + 1, 3] - expected


def test_pushes_of_an_episode_depend_on_seed_and_id_alone(runs):
    """Found again in the motion of the robots of three methods that drive differently."""
    ids = 200_000 + np.arange(6)
    names = ("dagger", "safe_dagger", "loco_safe_dagger", "loco_dagger-0.5")
    pairs = [replayed(runs(name), 2)[0] for name in names]
    pushes = draw(CONFIG.collection, CONFIG.seed, ids, 0.7, 0.5).pushes
    assert pushes is not None
    felt = 0
    for job, record in pairs:
        assert job.episode.tolist() == ids.tolist()
        for b in range(6):
            yaw = Rotation.from_quat(record.q[b, 0, 3:7]).as_euler("ZYX")[0]
            across = pushes.impulse[b] @ [np.sin(yaw), np.cos(yaw), 0.0]
            found = kicks(job, record, b)
            expected = np.zeros(len(found))
            for size, tick in zip(across, pushes.tick[b], strict=True):
                expected[tick : tick + 10] += toy.KICK * size / 10
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
            felt += np.abs(expected).max() > 1e-3
    assert felt > 12
    for b, id_ in enumerate(ids):  # whoever else is drawn for
        alone = draw(CONFIG.collection, CONFIG.seed, np.array([7, id_]), 0.7, 0.5).pushes
        assert alone is not None
        np.testing.assert_array_equal(alone.impulse[1], pushes.impulse[b])
        np.testing.assert_array_equal(alone.tick[1], pushes.tick[b])
    other = draw(CONFIG.collection, CONFIG.seed + 1, ids, 0.7, 0.5).pushes
    assert other is not None and (other.impulse != pushes.impulse).any(axis=(1, 2)).all()
    assert len(np.unique(pushes.impulse[:, 0, 0])) == 6


def test_pushes_grow_from_gentle_to_whole(runs):
    """The first of two iterations has half of what its episodes would draw."""
    ((job, record),) = replayed(runs("dagger"), 1)
    pushes = draw(CONFIG.collection, CONFIG.seed, job.episode, 0.7, 0.5).pushes
    assert pushes is not None
    for b in range(6):
        yaw = Rotation.from_quat(record.q[b, 0, 3:7]).as_euler("ZYX")[0]
        across = pushes.impulse[b] @ [np.sin(yaw), np.cos(yaw), 0.0]
        n = len(found := kicks(job, record, b))
        expected = np.zeros(n)
        for size, tick in zip(across, pushes.tick[b], strict=True):
            expected[tick : tick + 10] += 0.5 * toy.KICK * size / 10
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


# --- what would fail after the pre-training


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("dagger", {"p": 1.5}, "method.p is 1.5; use 0.0 to 1.0"),
        ("loco_dagger-0.5", {"alpha": -0.1}, "method.alpha is -0.1"),
        ("loco_dagger-0.5", {"N_query": 0}, "method.N_query is 0; use 1 to 600"),
        ("loco_dagger-0.5", {"N_query": 1000}, "method.N_query is 1000"),
        ("loco_dagger-0.5", {"T_query": 0.0}, "method.T_query is 0.0"),
        ("loco_dagger-0.5", {"before_fall": -1.0}, "method.before_fall is -1.0"),
        ("safe_dagger", {"unsafe_share": 20.0}, "method.unsafe_share is 20.0"),
        ("loco_safe_dagger", {"T_end": -0.1}, "method.T_end is -0.1"),
        ("loco_safe_dagger", {"T_block": -0.1}, "method.T_block is -0.1"),
        ("loco_safe_dagger", {"tightest": 1.1}, "method.tightest is 1.1"),
        ("loco_safe_dagger", {"alarm": 30.0}, "method.alarm is 30.0"),
        ("loco_safe_dagger", {"guard": ("bound",)}, "no guard 'bound'; did you mean 'bounds'"),
    ],
)
def test_what_would_fail_late_fails_before_any_work(tmp_path, name, change, message):
    config = replace(CONFIG, method=replace(METHODS[name], **change))
    with pytest.raises(ValueError, match=message):
        run_method(tmp_path, config)
    run = Run(tmp_path / "run", config)
    assert run.metrics == [] and run.dataset.shards == ()


@pytest.mark.parametrize("name", ["safe_dagger", "loco_safe_dagger"])
def test_tau_needs_frames_held_out(tmp_path, name):
    training = replace(CONFIG.training, validation=0.0)
    with pytest.raises(ValueError, match=r"training\.validation is 0, but tau"):
        run_method(tmp_path, replace(CONFIG, method=METHODS[name], training=training))
