"""One policy of two gaits by LocoSafeDAGGER on the toy: what is learned from, and kills."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import DaggerConfig, ExpertConfig, LocoSafeDaggerConfig, OtherGait
from surefoot.config.gait_table import GAITS
from surefoot.learning.frames import whole_episode
from surefoot.learning.policy import load
from surefoot.learning.samples import derive
from surefoot.methods.loco_safe_dagger import collection, loco_safe_dagger
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.jobs import Job, play_out
from surefoot.runs.checks import check_config
from surefoot.runs.query import Query
from surefoot.runs.run import Run, create, open_run
from surefoot.runs.sampling import episodes_from
from surefoot.scenarios.gaits import all_starts_of
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.types import Command
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes import toy
from tests.fakes.killed import Killed
from tests.fakes.runs import fingerprint
from tests.fakes.toy_runs import COMMON, CONFIG

METHOD = LocoSafeDaggerConfig(**COMMON, T_block=0.15, T_end=0.1, gates=("relaxing",))


def plan(state, tick, command: Command):
    """The toy's MPC, which leans another way in the second gait."""
    lean = command.vx if command.gait == 0 else -command.vx
    return toy.plan(state, tick, Command(lean))


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("bound") / "bound.npz"
    save_starts(replace(load_starts(), gait=GAITS["bound"]), path)
    gains = ExpertConfig(command_gain=(1.0, 1.0, 1.0))
    other = OtherGait(GAITS["bound"], gains, str(path))
    return replace(CONFIG, method=METHOD, other_gaits=(other,), switches=3)


def train(run: Run) -> Run:
    loco_safe_dagger(run, Workers(1), plan)
    return run


@pytest.fixture(scope="module")
def finished(toys, config, tmp_path_factory) -> Run:
    return train(create(tmp_path_factory.mktemp("several") / "run", config))


def test_both_gaits_are_learned_from_with_their_own_phases(finished):
    frames = finished.dataset.load()
    assert set(frames.gait.tolist()) == {0, 1}
    policy = load(finished.policy_path(2))
    assert [gait.name for gait in policy.spec.observation.gaits] == ["trot", "bound"]
    rows = derive(frames, policy.spec)
    angle = 2 * np.pi * (frames.tick / np.where(frames.gait == 0, 500, 300))
    np.testing.assert_allclose(rows[:, 42], np.sin(angle), atol=1e-5)
    np.testing.assert_array_equal(rows[:, 47:49], np.eye(2)[frames.gait])


def test_robots_begin_in_each_gait_and_change_it(finished):
    job = collection(finished, 1, plan)
    assert job.starts.gait.tolist() == [0] * 6 + [1] * 6
    rollouts, _ = play_out(job)
    changes = (np.diff(rollouts.gait, axis=1) != 0).sum(axis=1)
    assert changes.max() > 0
    recorded = finished.dataset.load()
    first = recorded[recorded.episode == job.episode[0]]
    elapsed = first.tick - job.starts.tick[0]
    np.testing.assert_array_equal(first.gait, rollouts.gait[0, elapsed])


def test_the_policy_of_each_gait_is_another_one(finished):
    policy = load(finished.policy_path(2))
    frames = finished.dataset.load()[:40]
    policy.reset(40)
    one = policy.target(frames.state, frames.tick, frames.command)
    policy.gait = np.ones(40, int)
    assert (policy.target(frames.state, frames.tick, frames.command) != one).any()
    with pytest.raises(ValueError, match="gait number 2 of a policy of trot, bound; use 0 to 1"):
        policy.gait = np.full(40, 2)
    with pytest.raises(ValueError, match="gait number -1 of a policy of trot, bound; use 0 to 1"):
        policy.gait = -1


def test_figures_are_given_gait_by_gait(finished):
    validated = finished.validated(2)
    assert validated is not None
    assert validated.episodes == 6
    assert validated.gaits is not None
    assert [each.speed.gait for each in validated.gaits] == ["trot", "bound"]
    assert [each.episodes for each in validated.gaits] == [3, 3]
    assert sum(each.successes for each in validated.gaits) == validated.successes


@pytest.mark.parametrize("stage", first_often(1, range(7)))
def test_a_run_of_two_gaits_that_is_killed_ends_with_the_same_bits(
    finished, config, tmp_path, monkeypatch, stage
):
    append_metrics = Run.append_metrics
    done = []

    def die_at(run, record):
        done.append(record.stage)
        if len(done) == stage + 1:
            raise Killed
        return append_metrics(run, record)

    with monkeypatch.context() as patch:
        patch.setattr(Run, "append_metrics", die_at)
        with pytest.raises(Killed):
            train(create(tmp_path / "run", config))
    run = train(create(tmp_path / "run", config, resume=True))
    assert fingerprint(run) == fingerprint(finished)


def test_a_run_keeps_the_initial_states_of_each_gait(finished):
    assert (finished.folder / "starts-1.npz").exists()
    config = open_run(finished.folder).config
    assert config == finished.config
    assert config.other_gaits[0].start_set == str(finished.folder.resolve() / "starts-1.npz")


def test_learned_gates_are_refused_before_any_work(config):
    method = replace(METHOD, gates=("classifier",))
    with pytest.raises(ValueError, match=r"a learned gate, which sees one gait alone.*relaxing"):
        check_config(replace(config, method=method))


def test_other_methods_change_gaits_too(config):
    method = DaggerConfig(**COMMON)
    episodes = episodes_from(replace(config, method=method), load_starts()["train"][:4], 1, 0.7)
    assert episodes.switches is not None


def test_queries_go_on_in_the_gait_of_their_rollout(toys, config):
    stored = all_starts_of(config)
    starts = stored.join([each["train"][:3] for each in stored.sets])
    job = Job(config, episodes_from(config, starts, 1, 1.5), ExpertOnly(), plan=plan)
    rollouts, _ = play_out(job)
    queries = Query(3, 0.4, 0.0)(job, rollouts)
    assert queries is not None
    again, _ = play_out(queries)
    assert (np.diff(again.gait, axis=1) != 0).any()
    for row, number in enumerate(queries.episode.tolist()):
        robot = int(np.flatnonzero(job.episode == whole_episode(np.array([number]))[0])[0])
        elapsed = int(queries.starts.tick[row] - job.starts.tick[robot])
        expected = rollouts.gait[robot, elapsed : elapsed + 400]
        np.testing.assert_array_equal(again.gait[row, : len(expected)], expected)
