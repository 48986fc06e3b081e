"""A budget of expert-seconds on the toy: what is spent, which rollouts count, the same bits."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

import surefoot.runs.collecting
from surefoot.config import BehaviorCloningConfig, BudgetConfig, Config, DaggerConfig, ExpertData
from surefoot.config.array_io import load_arrays
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import whole_episode
from surefoot.methods import METHODS as TRAINED
from surefoot.rollouts.jobs import run_chunk
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.budget import solves_of
from surefoot.runs.checks import check_config
from surefoot.runs.first_stage import first_stage
from surefoot.runs.layout import RunError
from surefoot.runs.run import Run, create, open_run
from surefoot.runs.sampling import draw_starts, expert_rollouts
from surefoot.runs.stages import collect_data
from surefoot.viz.replay import recorded_episode
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.killed import Killed
from tests.fakes.runs import collected, fingerprint, trained
from tests.fakes.small_runs import CLONING
from tests.fakes.toy import plan
from tests.fakes.toy_runs import CONFIG, METHODS, collection, kept_in, run_method

pytestmark = pytest.mark.usefixtures("toys")

BUDGET = BudgetConfig(expert_seconds=6.0, pretraining=0.4)
OFTEN = ["behavior_cloning", "loco_dagger-0.5", "loco_safe_dagger"]
"""One method without iterations, one that asks queries, and one in which the expert takes over."""
NAMES = [*OFTEN, *(name for name in METHODS if name not in (*OFTEN, "loco_dagger-0.8"))]


def config_of(name, budget=BUDGET, **changes) -> Config:
    method = METHODS[name]
    if name == "behavior_cloning":
        method = replace(method, frames=(700,), steps=9)
        budget = replace(budget, expert_seconds=min(budget.expert_seconds or 0.0, 3.0))
    else:
        method = replace(method, steps=7, pretraining_steps=12)
    return replace(CONFIG, method=method, budget=budget, chunk=4, **changes)


@pytest.fixture(scope="module")
def limited(tmp_path_factory):
    """A finished run of each method, with a budget."""
    done = {}

    def finished(name) -> Run:
        if name not in done:
            done[name] = run_method(tmp_path_factory.mktemp(name), config_of(name))
        return done[name]

    return finished


def iterations_of(run) -> range:
    return range(1 if run.method == "behavior_cloning" else 3)


def costs_of(run, i):
    """MPC solves of each rollout of an iteration's job, queries included, in the order of ids."""
    job = collection(run, i)
    summary = run_chunk(job).summary
    rollout = whole_episode(summary.episode)
    return job.episode, [summary.plans[rollout == each].sum() for each in job.episode]


@pytest.mark.parametrize("name", first_often(2, NAMES))
def test_each_collection_is_the_first_rollouts_that_its_share_of_what_is_left_pays_for(
    limited, name
):
    run = limited(name)
    left = 60 if run.method == "behavior_cloning" else 120  # solves of 3 and 6 s
    for i in iterations_of(run):
        share = left // (3 - i)
        if i == 0:
            share = 60 if run.method == "behavior_cloning" else 48
        ids, costs = costs_of(run, i)
        paid = np.cumsum(costs) <= share
        record = collected(run, i)
        assert paid.any() or i > 0
        assert not paid.all() or (run.method == "safe_dagger" and i > 0)
        assert record.episodes == paid.sum()
        assert record.plans == np.array(costs)[paid].sum() <= share
        assert record.allowed_seconds == pytest.approx(0.05 * share)
        assert record.spent_seconds == pytest.approx(0.05 * record.plans)
        assert set(whole_episode(kept_in(run, i).episode)) <= set(ids[paid])
        shards = [shard for shard in run.dataset.shards if shard.startswith(f"iteration_{i:03d}")]
        if shards:
            stored = join_summaries([load_arrays(run.summary_path(s), Summary) for s in shards])
            assert stored.episode[~stored.query].tolist() == ids[paid].tolist()
        left -= record.plans
    assert left >= 0


def test_the_log_says_what_is_spent_in_all(tmp_path, caplog):
    caplog.set_level("INFO", logger="surefoot")
    run = run_method(tmp_path, config_of("loco_dagger-0.5"))
    told = re.findall(r"([\d.]+) s of the budget spent in all", caplog.text)
    spent = [collected(run, i).spent_seconds or 0.0 for i in iterations_of(run)]
    assert len(told) == len(spent)
    assert [float(text) for text in told] == pytest.approx(np.cumsum(spent), abs=0.006)


@pytest.mark.parametrize("name", first_often(3, NAMES))
def test_all_trainings_take_the_steps_that_were_asked_for(limited, name):
    run = limited(name)
    records = [record for record in run.metrics if record.stage == "train"]
    if name == "behavior_cloning":
        assert [record.steps for record in records] == [9, 9]
    else:
        assert [record.steps for record in records] == [12, 7, 7]


