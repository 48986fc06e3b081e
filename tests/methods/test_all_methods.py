"""Every method on a toy with a known answer: what enters D, what it cost, the same bits.

The expected frames, targets and counts are computed by the tests (``fakes/toy_runs.py``).
"""

from dataclasses import replace

import numpy as np
import pytest

import surefoot.config
import surefoot.methods
from surefoot.config.array_io import load_arrays
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, run_chunk
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.run import Run, open_run
from surefoot.scenarios.starts import load_starts
from tests.cases import first_often
from tests.fakes import toy
from tests.fakes.killed import Killed
from tests.fakes.runs import collected, fingerprint, stages_of
from tests.fakes.toy import Worlds, plan
from tests.fakes.toy_runs import (
    CONFIG,
    GRID,
    METHODS,
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

in_every_iteration = pytest.mark.parametrize(
    ("name", "i"),
    [
        ("behavior_cloning", 0),
        *((n, i) for n in METHODS if n != "behavior_cloning" for i in (1, 2)),
    ],
)


def test_every_method_has_parameters_of_its_name():
    assert list(surefoot.methods.METHODS) == list(surefoot.config.METHODS)


@in_every_iteration
def test_the_dataset_is_what_the_method_keeps_with_the_experts_targets(runs, name, i):
    """Every array of every frame; and nothing else."""
    run = runs(name)
    total = 0
    frames = kept_in(run, i)
    assert len(frames)
    for part, (job, rollouts) in enumerate(replayed(run, i)):
        keep = kept(run, i, part, rollouts)
        asked = rollouts.happened if run.method == "dagger" and i else rollouts.expert_drove
        torque = answers(rollouts, asked)
        drove = rollouts.expert_drove & rollouts.happened
        np.testing.assert_allclose(rollouts.torque[drove], torque[drove], rtol=0, atol=1e-9)
        for b, episode in enumerate(job.episode):
            own = frames[frames.episode == episode]
            when = np.flatnonzero(keep[b])
            np.testing.assert_array_equal(own.tick, rollouts.starts.tick[b] + when)
            for field in ("q", "v", "com", "feet", "contacts", "expert_drove"):
                recorded = getattr(rollouts, field)[b, when]
                np.testing.assert_array_equal(getattr(own, field), recorded, err_msg=field)
            assert (own.command == rollouts.starts.command[b]).all()
            assert (own.outcome == rollouts.outcome[b]).all()
            np.testing.assert_allclose(own.torque, torque[b, when], rtol=0, atol=1e-9)
            total += len(when)
    assert total == len(frames)


@in_every_iteration
def test_the_cost_is_that_of_the_rollouts(runs, name, i):
    """Counted again, tick by tick; a fall is one by the test's own bounds and dynamics."""
    run = runs(name)
    cost = collected(run, i)
    pairs = replayed(run, i)
    takeovers = expert = policy = falls = 0
    rollouts = pairs[0][1]
    T = rollouts.duration
    for b in range(len(rollouts.length)):
        length = int(rollouts.length[b])
        before = None
        ticks = rollouts.expert_drove[b, : min(length, T)].tolist()
        for drove in ticks:
            takeovers += drove and before is False
            before = drove
        takeovers += ticks[0] and not all(ticks)
        expert = expert + sum(ticks)
        policy = policy + len(ticks) - sum(ticks)
        lies = has_fallen(rollouts.q[b, :length], SAFETY)
        assert not lies[500:].any()
        if rollouts.outcome[b] == Outcome.FELL:
            falls += 1
            q = rollouts.q[b, length - 1]
            v = rollouts.v[b, length - 1]
            x = toy.A @ toy.x_of(q, v) + toy.B @ rollouts.torque[b, length - 1]
            assert np.degrees(abs(x[0])) > 29.0  # a push may do the rest
        else:
            assert length == rollouts.q.shape[1]
    assert (cost.takeovers, cost.falls) == (takeovers, falls)
    assert cost.expert_share == pytest.approx(expert / (expert + policy), abs=1e-12)
    assert cost.episodes == len(rollouts.length)
    ticks = sum(int(r.length.sum()) for _, r in pairs)
    assert cost.robot_seconds == pytest.approx(ticks / 1000)
    drove = sum(int((r.expert_drove & r.happened).sum()) for _, r in pairs)
    assert cost.expert_seconds == pytest.approx(drove / 1000)
    plans = 0
    for _, each in pairs:
        asked = each.happened if run.method == "dagger" and i else each.expert_drove
        asked = asked & each.happened
        clock = each.starts.tick[:, None] + np.arange(asked.shape[1])
        fresh = np.concatenate([asked[:, :1], asked[:, 1:] & ~asked[:, :-1]], axis=1)
        plans += int((asked & (fresh | (clock % GRID == 0))).sum())
    assert (cost.plans, cost.invalid_plans) == (plans, 0)


@pytest.mark.parametrize("name", list(METHODS)[2:])
def test_all_iterative_methods_begin_with_the_same_data(runs, name):
    first = collected(runs("dagger"), 0)
    assert replace(collected(runs(name), 0), seconds=first.seconds) == first


@pytest.mark.parametrize("name", METHODS)
def test_shards_summaries_and_metrics_count_the_same_frames(runs, name):
    run = runs(name)
    running = 0
    ids = []
    for i in range(1 if run.method == "behavior_cloning" else 3):
        shards = [s for s in run.dataset.shards if s.startswith(f"iteration_{i:03d}")]
        frames = run.dataset.load(shards)
        summary = join_summaries([load_arrays(run.summary_path(name), Summary) for name in shards])
        count = {e: int((frames.episode == e).sum()) for e in summary.episode.tolist()}
        assert summary.kept.tolist() == list(count.values())
        assert len(frames) == sum(count.values()) == collected(run, i).frames_kept
        running += len(frames)
        assert collected(run, i).dataset_frames == running
        ids += summary.episode.tolist()
    assert len(set(ids)) == len(ids)
    assert run.dataset.frames == running
    assert run.dataset.episodes == len(np.unique(run.dataset.load().episode))


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


@pytest.mark.parametrize(
    ("name", "chunk"),
    first_often(1, [("loco_dagger", 3), *((name, 50) for name in SMALL_METHODS)]),
)
def test_results_do_not_depend_on_the_size_of_chunks(small, tmp_path, name, chunk):
    """Data and cost. A policy may: rows of a LocoDAGGER chunk come in another order."""
    run = run_method(tmp_path, replace(CONFIG, method=SMALL_METHODS[name], chunk=chunk))
    one = fingerprint(run)
    other = fingerprint(small(name))
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


def test_ticks_after_the_end_of_an_episode_do_not_count(monkeypatch):
    """A robot lost 10 ms after a touchdown has the same summary alone and in company."""
    starts = load_starts()["train"][:2]
    summaries = []
    for batch in (1, 2):
        monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds({"lost": {0: 510}}))
        job = Job(CONFIG, Episodes(starts[:batch], 1.1), ExpertOnly(), plan=plan)
        summaries.append(run_chunk(job).summary)
    assert summaries[0].ticks.tolist() == [510]
    assert summaries[0].strict.tolist() == [False] and summaries[1].strict.tolist()[1:] == [True]
    for field, array in vars(summaries[0]).items():
        np.testing.assert_array_equal(array, getattr(summaries[1], field)[:1], err_msg=field)


