"""Many episodes: the same for any number of workers, and figures with known answers."""

from dataclasses import fields, replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import Config, EvaluationConfig, PolicyConfig
from surefoot.files import load_arrays, save_arrays
from surefoot.learning.frames import concatenate
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly, SafetySwitch
from surefoot.rollouts.jobs import Job, chunks_of, play_out, run_chunk, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join, summarise, velocities
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import load_starts
from surefoot.types import MotionPlan
from surefoot.workers import Workers, map_chunks
from tests.fakes.learning import spec_of
from tests.fakes.records import blank

CONFIG = replace(Config(), chunk=2, evaluation=EvaluationConfig(duration=0.3, episodes=5))
HIDDEN = PolicyConfig(hidden=(16, 16))
STORED = load_starts()
STANDING = standing(solo12())


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    path = tmp_path_factory.mktemp("policies") / "random.safetensors"
    save(Policy(PolicyNetwork(HIDDEN, seed=2), spec_of(HIDDEN), np.zeros((2, 3))), path)
    return path


def keep_expert(record):
    return record.expert_drove & record.happened


def job_of(policy=None, chunk=2, episodes=5, **changes):
    starts = STORED["select"][10 : 10 + episodes]
    arbiter = ExpertOnly()
    if policy is not None:
        arbiter = SafetySwitch(SafetyMonitor(Bounds(CONFIG.safety), 0.05))
    job = Job(
        replace(CONFIG, chunk=chunk),
        starts,
        300 + np.arange(episodes),
        arbiter,
        0.12,
        tail=0.02,
        policy=policy,
        keep=keep_expert,
    )
    return replace(job, **changes)


def equal(a, b):
    """Two summaries, or frames, to the bit."""
    for field in fields(a):
        np.testing.assert_array_equal(
            getattr(a, field.name), getattr(b, field.name), err_msg=field.name
        )


def collected(job, workers):
    """Summary and frames of all chunks of a job."""
    parts = map_chunks(run_chunk, chunks_of(job), Workers(workers), "chunks")
    return join([part.summary for part in parts]), concatenate([part.frames for part in parts])


def test_results_do_not_depend_on_workers_or_chunks(policy):
    """Rescued rollouts of a policy: takeovers off the grid, tail, frames, and all figures."""
    summary, frames = collected(job_of(policy), 1)
    assert 0 < summary.expert_ticks.sum() < summary.proper_ticks.sum()
    assert len(frames) == summary.kept.sum() > 0
    for workers, chunk in ((2, 2), (1, 5), (1, 3)):
        other, other_frames = collected(job_of(policy, chunk), workers)
        equal(summary, other)
        equal(frames, other_frames)


def test_episodes_keep_their_order_and_ids(policy):
    job = job_of(policy, arbiter=PolicyOnly(), tail=0.0)
    summary, frames = collected(job, 1)
    np.testing.assert_array_equal(summary.episode, 300 + np.arange(5))
    np.testing.assert_array_equal(summary.start, job.starts.id)
    np.testing.assert_array_equal(summary.command, job.starts.command)
    assert len(frames) == 0  # the expert never drove
    assert not summary.plans.any()


def test_frames_are_those_of_the_rule(policy):
    job = job_of(policy, episodes=2)
    record, _ = play_out(job)
    frames = run_chunk(job).frames
    mask = record.expert_drove & record.happened
    np.testing.assert_array_equal(frames.q, record.q[mask])
    np.testing.assert_array_equal(frames.torque, record.torque[mask])
    np.testing.assert_array_equal(np.unique(frames.episode), [300, 301])
    assert frames.expert_drove.all()
    none = run_chunk(replace(job, keep=None)).frames
    assert len(none) == 0


def test_one_episode_alone_is_the_one_of_the_batch(policy):
    """What replaying a recorded episode relies on."""
    job = job_of(policy, episodes=3)
    record, _ = play_out(job)
    row = np.array([1])
    alone, _ = play_out(replace(job, starts=job.starts[row], episode=job.episode[row]))
    np.testing.assert_array_equal(alone.length, record.length[row])
    happened = alone.happened[0]
    np.testing.assert_array_equal(alone.q[0, happened], record.q[1, happened])
    np.testing.assert_array_equal(alone.torque[0, happened], record.torque[1, happened])


