"""Pushes on the toy, found again in the motion of the robots."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.config import DisturbanceConfig
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job, play_out, run_chunk
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import join_summaries
from surefoot.runs.accounting import collection_figures
from surefoot.runs.sampling import keep_unless_failed
from surefoot.scenarios.disturbance import Disturbance, Pushes, draw_disturbances
from surefoot.scenarios.starts import load_starts
from tests.fakes import toy
from tests.fakes.runs import fingerprint
from tests.fakes.toy_runs import CONFIG, SMALL_METHODS, angles, replayed, run_method

pytestmark = pytest.mark.usefixtures("toys")


def pushed(folder, collection):
    config = replace(CONFIG, method=SMALL_METHODS["loco_safe_dagger"], collection=collection)
    run = run_method(folder, config)
    episodes = [run.summary_path(shard).read_bytes() for shard in run.dataset.shards]
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
    pushes = draw_disturbances(CONFIG.collection, CONFIG.seed, ids, 0.7, 0.5).pushes
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
        alone = draw_disturbances(
            CONFIG.collection, CONFIG.seed, np.array([7, id_]), 0.7, 0.5
        ).pushes
        assert alone is not None
        np.testing.assert_array_equal(alone.impulse[1], pushes.impulse[b])
        np.testing.assert_array_equal(alone.tick[1], pushes.tick[b])
    other = draw_disturbances(CONFIG.collection, CONFIG.seed + 1, ids, 0.7, 0.5).pushes
    assert other is not None and (other.impulse != pushes.impulse).any(axis=(1, 2)).all()
    assert len(np.unique(pushes.impulse[:, 0, 0])) == 6


def test_pushes_grow_from_gentle_to_whole(runs):
    """The first of two iterations has half of what its episodes would draw."""
    ((job, record),) = replayed(runs("dagger"), 1)
    pushes = draw_disturbances(CONFIG.collection, CONFIG.seed, job.episode, 0.7, 0.5).pushes
    assert pushes is not None
    for b in range(6):
        expected = 0.5 * expected_kicks(pushes, record, b)
        np.testing.assert_allclose(kicks(record, b), expected, rtol=0, atol=1e-9)


def pushed_expert(impulses, at, **disturbance):
    """The expert for 0.7 s and a tail of 0.5 s, each robot pushed sideways once."""
    starts = load_starts().first("nominal", len(impulses))
    push = np.zeros((len(impulses), 1, 3))
    push[:, 0, 1] = impulses
    pushes = Pushes(push, np.array(at)[:, None], 10)
    return Job(
        CONFIG,
        Episodes(starts, 0.7, 0.5, disturbance=Disturbance(pushes)),
        ExpertOnly(),
        keep=keep_unless_failed,
        plan=toy.plan,
        disturbance=DisturbanceConfig(**disturbance),
    )


def test_a_pushed_robot_may_tilt_further_where_the_disturbance_says_so():
    """Unpushed, beyond 20 degrees, beyond 30 before the tail, in the tail, beyond 60."""
    impulses, at = [0.0, 0.8, 1.5, 1.5, 2.5], [0, 550, 300, 720, 100]
    job = pushed_expert(impulses, at, fall_angle=60.0)
    record, _ = play_out(job)
    tilt = np.degrees(np.abs(angles(record.q)).max(axis=2))
    tilt[~record.happened] = 0.0
    most = tilt.max(axis=1)
    assert most[0] < 20 < most[1] < 30 < most[2:].min() and most[2:4].max() < 59 < most[4] < 60
    up, fell = Outcome.SUCCESS, Outcome.FELL
    assert record.outcome.tolist() == [up, up, up, up, fell]
    summary = run_chunk(job).summary
    expected = np.stack([tilt[:, 500:700].max(axis=1), tilt[:, 700:].max(axis=1)], axis=1) > 30
    np.testing.assert_array_equal(summary.tilted_far, expected)
    assert expected[2:4, 0].tolist() == [True, False] and expected[3, 1]
    assert (summary.kept > 0).tolist() == [True, True, True, True, False]
    figures = collection_figures(summary)
    assert (figures["falls"], figures["near_falls"]) == (1, 2)
    assert figures["near_falls_in_tail"] == expected[2:4, 1].sum()
    queries = replace(summary, query=np.ones(5, bool))
    assert collection_figures(join_summaries([summary, queries]))["near_falls"] == 2
    # An angle stricter than the safety table's, as 0 is, leaves that one.
    for angle in (0.0, 20.0):
        summary = run_chunk(pushed_expert(impulses, at, fall_angle=angle)).summary
        assert summary.outcome.tolist() == [up, up, fell, fell, fell]
        assert collection_figures(summary)["near_falls"] == 0


def test_queries_are_pushed_as_the_expert_shall_be(tmp_path):
    """Once each, early, by nothing else: as if they were all tail."""
    method = replace(SMALL_METHODS["loco_dagger"], T_query=0.3)
    for name, impulse in (("a", (0.2, 0.3)), ("b", (0.0, 0.0))):
        collected = DisturbanceConfig(pushes=2, impulse=(0.05, 0.06), expert_impulse=impulse)
        run = run_method(tmp_path / name, replace(CONFIG, method=method, collection=collected))
        _, (job, record) = replayed(run, 1)
        drawn = draw_disturbances(
            replace(collected, pushes=0), CONFIG.seed, job.episode, 0.0, 0.5, 0.3
        ).pushes
        assert (drawn is None) == (impulse[1] == 0.0)
        if drawn is not None:
            size = np.linalg.norm(drawn.impulse[:, 0], axis=1)
            assert drawn.tick.shape == (12, 1) and drawn.tick.max() < 200 and np.ptp(drawn.tick) > 9
            assert size.min() > 0.2 and size.max() < 0.3
        for b in range(12):
            expected = 0.0 if drawn is None else expected_kicks(drawn, record, b)
            np.testing.assert_allclose(kicks(record, b), expected, rtol=0, atol=1e-9)