@pytest.mark.parametrize(
    ("name", "workers", "chunk"),
    first_often(
        2,
        [
            ("behavior_cloning", 3, 4),
            ("loco_dagger-0.5", 2, 3),
            ("behavior_cloning", 2, 3),
            ("loco_dagger-0.5", 3, 4),
            ("dagger", 3, 4),
            ("dagger", 2, 3),
        ],
    ),
)
def test_a_budget_ends_at_the_same_rollout_for_any_workers_and_chunks(
    limited, tmp_path, monkeypatch, name, workers, chunk
):
    """In this process, but as many chunks at a time as there would be workers, done backwards."""
    other = fingerprint(limited(name))

    def backwards(function, chunks, _workers, _title):
        for number in reversed(range(len(chunks))):
            yield number, function(chunks[number])

    monkeypatch.setattr(surefoot.runs.collecting, "each_chunk", backwards)
    monkeypatch.setattr("surefoot.runs.stages.evaluate", in_one_process)
    config = replace(config_of(name), chunk=chunk)
    run = create(tmp_path / "run", config)
    TRAINED[run.method].train(run, Workers(workers), plan)
    one = fingerprint(run)
    if name == "loco_dagger-0.5" and chunk != 4:  # rows of a chunk come in another order
        assert one["data"] == other["data"]
    else:
        assert one == other


def in_one_process(config, policy, split, _workers):
    from surefoot.evaluation.robustness import evaluate

    return evaluate(config, policy, split, Workers(1))


@pytest.mark.parametrize(
    "name", first_often(1, ["behavior_cloning", "loco_dagger-0.5", "loco_safe_dagger"])
)
def test_a_run_with_a_budget_killed_after_each_chunk_and_record_ends_with_the_same_bits(
    limited, tmp_path, monkeypatch, name
):
    expected = fingerprint(limited(name))
    seen = set()

    def once(method, key):
        def wrapped(owner, *args):
            method(owner, *args)
            if key(*args) not in seen:
                seen.add(key(*args))
                raise Killed

        return wrapped

    append = once(Dataset.append, lambda shard, _frames: shard)
    monkeypatch.setattr(Dataset, "append", append)
    record = once(Run.append_metrics, lambda each: (each.stage, each.iteration))
    monkeypatch.setattr(Run, "append_metrics", record)
    for _ in range(100):
        try:
            run_method(tmp_path, config_of(name), resume=True)
        except Killed:
            continue
        except TypeError:  # a record that was lost on the way
            continue
        break
    assert len(seen) > 5
    assert fingerprint(open_run(tmp_path / "run")) == expected


@pytest.mark.parametrize("name", first_often(3, NAMES))
def test_a_finished_collection_simulates_nothing_again(limited, name):
    def never(jobs, _workers, _title):
        assert not jobs, "simulated again"
        yield from ()

    run = limited(name)
    for i in iterations_of(run):
        collect_data(run, i, collection(run, i), Workers(8), never)


class OneByOne:
    """Plays rollouts one after another, as a robot does, until a number of them.

    Args:
        most: The number, after which it is killed.
    """

    def __init__(self, most: int = 1000) -> None:
        self.walked = 0
        self._most = most

    def __call__(self, jobs, _workers, _title):
        for number, job in enumerate(jobs):
            if self.walked == self._most:
                raise Killed
            self.walked += 1
            yield number, run_chunk(job)


def test_a_robot_walks_one_rollout_at_most_that_a_budget_does_not_pay_for(tmp_path):
    run = create(tmp_path / "run", config_of("behavior_cloning"))
    job = collection(run, 0)
    job = replace(job, config=replace(job.config, chunk=1))
    killed = OneByOne(most=3)
    with pytest.raises(Killed):
        collect_data(run, 0, job, Workers(8), killed)
    assert len(run.dataset.shards) == 3  # each was stored as soon as it was over
    rest = OneByOne()
    record = collect_data(run, 0, job, Workers(8), rest)
    assert 3 < record.episodes < len(job.episodes)
    assert rest.walked == record.episodes - 3 + 1
    done = OneByOne()
    collect_data(run, 0, job, Workers(8), done)
    assert done.walked == 0


def test_a_lost_shard_is_collected_again(limited, tmp_path):
    shutil.copytree(limited("loco_safe_dagger").folder, tmp_path / "run")
    run = open_run(tmp_path / "run")
    last = run.dataset.shards[-1]
    content = run.dataset.shard_path(last).read_bytes()
    run.dataset.shard_path(last).unlink()
    i = collected(run, 2).iteration if last.startswith("iteration_002") else 1
    collect_data(run, i, collection(run, i), Workers(1))
    assert run.dataset.load([last]).hash == limited("loco_safe_dagger").dataset.load([last]).hash
    assert len(content) > 0