def test_summary_counts_plans_of_each_robot():
    job = job_of(episodes=2, duration=0.11, tail=0.0)
    summary = run_episodes(job, Workers(1), "plans")
    offsets = job.starts.tick % 50
    assert not offsets.any()
    np.testing.assert_array_equal(summary.plans, [3, 3])
    np.testing.assert_array_equal(summary.expert_ticks, [110, 110])
    assert summary.expert_drove_last.all()


def test_a_summary_comes_back_from_its_file_to_the_bit(policy, tmp_path):
    summary = run_episodes(job_of(policy, episodes=2), Workers(1), "file")
    path = tmp_path / "episodes" / "part.npz"
    save_arrays(path, summary)
    equal(summary, load_arrays(path, Summary))
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ValueError, match=r"part.npz is missing or damaged.*delete it"):
        load_arrays(path, Summary)
    with pytest.raises(ValueError, match=r"none.npz is missing or damaged.*--resume"):
        load_arrays(tmp_path / "none.npz", Summary)


# --- figures of synthetic rollouts


def synthetic(T=2000, tail=0, B=2, command=((0.2, 0.1, 0.3),) * 2, **changes):
    record = blank(B, T + tail, duration=T, **changes)
    return replace(
        record,
        starts=replace(record.starts, command=np.array(command), id=np.arange(B) + 40),
        length=np.array(record.length),
    )


def figures(record, frames=None):
    B = len(record.length)
    return summarise(
        record,
        concatenate([]) if frames is None else frames,
        episode=7 + np.arange(B),
        query=False,
        expert="somebody",
        plans=np.full(B, 3),
        invalid_plans=np.ones(B, int),
        foot_radius=0.02,
        gait_period=500,
        safety=CONFIG.safety,
    )


def test_velocities_are_those_of_the_heading_frame():
    rng = np.random.default_rng(0)
    q, v = np.zeros((1, 40, 19)), rng.normal(size=(1, 40, 18))
    for t in range(40):
        roll, pitch, yaw = rng.uniform([-0.5, -0.5, -3.0], [0.5, 0.5, 3.0])
        R = pin.rpy.rpyToMatrix(roll, pitch, yaw)
        q[0, t, 3:7] = pin.Quaternion(R).coeffs()
        # World velocities, then turned back by the yaw alone.
        level = pin.rpy.rpyToMatrix(0.0, 0.0, yaw).T
        expected = np.append((level @ R @ v[0, t, :3])[:2], (R @ v[0, t, 3:6])[2])
        record = synthetic(T=40, B=1, command=[[0, 0, 0]], q=q, v=v)
        np.testing.assert_allclose(velocities(record)[0, t], expected, atol=1e-12)


