"""Every method trains and evaluates policies that remember, end to end on the toy."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from surefoot.learning.frames import PART
from surefoot.learning.memory import Memory
from surefoot.learning.observation import network_input
from surefoot.learning.policy import load, target_of
from surefoot.learning.samples import derive
from surefoot.runs.episode_ids import iteration_of_shard
from surefoot.runs.policies import find_policy
from surefoot.runs.run import Run
from tests.cases import first_often
from tests.fakes.runs import fingerprint
from tests.fakes.toy_runs import CONFIG, SMALL_METHODS, replayed, run_method

pytestmark = pytest.mark.usefixtures("toys")

NAMES = ["behavior_cloning", "loco_dagger", "loco_safe_dagger", "dagger", "safe_dagger", "dart"]
"""First a method without iterations, one that asks queries, and one with gates of both kinds."""


def remembering(name, **changes):
    """A small run of a method whose policies are proprioceptive."""
    policy = replace(CONFIG.policy, layout="proprioceptive")
    method = SMALL_METHODS[name]
    if name == "loco_safe_dagger":
        method = replace(method, gates=("relaxing", "classifier"))
    training = replace(CONFIG.training, **changes)
    return replace(CONFIG, method=method, policy=policy, training=training)


@pytest.fixture(scope="module")
def remembered(tmp_path_factory) -> Callable[[str], Run]:
    """A finished run of a method whose policies are proprioceptive, made once."""
    return cache(lambda name: run_method(tmp_path_factory.mktemp(name), remembering(name)))


def test_every_method_is_among_them():
    assert set(NAMES) == set(SMALL_METHODS)


@pytest.mark.parametrize("name", first_often(3, NAMES))
def test_a_method_trains_and_evaluates_a_policy_that_remembers(remembered, name):
    run = remembered(name)
    policy = load(run.best_policy_path, layout="proprioceptive")
    assert len(policy.network.mean) == 253
    assert policy.limits is not None
    assert policy.limits.torque == (2.7,) * 12
    assert policy.bounds is not None
    assert policy.bounds.com_height == CONFIG.safety.com_height
    validated = run.validated(0)
    assert validated is not None
    assert validated.episodes == 3
    path, config = find_policy(run.folder)
    assert (path, config.policy.layout) == (run.best_policy_path, "proprioceptive")
    # What is recorded besides the frames is enough for another layout, trained afterwards.
    recording = run.dataset.load(all_ticks=True)
    assert len(derive(recording, policy.spec)) == run.dataset.frames == recording.kept.sum()
    if name == "loco_safe_dagger":
        assert not recording.kept.all()


@pytest.mark.parametrize("name", first_often(3, NAMES))
def test_what_is_trained_on_is_what_a_policy_would_have_seen_in_the_rollouts(remembered, name):
    """To the bit, in every job of a method; a query of LocoDAGGER goes on from a rollout."""
    run = remembered(name)
    spec = load(run.best_policy_path).spec
    recording = run.dataset.load(all_ticks=True)
    frames = recording.kept_frames
    rows = derive(recording, spec)[:, : spec.observation.input_size]
    online = {}
    queries = 0
    for i in sorted({iteration_of_shard(shard) for shard in run.dataset.shards}):
        (job, rollouts), *following = replayed(run, i)
        for b, id_ in enumerate(job.episode.tolist()):
            if id_ in frames.episode:
                ticks = [(rollouts, b, tick) for tick in range(rollouts.length[b])]
                online |= online_inputs(ticks, id_, spec)
        for asked, answered in following:
            for n, id_ in enumerate(asked.episode.tolist()):
                b = int(np.flatnonzero(job.episode == id_ % PART)[0])
                begin = int(asked.starts.tick[n] - rollouts.starts.tick[b])
                ticks = [(rollouts, b, tick) for tick in range(begin)]
                ticks += [(answered, n, tick) for tick in range(answered.length[n])]
                online |= online_inputs(ticks, id_, spec)
                queries += begin > 0
    assert (queries > 5) == (name == "loco_dagger")
    for row, episode, tick in zip(rows, frames.episode.tolist(), frames.tick.tolist(), strict=True):
        np.testing.assert_array_equal(row, online[episode, tick])


def online_inputs(ticks, episode, spec):
    """(episode, tick) -> what a policy sees there that is told of all these ticks, in order."""
    memory = Memory(spec.observation.layout.history, 1)
    inputs = {}
    for rollouts, b, elapsed in ticks:
        state = rollouts.seen[b : b + 1, elapsed]
        tick = rollouts.starts.tick[b : b + 1] + elapsed
        command = rollouts.starts.command[b : b + 1]
        past = memory.read(state)
        row = network_input(state, tick, command, spec.observation, history=past)[0]
        inputs[episode, int(tick[0])] = row
        torque = rollouts.torque[b : b + 1, elapsed]
        memory.store(state, target_of(torque, state.q, state.v, spec))
    return inputs


def test_the_frames_of_an_expert_do_not_depend_on_the_layout(remembered, tmp_path):
    full = remembering("behavior_cloning")
    full = replace(full, policy=replace(full.policy, layout="full"))
    one = run_method(tmp_path / "full", full).dataset
    assert one.hash == remembered("behavior_cloning").dataset.hash


def test_runs_of_policies_that_remember_have_the_same_bits(remembered, tmp_path):
    again = run_method(tmp_path, remembering("loco_dagger"))
    assert fingerprint(again) == fingerprint(remembered("loco_dagger"))
    assert np.isfinite([again.trained(1).validation_loss])  # pyright: ignore


def test_mirror_images_of_a_history_are_trained_on(tmp_path):
    run = run_method(tmp_path, remembering("behavior_cloning", mirror="left_right"))
    assert load(run.best_policy_path).spec.observation.layout.name == "proprioceptive"