def test_a_rollout_that_the_budget_did_not_pay_for_is_no_episode(limited):
    run = limited("behavior_cloning")
    episodes = collected(run, 0).episodes
    assert recorded_episode(run.folder, episodes - 1, plan=plan).episode.tolist() == [episodes - 1]
    with pytest.raises(ValueError, match=rf"no episode {episodes}; .* 0 to {episodes - 1}"):
        recorded_episode(run.folder, episodes, plan=plan)


def test_few_expert_seconds_are_not_collected_by_simulating_all_rollouts(tmp_path, monkeypatch):
    ran = []

    def counted(job):
        ran.append(len(job.episodes))
        return run_chunk(job)

    monkeypatch.setattr(surefoot.runs.collecting, "run_chunk", counted)
    config = config_of("behavior_cloning", BudgetConfig(1.0))
    run = create(tmp_path / "run", config)
    record = collect_data(run, 0, collection(run, 0), Workers(1))
    assert (record.episodes, record.plans) == (5, 20)
    assert ran == [4, 4]


def test_with_a_budget_the_first_rollouts_mix_phases_and_speeds():
    config = replace(Config(), budget=BUDGET)
    data = ExpertData(20, 2, False, 1.0)
    job = expert_rollouts(config, data)
    assert sorted(job.starts.id) == sorted(expert_rollouts(Config(), data).starts.id)
    assert (np.diff(job.episode) == 1).all()
    # In any first part, each phase has as many rollouts as any other, or one more.
    phase = np.unique(job.starts.tick, return_inverse=True)[1]
    so_far = np.cumsum(np.eye(10)[phase], axis=0)
    assert np.ptp(so_far, axis=1).max() == 1
    assert len(np.unique(job.starts.command[:20, 0])) > 8
    method = DaggerConfig(velocities=20, perturbations=2)
    drawn = draw_starts(config, method, 3)
    in_order = draw_starts(Config(), method, 3)
    assert sorted(drawn.id) == sorted(in_order.id)
    assert drawn.id.tolist() != in_order.id.tolist()


def test_an_iteration_that_can_afford_no_rollout_trains_on(tmp_path):
    """A query costs three solves: half of five solves does not pay for one rollout's three."""
    config = config_of("loco_dagger-0.5", BudgetConfig(2.65, 0.9))
    run = run_method(tmp_path, config)
    record = collected(run, 1)
    assert (record.episodes, record.frames_kept, record.plans) == (0, 0, 0)
    assert record.dataset_hash == collected(run, 0).dataset_hash
    assert trained(run, 1).steps == 7
    assert run.best is not None


def test_a_method_ends_when_nothing_is_left(tmp_path):
    config = config_of("loco_safe_dagger", BudgetConfig(2.0, 1.0))
    run = run_method(tmp_path, config)
    assert collected(run, 0).plans == 40
    assert run.collected(1) is None
    assert run.best_policy_path == run.policy_path(0)


@pytest.mark.parametrize(
    ("method", "text"),
    [
        (
            BehaviorCloningConfig(ExpertData(2, 1, False, 3.0)),
            r"budget.expert_seconds is 2 s, which does not pay .* 3.0 s \(method.data.duration\)",
        ),
        (
            DaggerConfig(pretraining=ExpertData(2, 1, False, 1.5)),
            r"budget.expert_seconds times budget.pretraining is 1 s, .* \(method.pretraining.dur",
        ),
    ],
)
def test_a_budget_below_one_rollout_is_refused(method, text):
    with pytest.raises(ValueError, match=text):
        check_config(replace(CLONING, method=method, budget=BudgetConfig(2.0)))


def test_a_budget_that_turns_out_too_small_is_an_error_that_leaves_nothing(tmp_path):
    config = config_of("behavior_cloning", BudgetConfig(0.15))
    run = create(tmp_path / "run", config)
    with pytest.raises(RunError, match=r"budget.expert_seconds does not pay for the first rollout"):
        collect_data(run, 0, collection(run, 0), Workers(1))
    assert run.dataset.shards == ()


@pytest.mark.parametrize(("seconds", "solves"), [(0.05, 1), (0.3, 6), (19.999, 399), (1e6, 2e7)])
def test_a_solve_counts_as_a_twentieth_of_a_second(seconds, solves):
    assert solves_of(seconds) == solves


def test_runs_of_other_budgets_share_their_first_data_where_it_may_cost_as_much():
    def begun(seconds, share):
        budget = BudgetConfig(seconds, share)
        return first_stage(config_of("dagger", budget), "data")

    assert begun(6.0, 0.4) == begun(12.0, 0.2) != begun(12.0, 0.4)
