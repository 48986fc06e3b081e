"""Pushes on the toy, found again in the motion of the robots."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import toy
from runs import fingerprint
from surefoot.config import DisturbanceConfig
from surefoot.disturbance import draw
from toy_runs import CONFIG, SMALL_METHODS, angles, replayed, run_method

pytestmark = pytest.mark.usefixtures("toys")


def pushed(folder, collection):
    config = replace(CONFIG, method=SMALL_METHODS["loco_safe_dagger"], collection=collection)
    run = run_method(folder, config)
    episodes = [run.summary(shard).read_bytes() for shard in run.dataset.shards]
    return {**fingerprint(run), "episodes": episodes}


def test_a_push_of_zero_changes_no_bit(tmp_path):
    none = pushed(tmp_path / "a", DisturbanceConfig())
    assert pushed(tmp_path / "b", DisturbanceConfig(pushes=3, impulse=(0.0, 0.0))) == none
    assert pushed(tmp_path / "c", DisturbanceConfig(pushes=3, impulse=(0.1, 0.1))) != none


def kicks(record, b):
    """(length - 1,) what changed a robot's roll rate besides gravity and torques [rad/s]."""
    n = int(record.length[b]) - 1
    q, v, torque = (getattr(record, name)[b] for name in ("q", "v", "torque"))
    expected = v[:n, 3] + toy.DT * (toy.GRAVITY * angles(q[:n])[:, 0] + torque[:n] @ toy.ARM)
    return v[1 : n + 1, 3] - expected


def expected_kicks(pushes, record, b):
    """(length - 1,) the same, as these pushes have it: spread over 10 ms, sideways ones only."""
    yaw = Rotation.from_quat(record.q[b, 0, 3:7]).as_euler("ZYX")[0]
    across = pushes.impulse[b] @ [np.sin(yaw), np.cos(yaw), 0.0]
    expected = np.zeros(int(record.length[b]) - 1)
    for size, tick in zip(across, pushes.tick[b], strict=True):
        expected[tick : tick + 10] += toy.KICK * size / 10
    return expected


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
            expected = expected_kicks(pushes, record, b)
            np.testing.assert_allclose(kicks(record, b), expected, rtol=0, atol=1e-9)
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
        expected = 0.5 * expected_kicks(pushes, record, b)
        np.testing.assert_allclose(kicks(record, b), expected, rtol=0, atol=1e-9)