def test_mean_velocity_and_errors_of_a_known_motion():
    v = np.zeros((2, 2000, 18))
    v[0, :, 0] = np.where(np.arange(2000) < 1000, 0.0, 0.25)  # settles after a second
    v[0, :, 1] = 0.1
    v[0, :, 5] = 0.3 + 0.2 * (-1.0) ** np.arange(2000)
    v[1, :, 0] = 0.2
    v[1, 500:, :] = 99.0  # after the fall: nobody may look at this
    summary = figures(synthetic(v=v, length=[2000, 500]))
    np.testing.assert_allclose(summary.mean_velocity, [[0.125, 0.1, 0.3], [0.2, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(summary.mse[0], [(0.04 + 0.0025) / 2, 0.0, 0.04], atol=1e-12)
    np.testing.assert_allclose(summary.mse[1], [0.0, 0.01, 0.09], atol=1e-12)
    np.testing.assert_allclose(summary.settled_mse[0], [0.0025, 0.0, 0.04], atol=1e-12)
    assert np.isnan(summary.settled_mse[1]).all()


def test_tail_counts_in_ticks_and_in_nothing_else():
    record = synthetic(T=1500, tail=300, length=[1800, 1600])
    record.v[:, 1500:, 0] = 50.0
    record.torque[:, 1500:] = 2.0
    record.torque[:, 100, 3] = -1.5
    record.expert_drove[:, 1500:] = True
    record.expert_drove[0, 200:575] = True
    summary = figures(record)
    np.testing.assert_array_equal(summary.ticks, [1800, 1600])
    np.testing.assert_array_equal(summary.proper_ticks, [1500, 1500])
    np.testing.assert_array_equal(summary.expert_ticks, [375, 0])
    np.testing.assert_array_equal(summary.max_torque, [1.5, 1.5])
    np.testing.assert_array_equal(summary.mean_velocity, 0.0)
    np.testing.assert_allclose(summary.mse, [[0.04, 0.01, 0.09]] * 2)


def test_who_drove_at_the_end_and_half_a_second_before():
    record = synthetic(B=3, command=np.zeros((3, 3)), length=[1000, 1000, 300])
    record.expert_drove[0, 999] = True  # took over in the last tick
    record.expert_drove[0, 1000:] = True  # never happened
    record.expert_drove[1, 499] = True
    record.expert_drove[1, 1000] = True  # never happened
    record.expert_drove[2, 0] = True
    summary = figures(record)
    assert summary.expert_drove_last.tolist() == [True, False, False]
    assert summary.expert_drove_before.tolist() == [False, True, True]


def test_expert_ticks_stop_where_the_robot_fell():
    record = synthetic(length=[2000, 700])
    record.expert_drove[:] = True
    record.outcome[1] = Outcome.FELL
    summary = figures(record)
    np.testing.assert_array_equal(summary.expert_ticks, [2000, 700])
    assert summary.expert_ticks.sum() / summary.proper_ticks.sum() == 1.0


def test_takeovers_do_not_depend_on_what_the_others_do_after_a_fall():
    """Alone, a rollout ends with its robot, and what is recorded after that is blank."""
    record = synthetic(length=[2000, 700])
    record.expert_drove[:, :700] = True
    record.expert_drove[0, 300] = False
    assert figures(record).takeovers.tolist() == [2, 0]
    record.expert_drove[1, 800] = True
    assert figures(record).takeovers.tolist() == [2, 0]


def test_kept_frames_are_counted_by_episode():
    record = synthetic(T=100)
    record.expert_drove[:] = True
    keep = np.zeros((2, 100), bool)
    keep[0, 3:10] = True
    keep[1, ::4] = True
    summary = figures(record, record.frames(keep, np.array([7, 8])))
    assert summary.kept.tolist() == [7, 25]
    assert summary.plans.tolist() == [3, 3]
    assert summary.invalid_plans.tolist() == [1, 1]
    assert summary.episode.tolist() == [7, 8]
    assert summary.start.tolist() == [40, 41]


def test_a_robot_lost_before_its_first_tick_has_figures_too():
    record = synthetic(length=[0, 2000])
    record.q[0], record.v[0], record.torque[0] = np.nan, np.nan, np.nan
    record.expert_drove[0] = True
    summary = figures(record)
    assert summary.ticks.tolist() == [0, 2000]
    assert summary.expert_ticks.tolist() == [0, 0]
    assert np.isnan(summary.mse[0]).all()
    assert np.isfinite(summary.mse[1]).all()
    assert summary.max_torque.tolist() == [0.0, 0.0]
    assert summary.expert_drove_last.tolist() == [False, False]


def test_strict_stepping_is_reported_beside():
    record = synthetic(T=2000)
    t = np.arange(2000)
    for leg, shift in enumerate((0, 250, 250, 0)):
        down = (t + shift) % 500 < 300
        record.contacts[0, :, leg] = down
        record.feet[0, :, leg, 2] = np.where(down, 0.018, 0.05)
    assert figures(record).strict.tolist() == [True, False]


def stiff(state, tick, command):
    """A user's own MPC: stand, stiffly."""
    rows = np.zeros((100, 12))
    return MotionPlan(np.tile(STANDING[7:], (100, 1)), rows, rows + 0.01 * command.vx)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_users_own_plan_drives_as_the_expert(workers):
    job = job_of(plan=stiff, duration=0.06, tail=0.0)
    summary, frames = collected(job, workers)
    kp, kd = CONFIG.expert.kp, CONFIG.expert.kd
    tau = (
        kp * (STANDING[7:] - frames.q[:, 7:]) - kd * frames.v[:, 6:] + 0.01 * frames.command[:, :1]
    )
    limit = CONFIG.robot.torque_limit
    np.testing.assert_allclose(frames.torque, np.clip(tau, -limit, limit), atol=1e-12)
    assert summary.plans.tolist() == [2] * 5