@pytest.mark.parametrize("name", first_often(1, reversed(SMALL_METHODS)))
def test_a_run_killed_before_and_after_each_record_ends_with_the_same_bits(
    small, tmp_path, monkeypatch, name
):
    config = replace(CONFIG, method=SMALL_METHODS[name])
    append_metrics = Run.append_metrics
    deaths = []

    def append_and_die(run, record):
        stage = (record.stage, record.iteration)
        moment = deaths.count(stage)
        deaths.append(stage)
        if moment == 1:
            append_metrics(run, record)
        if moment < 2:
            raise Killed
        return append_metrics(run, record)

    # The undisturbed run first: it must not be killed.
    stages = stages_of(small(name))
    monkeypatch.setattr(Run, "append_metrics", append_and_die)
    for _ in range(2 * len(stages)):
        with pytest.raises(Killed):
            run_method(tmp_path, config, resume=True)
    run_method(tmp_path, config, resume=True)
    assert deaths == [stage for stage in stages for _ in range(2)]
    assert fingerprint(open_run(tmp_path / "run")) == fingerprint(small(name))


@pytest.mark.parametrize("name", ["safe_dagger", "loco_safe_dagger"])
def test_tau_needs_frames_held_out(tmp_path, name):
    training = replace(CONFIG.training, validation=0.0)
    with pytest.raises(ValueError, match=r"training\.validation is 0, but tau"):
        run_method(tmp_path, replace(CONFIG, method=METHODS[name], training=training))
