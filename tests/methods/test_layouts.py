"""Every method trains and evaluates policies that remember, end to end on the toy."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from surefoot.learning.policy import load
from surefoot.learning.samples import derive
from surefoot.runs.policies import find_policy
from surefoot.runs.run import Run
from tests.fakes.runs import fingerprint
from tests.fakes.toy_runs import CONFIG, SMALL_METHODS, run_method

pytestmark = pytest.mark.usefixtures("toys")


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


@pytest.mark.parametrize("name", SMALL_METHODS)
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


def test_the_frames_of_an_expert_do_not_depend_on_the_layout(remembered, tmp_path):
    full = remembering("behavior_cloning")
    full = replace(full, policy=replace(full.policy, layout="full"))
    one = run_method(tmp_path / "full", full).dataset
    assert one.hash == remembered("behavior_cloning").dataset.hash


def test_runs_of_policies_that_remember_have_the_same_bits(remembered, tmp_path):
    again = run_method(tmp_path, remembering("dagger"))
    assert fingerprint(again) == fingerprint(remembered("dagger"))
    assert np.isfinite([again.trained(1).validation_loss])  # pyright: ignore


def test_mirror_images_of_a_history_are_trained_on(tmp_path):
    run = run_method(tmp_path, remembering("behavior_cloning", mirror="left_right"))
    assert load(run.best_policy_path).spec.observation.layout.name == "proprioceptive"
