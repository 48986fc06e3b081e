"""Behavior cloning: the expert's rollouts become D, and the policy that is trained on it."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import LocoSafeDaggerConfig
from surefoot.methods.behavior_cloning import behavior_cloning, collection
from surefoot.rollouts.jobs import play_out
from surefoot.runs.run import Run, create
from surefoot.workers import Workers
from tests.fakes.runs import collected, fingerprint, stages_of
from tests.fakes.small_runs import CLONING, CLONING_STAGES


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Run:
    run = create(tmp_path_factory.mktemp("finished") / "run", CLONING)
    assert behavior_cloning(run, workers=Workers(1)) == run.policy_path(0)
    return run


def test_the_run_holds_the_experts_rollouts(finished):
    assert stages_of(finished) == CLONING_STAGES
    rollouts, _ = play_out(collection(finished, 0))
    frames = finished.dataset.load()
    assert len(frames) == 20 * 100
    np.testing.assert_array_equal(frames.q, rollouts.q.reshape(-1, 19))
    np.testing.assert_array_equal(frames.torque, rollouts.torque.reshape(-1, 12))
    np.testing.assert_array_equal(frames.episode, np.repeat(np.arange(20), 100))
    assert frames.expert_drove.all()
    cost = collected(finished, 0)
    assert cost.expert_share == cost.expert_share_with_tail == 1.0
    assert cost.expert_seconds == 2.0
    assert cost.plans == 40
    assert cost.failed_episodes == ()


@pytest.mark.thorough  # `test_loco_safe_dagger.py` has processes too
def test_the_same_run_again_has_the_same_bits(finished, tmp_path):
    run = create(tmp_path / "run", CLONING)
    behavior_cloning(run, workers=Workers(2))
    assert fingerprint(run) == fingerprint(finished)


def test_a_run_of_another_method_is_refused(tmp_path):
    run = create(tmp_path / "run", replace(CLONING, method=LocoSafeDaggerConfig()))
    with pytest.raises(
        TypeError, match="configured for loco_safe_dagger, not for behavior_cloning"
    ):
        behavior_cloning(run, workers=Workers(1))
    with pytest.raises(TypeError, match="loco_safe_dagger"):
        collection(run, 0)
    assert run.metrics == []


def test_there_is_one_collection_only(finished):
    with pytest.raises(ValueError, match="no iteration 1"):
        collection(finished, 1)
