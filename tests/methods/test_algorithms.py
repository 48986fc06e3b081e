"""Every algorithm on a toy with a known answer: what enters the dataset, labelled and counted.

Whoever is asked, in whatever chunks, however often it is killed. Next: ``test_algorithms_coins``
(BC, DAGGER, LocoDAGGER), ``_gates`` (SafeDAGGER), ``_worlds`` and ``_pushes``.
"""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.files import load_arrays
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job, run_chunk
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.run import Run, create, open_run
from surefoot.scenarios.starts import load_starts
from surefoot.workers import Workers
from tests.fakes import toy
from tests.fakes.runs import figures_of, fingerprint
from tests.fakes.toy import Worlds, plan
from tests.fakes.toy_runs import (
    CONFIG,
    GRID,
    METHODS,
    RUN,
    SAFETY,
    SMALL_METHODS,
    answers,
    has_fallen,
    kept,
    kept_in,
    replayed,
    run_method,
)

pytestmark = pytest.mark.usefixtures("toys")
every_method = pytest.mark.parametrize("name", METHODS)
in_every_iteration = pytest.mark.parametrize(
    ("name", "i"),
    [
        ("behavior_cloning", 0),
        *((n, i) for n in METHODS if n != "behavior_cloning" for i in (1, 2)),
    ],
)


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
        summary = join_summaries([load_arrays(run.summary_path(name), Summary) for name in shards])
        count = {e: int((frames.episode == e).sum()) for e in summary.episode.tolist()}
        assert summary.kept.tolist() == list(count.values())
        assert len(frames) == sum(count.values()) == figures_of(run, "collect", i)["frames_kept"]
        running += len(frames)
        assert figures_of(run, "collect", i)["dataset_frames"] == running
        ids += summary.episode.tolist()
    assert len(set(ids)) == len(ids)
    assert run.dataset.frames == running
    assert run.dataset.episodes == len(np.unique(run.dataset.load().episode))


# --- the same bits


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
    one, other = fingerprint(run), fingerprint(small(name))
    if name == "loco_dagger":
        assert one["data"] == other["data"]
        stages = [[m for m in each["metrics"] if m["stage"] == "collect"] for each in (one, other)]
        assert stages[0] == stages[1]
    else:
        assert one == other
    summaries = []
    for each in (run, small(name)):
        summary = join_summaries(
            [load_arrays(each.summary_path(shard), Summary) for shard in each.dataset.shards]
        )
        summaries.append(vars(summary[np.argsort(summary.episode)]))
    for field, array in summaries[0].items():
        np.testing.assert_array_equal(array, summaries[1][field], err_msg=field)


def test_what_would_have_been_after_the_end_counts_for_nothing(monkeypatch):
    """A robot lost 10 ms after a touchdown has the same summary alone and in company."""
    starts, summaries = load_starts()["train"][:2], []
    for batch in (1, 2):
        monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds({"lost": {0: 510}}))
        some = starts[:batch]
        job = Job(CONFIG, Episodes(some, 1.1), ExpertOnly(), plan=plan)
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

    # The whole run first: its records must not die.
    stages = [(line["stage"], line["iteration"]) for line in small(name).metrics]
    monkeypatch.setattr(Run, "record", record_and_die)
    for _ in range(2 * len(stages)):
        with pytest.raises(Killed):
            RUN[name](create(tmp_path / "run", config, resume=True), Workers(1), plan)
    RUN[name](create(tmp_path / "run", config, resume=True), Workers(1), plan)
    assert deaths == [stage for stage in stages for _ in range(2)]
    assert fingerprint(open_run(tmp_path / "run")) == fingerprint(small(name))


# --- what would fail after the pre-training


@pytest.mark.parametrize("name", ["safe_dagger", "loco_safe_dagger"])
def test_tau_needs_frames_held_out(tmp_path, name):
    training = replace(CONFIG.training, validation=0.0)
    with pytest.raises(ValueError, match=r"training\.validation is 0, but tau"):
        run_method(tmp_path, replace(CONFIG, method=METHODS[name], training=training))
