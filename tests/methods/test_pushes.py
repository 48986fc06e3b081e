"""Pushes while data is collected, on the toy: found again in the motion of the robots."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import DisturbanceConfig
from surefoot.scenarios.disturbance import draw_disturbances
from tests.fakes.runs import fingerprint
from tests.fakes.toy_runs import CONFIG, SMALL_METHODS, replayed, run_method
from tests.fakes.toy_worlds import expected_kicks, kicks

pytestmark = pytest.mark.usefixtures("toys")


def bits_of_run(folder, collection):
    config = replace(CONFIG, method=SMALL_METHODS["loco_safe_dagger"], collection=collection)
    run = run_method(folder, config)
    episodes = [run.summary_path(shard).read_bytes() for shard in run.dataset.shards]
    return {**fingerprint(run), "episodes": episodes}


def test_a_push_of_zero_changes_no_bit(tmp_path):
    none = bits_of_run(tmp_path / "a", DisturbanceConfig())
    assert bits_of_run(tmp_path / "b", DisturbanceConfig(pushes=3, impulse=(0.0, 0.0))) == none
    assert bits_of_run(tmp_path / "c", DisturbanceConfig(pushes=3, impulse=(0.1, 0.1))) != none


def test_pushes_of_an_episode_depend_on_seed_and_id_alone(runs):
    """Found again in the motion of the robots of three methods that drive differently."""
    ids = 200_000 + np.arange(6)
    names = ("dagger", "safe_dagger", "loco_safe_dagger", "loco_dagger-0.5")
    pairs = [replayed(runs(name), 2)[0] for name in names]
    pushes = draw_disturbances(CONFIG.collection, CONFIG.seed, ids, 0.7, 0.5).pushes
    assert pushes is not None
    felt = 0
    for job, rollouts in pairs:
        assert job.episode.tolist() == ids.tolist()
        for b in range(6):
            expected = expected_kicks(pushes, rollouts, b)
            np.testing.assert_allclose(kicks(rollouts, b), expected, rtol=0, atol=1e-9)
            felt += np.abs(expected).max() > 1e-3
    assert felt > 12
    for b, id_ in enumerate(ids):  # whatever other episodes are drawn for
        alone = draw_disturbances(
            CONFIG.collection, CONFIG.seed, np.array([7, id_]), 0.7, 0.5
        ).pushes
        assert alone is not None
        np.testing.assert_array_equal(alone.impulse[1], pushes.impulse[b])
        np.testing.assert_array_equal(alone.tick[1], pushes.tick[b])
    other = draw_disturbances(CONFIG.collection, CONFIG.seed + 1, ids, 0.7, 0.5).pushes
    assert other is not None and (other.impulse != pushes.impulse).any(axis=(1, 2)).all()
    assert len(np.unique(pushes.impulse[:, 0, 0])) == 6


def test_pushes_in_a_pretraining_are_its_own(runs, tmp_path):
    """Found again in the motion of the expert's robots; without them not a bit has changed."""
    pushed = DisturbanceConfig(pushes=1, impulse=(0.1, 0.2))
    method = SMALL_METHODS["loco_safe_dagger"]
    run = run_method(tmp_path, replace(CONFIG, method=method, pretraining=pushed))
    ((job, rollouts),) = replayed(run, 0)
    pushes = draw_disturbances(pushed, CONFIG.seed, job.episode, 0.06, 0.5).pushes
    assert pushes is not None
    for b in range(20):
        expected = expected_kicks(pushes, rollouts, b)
        np.testing.assert_allclose(kicks(rollouts, b), expected, rtol=0, atol=1e-9)
        assert np.abs(expected).max() > 1e-4
    frames = run.dataset.load()
    np.testing.assert_array_equal(frames[frames.episode == 0].q, rollouts.q[0])
    ((_, others),) = replayed(runs("loco_safe_dagger"), 0)
    assert not kicks(others, 5).round(9).any()


def test_pushes_grow_from_gentle_to_full_size_over_the_iterations(runs):
    """The first of two iterations has half of what its episodes would draw."""
    ((job, rollouts),) = replayed(runs("dagger"), 1)
    pushes = draw_disturbances(CONFIG.collection, CONFIG.seed, job.episode, 0.7, 0.5).pushes
    assert pushes is not None
    for b in range(6):
        expected = 0.5 * expected_kicks(pushes, rollouts, b)
        np.testing.assert_allclose(kicks(rollouts, b), expected, rtol=0, atol=1e-9)
