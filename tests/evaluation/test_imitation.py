"""The deviation of a policy from a pushed expert: computed once more, and fixed to the bit."""

from dataclasses import replace

import numpy as np
import pytest

import surefoot.evaluation.imitation as imitation
from surefoot.config import Config, DisturbanceConfig, LocoDaggerConfig, PolicyConfig
from surefoot.config.checked import known
from surefoot.evaluation.imitation import expert_states, imitation_error
from surefoot.evaluation.mirrors import make_mirror
from surefoot.learning.frames import concatenate
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, load, save, target_of
from surefoot.learning.symmetry import mirror_error
from surefoot.robots.load import load_robot
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.disturbance import draw_disturbances
from surefoot.scenarios.starts import load_starts
from surefoot.workers import Workers
from tests.fakes.learning import spec_of
from tests.fakes.rollouts import blank

CONFIG = replace(Config(), chunk=4, policy=PolicyConfig(hidden=(16, 16)))


@pytest.fixture
def few(monkeypatch):
    """Six short rollouts instead of sixty."""
    monkeypatch.setattr(imitation, "ROLLOUTS", 6)
    monkeypatch.setattr(imitation, "DURATION", 0.1)
    imitation._expert_states.cache_clear()
    yield
    imitation._expert_states.cache_clear()


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / "policy.safetensors"
    spec = spec_of(CONFIG.policy)
    save(Policy(PolicyNetwork(CONFIG.policy, 1), spec, np.zeros((2, 3)), "solo12"), path)
    return path


def test_the_error_is_the_mean_deviation_from_the_experts_targets(few, policy):
    error = imitation_error(CONFIG, policy, Workers(1))
    frames = expert_states(CONFIG, Workers(1))
    imitator = load(policy)
    target = imitator.target(frames.state, frames.tick, frames.command)
    label = target_of(frames.torque, frames.q, frames.v, imitator.spec)
    deviation = 1000.0 * np.abs(target - label)
    assert error.mean_mrad == pytest.approx(deviation.mean(), rel=1e-5)
    assert error.worst_mrad == pytest.approx(np.quantile(deviation.mean(axis=1), 0.99), rel=1e-5)
    assert (error.rollouts, error.states) == (6, 30)
    mirror = make_mirror(CONFIG, "left_right")
    arguments = (frames.state, frames.tick, frames.command)
    asymmetry = 1000.0 * mirror_error(imitator, mirror, *arguments)
    assert error.mirror_mrad == pytest.approx(asymmetry, rel=1e-6)
    assert error.starts_hash == load_starts().hash
    assert frames.expert_drove.all()


def test_the_states_are_those_of_select_starts_pushed_once(few):
    frames = expert_states(CONFIG, Workers(1))
    select = load_starts()["select"]
    assert set(frames.episode.tolist()) <= set(select.id.tolist())
    first = frames[frames.episode == frames.episode.min()]
    start = select[select.id == first.episode[0]]
    np.testing.assert_allclose(first.q[0], start.q[0], atol=1e-12)
    assert (np.diff(first.tick) == 20).all()
    config = DisturbanceConfig(pushes=1, impulse=imitation.IMPULSE)
    pushes = draw_disturbances(config, load_starts().seed, select.id[:60], 1.6, 0.5).pushes
    assert pushes is not None
    size = np.linalg.norm(pushes.impulse[:, 0], axis=1)
    assert 0.5 < size.min() < 0.8
    assert 1.7 < size.max() < 2.0


def test_other_robots_are_pushed_by_their_mass(few, monkeypatch):
    drawn = []
    monkeypatch.setattr(imitation, "map_chunks", lambda _, chunks, *__: drawn.extend(chunks) or [])
    monkeypatch.setattr(imitation, "load_robot", lambda _: load_robot("go2"))
    monkeypatch.setattr(imitation, "concatenate", lambda frames: frames)
    assert expert_states(CONFIG, Workers(1)) == []
    low, high = known(drawn[0].disturbance.impulse, "impulse")
    assert low / 0.5 == pytest.approx(high / 2.0, rel=0.01)
    assert low > 2.0


def test_methods_and_seeds_do_not_matter_and_the_states_are_made_once(few, policy, monkeypatch):
    first = imitation_error(CONFIG, policy, Workers(1))
    monkeypatch.setattr(imitation, "run_chunk", None)
    other = replace(CONFIG, method=LocoDaggerConfig(), seed=9, policy=PolicyConfig(hidden=(8,)))
    assert imitation_error(other, policy, Workers(1)) == first


def test_rollouts_that_fail_are_left_out():
    outcome = np.array([Outcome.SUCCESS, Outcome.FELL, Outcome.DIVERGED, Outcome.STALLED])
    kept = imitation._some_states(blank(4, 50, outcome=outcome))
    assert kept.sum(axis=1).tolist() == [3, 0, 0, 3]
    assert np.flatnonzero(kept[0]).tolist() == [0, 20, 40]


def test_an_expert_that_loses_all_robots_is_an_error(policy, monkeypatch):
    monkeypatch.setattr(imitation, "expert_states", lambda *_, **__: concatenate([]))
    with pytest.raises(ValueError, match="the expert has lost all 60 robots"):
        imitation_error(CONFIG, policy, Workers(1))


def test_the_experts_states_are_kept_until_its_robots_files_change(few, monkeypatch):
    contents = iter(["before", "before", "after"])
    monkeypatch.setattr(imitation, "content_hash", lambda config: next(contents))
    first = expert_states(CONFIG, Workers(1))
    assert expert_states(CONFIG, Workers(1)) is first
    assert expert_states(CONFIG, Workers(1)) is not first
