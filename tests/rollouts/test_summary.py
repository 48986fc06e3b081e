"""Summaries of synthetic rollouts, whose figures are known."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import Config, OtherGait
from surefoot.config.array_io import load_arrays
from surefoot.config.checked import known
from surefoot.config.gait_table import GAITS
from surefoot.files import save_arrays
from surefoot.learning.frames import concatenate
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import (
    NEAR_ANGLE,
    NEAR_HEIGHT,
    NOT_RECORDED,
    TILTED,
    EpisodeInfo,
    Summary,
    covered,
    heading_drift,
    join_summaries,
    settled_part,
    summarize,
    velocities,
)
from surefoot.scenarios.gait_switches import NEVER, GaitSwitches
from surefoot.types import Command
from tests.fakes.robots import ROBOT, STANDING
from tests.fakes.rollouts import blank

CONFIG = with_own_values(Config())


def rolled(degrees):
    """``(..., 4)`` quaternions of a base with that roll."""
    half = np.radians(degrees) / 2
    zero = np.zeros_like(half)
    return np.stack([np.sin(half), zero, zero, np.cos(half)], axis=-1)


def synthetic(T=2000, tail=0, B=2, command=((0.2, 0.1, 0.3),) * 2, **changes):
    rollouts = blank(B, T + tail, duration=T, **changes)
    return replace(
        rollouts,
        starts=replace(rollouts.starts, command=np.array(command), id=np.arange(B) + 40),
        length=np.array(rollouts.length),
    )


def summary_of(rollouts, frames=None, config=CONFIG):
    B = len(rollouts.length)
    info = EpisodeInfo(
        episode=7 + np.arange(B),
        query=False,
        expert="a test",
        plans=np.full(B, 3),
        invalid_plans=np.ones(B, int),
    )
    frames = concatenate([]) if frames is None else frames
    return summarize(rollouts, frames, info, ROBOT, config)


def test_velocities_are_those_of_the_heading_frame():
    rng = np.random.default_rng(0)
    q = np.zeros((1, 40, 19))
    v = rng.normal(size=(1, 40, 18))
    for t in range(40):
        roll, pitch, yaw = rng.uniform([-0.5, -0.5, -3.0], [0.5, 0.5, 3.0])
        R = pin.rpy.rpyToMatrix(roll, pitch, yaw)
        q[0, t, 3:7] = pin.Quaternion(R).coeffs()
        # World velocities, then turned back by the yaw alone.
        level = pin.rpy.rpyToMatrix(0.0, 0.0, yaw).T
        expected = np.append((level @ R @ v[0, t, :3])[:2], (R @ v[0, t, 3:6])[2])
        rollouts = synthetic(T=40, B=1, command=[[0, 0, 0]], q=q, v=v)
        np.testing.assert_allclose(velocities(rollouts)[0, t], expected, atol=1e-12)


def test_mean_velocity_and_errors_of_a_known_motion():
    v = np.zeros((2, 2000, 18))
    v[0, :, 0] = np.where(np.arange(2000) < 1000, 0.0, 0.25)  # settles after a second
    v[0, :, 1] = 0.1
    v[0, :, 5] = 0.3 + 0.2 * (-1.0) ** np.arange(2000)
    v[1, :, 0] = 0.2
    v[1, 500:, :] = 99.0  # after the fall: it must count for nothing
    summary = summary_of(synthetic(v=v, length=[2000, 500]))
    np.testing.assert_allclose(summary.mean_velocity, [[0.125, 0.1, 0.3], [0.2, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(summary.mse[0], [(0.04 + 0.0025) / 2, 0.0, 0.04], atol=1e-12)
    np.testing.assert_allclose(summary.mse[1], [0.0, 0.01, 0.09], atol=1e-12)
    np.testing.assert_allclose(summary.settled_mse[0], [0.0025, 0.0, 0.04], atol=1e-12)
    assert np.isnan(summary.settled_mse[1]).all()


def test_a_robot_that_is_to_stand_has_no_velocity_to_follow():
    rollouts = synthetic(command=((0.2, 0.1, 0.3),) * 2)
    config = replace(CONFIG, gait=GAITS["trot"], other_gaits=(OtherGait(GAITS["stand"]),))
    of_gait = replace(rollouts.starts, gait=np.array([0, 1]))
    summary = summary_of(replace(rollouts, starts=of_gait), config=config)
    np.testing.assert_allclose(summary.mse, [[0.04, 0.01, 0.09], [0.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_array_equal(summary.command, [[0.2, 0.1, 0.3], [0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(covered(summary), [False, True])


def test_a_robot_that_walks_backward_has_covered_nothing():
    v = np.zeros((2, 2000, 18))
    v[:, :, 0] = [[0.2], [-0.2]]
    summary = summary_of(synthetic(command=[[0.2, 0, 0]] * 2, v=v))
    np.testing.assert_array_equal(covered(summary), [True, False])


def test_the_tail_counts_in_ticks_and_in_nothing_else():
    rollouts = synthetic(T=1500, tail=300, length=[1800, 1600])
    rollouts.v[:, 1500:, 0] = 50.0
    rollouts.torque[:, 1500:] = 2.0
    rollouts.torque[:, 100, 3] = -1.5
    rollouts.expert_drove[:, 1500:] = True
    rollouts.expert_drove[0, 200:575] = True
    summary = summary_of(rollouts)
    np.testing.assert_array_equal(summary.ticks, [1800, 1600])
    np.testing.assert_array_equal(summary.proper_ticks, [1500, 1500])
    np.testing.assert_array_equal(summary.expert_ticks, [375, 0])
    np.testing.assert_array_equal(summary.max_torque, [1.5, 1.5])
    np.testing.assert_array_equal(summary.mean_velocity, 0.0)
    np.testing.assert_allclose(summary.mse, [[0.04, 0.01, 0.09]] * 2)


def test_ticks_with_a_body_on_the_ground_are_counted_while_the_episode_lasts():
    rollouts = synthetic(T=1500, tail=300, length=[1800, 1600])
    rollouts.body_contact[:, :20] = True
    rollouts.body_contact[:, 1590:1700] = True
    assert summary_of(rollouts).contact_ticks.tolist() == [130, 30]


def test_a_summary_of_an_older_version_says_that_body_contact_was_not_recorded(tmp_path):
    summary = summary_of(synthetic(length=[2000, 500]))
    path = tmp_path / "summary.npz"
    arrays = {name: array for name, array in vars(summary).items() if name != "contact_ticks"}
    np.savez(path, **arrays)
    old = load_arrays(path, Summary)
    assert old.contact_ticks.tolist() == [NOT_RECORDED] * 2 == [-1, -1]
    assert old[np.array([1])].contact_ticks.tolist() == [-1]
    joined = join_summaries([old, summary])
    assert joined.contact_ticks.tolist() == [-1, -1, 0, 0]
    save_arrays(path, joined)
    assert load_arrays(path, Summary).contact_ticks.tolist() == [-1, -1, 0, 0]
    assert len(summary[np.zeros(0, int)].contact_ticks) == 0


def test_the_driver_of_the_last_tick_and_of_half_a_second_before():
    rollouts = synthetic(B=3, command=np.zeros((3, 3)), length=[1000, 1000, 300])
    rollouts.expert_drove[0, 999] = True  # took over in the last tick
    rollouts.expert_drove[0, 1000:] = True  # never happened
    rollouts.expert_drove[1, 499] = True
    rollouts.expert_drove[1, 1000] = True  # never happened
    rollouts.expert_drove[2, 0] = True
    summary = summary_of(rollouts)
    assert summary.expert_drove_last.tolist() == [True, False, False]
    assert summary.expert_drove_before.tolist() == [False, True, True]


def test_expert_ticks_stop_where_the_robot_fell():
    rollouts = synthetic(length=[2000, 700])
    rollouts.expert_drove[:] = True
    rollouts.outcome[1] = Outcome.FELL
    summary = summary_of(rollouts)
    np.testing.assert_array_equal(summary.expert_ticks, [2000, 700])
    assert summary.expert_ticks.sum() / summary.proper_ticks.sum() == 1.0


def test_what_is_recorded_after_a_fall_is_no_takeover():
    """Alone, a rollout ends with its robot, and what is recorded after that is blank."""
    rollouts = synthetic(length=[2000, 700])
    rollouts.expert_drove[:, :700] = True
    rollouts.expert_drove[0, 300] = False
    assert summary_of(rollouts).takeovers.tolist() == [2, 0]
    rollouts.expert_drove[1, 800] = True
    assert summary_of(rollouts).takeovers.tolist() == [2, 0]


def test_kept_frames_are_counted_by_episode():
    rollouts = synthetic(T=100)
    rollouts.expert_drove[:] = True
    keep = np.zeros((2, 100), bool)
    keep[0, 3:10] = True
    keep[1, ::4] = True
    summary = summary_of(rollouts, rollouts.frames(keep, np.array([7, 8])))
    assert summary.kept.tolist() == [7, 25]
    assert summary.plans.tolist() == [3, 3]
    assert summary.invalid_plans.tolist() == [1, 1]
    assert summary.episode.tolist() == [7, 8]
    assert summary.start.tolist() == [40, 41]


def test_a_robot_lost_before_its_first_tick_has_figures_too():
    rollouts = synthetic(length=[0, 2000])
    for array in (rollouts.q, rollouts.v, rollouts.torque):
        array[0] = np.nan
    rollouts.expert_drove[0] = True
    summary = summary_of(rollouts)
    assert summary.ticks.tolist() == [0, 2000]
    assert summary.expert_ticks.tolist() == [0, 0]
    assert np.isnan(summary.mse[0]).all()
    assert np.isfinite(summary.mse[1]).all()
    assert summary.max_torque.tolist() == [0.0, 0.0]
    assert summary.expert_drove_last.tolist() == [False, False]


def test_strict_stepping_needs_every_foot():
    rollouts = synthetic(T=2000)
    t = np.arange(2000)
    for leg, shift in enumerate((0, 250, 250, 0)):
        down = (t + shift) % 500 < 300
        rollouts.contacts[0, :, leg] = down
        rollouts.feet[0, :, leg, 2] = np.where(down, 0.018, 0.05)
    assert summary_of(rollouts).strict.tolist() == [True, False]


def test_strict_stepping_in_several_gaits_goes_by_the_slowest_that_was_walked():
    config = replace(CONFIG, gait=GAITS["trot"], other_gaits=(OtherGait(GAITS["walk"]),))
    rollouts = synthetic(T=6000)
    period = np.where(np.arange(6000) < 3000, 500, 1000)
    down = np.arange(6000) % period < 0.8 * period  # longer than 1.5 periods of a trot
    rollouts.contacts[:] = down[None, :, None]
    rollouts.feet[..., 2] = np.where(down, 0.018, 0.05)[None, :, None]
    switches = GaitSwitches(np.array([[3000], [NEVER]]), np.array([[1], [0]]))
    summary = summary_of(replace(rollouts, switches=switches), config=config)
    assert summary.strict.tolist() == [True, False]


def test_kept_frames_are_recoveries_where_they_tilt_or_come_near_the_bounds():
    T = 200
    roll = np.zeros((2, T))
    roll[0, :30] = np.degrees(TILTED) + 0.1
    roll[0, 30:50] = np.degrees(TILTED) - 0.1
    roll[1, :7] = 25.0 - np.degrees(NEAR_ANGLE) + 0.1  # the bound is 25 degrees
    roll[1, 7:20] = 25.0 - np.degrees(NEAR_ANGLE) - 0.1
    q = np.zeros((2, T, 19))
    q[..., 3:7] = rolled(roll)
    q[..., 7:] = STANDING[7:]
    rollouts = synthetic(T=T, q=q)
    rollouts.com[..., 2] = 0.2
    low, _ = known(CONFIG.safety.com_height, "safety.com_height")
    rollouts.com[0, 100:105, 2] = low + NEAR_HEIGHT - 1e-4
    rollouts.com[0, 105:120, 2] = low + NEAR_HEIGHT + 1e-4
    rollouts.expert_drove[:] = True
    frames = rollouts.frames(np.ones((2, T), bool), np.array([7, 8]))
    summary = summary_of(rollouts, frames)
    assert summary.kept.tolist() == [T, T]
    assert summary.kept_tilted.tolist() == [30, 20]
    assert summary.kept_near_bounds.tolist() == [5, 7]


def test_tilting_beyond_the_fall_angle_counts_after_the_grace_before_the_tail_and_in_it():
    T = 1000
    grace = round(1000 * CONFIG.safety.grace)
    roll = np.zeros((4, T + 300))
    too_far = CONFIG.safety.fall_angle + 1.0
    roll[0, grace - 1] = too_far
    roll[1, grace] = too_far
    roll[2, T] = too_far
    roll[3, 900] = too_far  # never happened
    q = np.zeros((4, T + 300, 19))
    q[..., 3:7] = rolled(roll)
    length = [T + 300, T + 300, T + 300, 900]
    rollouts = synthetic(T, tail=300, B=4, command=np.zeros((4, 3)), q=q, length=length)
    far = summary_of(rollouts).tilted_far
    assert far.tolist() == [[False, False], [True, False], [False, True], [False, False]]


def test_joined_summaries_are_the_episodes_one_after_another():
    long = summary_of(synthetic(T=1500))
    short = summary_of(synthetic(T=500, B=1, command=[[0.0, 0.0, 0.0]]))
    joined = join_summaries([long, short])
    assert joined.ticks.tolist() == [1500, 1500, 500]
    np.testing.assert_array_equal(joined.mse[:2], long.mse)
    assert joined[joined.ticks < 1000].episode.tolist() == short.episode.tolist()


@pytest.mark.parametrize(
    ("length", "first"), [(5000, 1000), (2000, 1000), (1999, 999), (10, 5), (1, 0)]
)
def test_the_settled_part_begins_after_a_second_or_in_the_middle(length, first):
    assert np.arange(length)[settled_part(length)].tolist() == list(range(first, length))


def test_heading_drift_is_what_the_command_does_not_explain():
    yaw = np.radians(170.0 + 0.03 * np.arange(2001))  # 30 deg/s for two seconds, past 180 degrees
    q = np.zeros((2001, 19))
    q[:, 5] = np.sin(yaw / 2)
    q[:, 6] = np.cos(yaw / 2)
    assert heading_drift(q, Command()) == pytest.approx(60.0)
    # 2001 states span 2000 ticks.
    assert heading_drift(q, Command(yaw_rate=np.radians(30.0))) == pytest.approx(0.0, abs=1e-9)
    assert heading_drift(q, Command(yaw_rate=np.radians(40.0))) == pytest.approx(-20.0, abs=1e-9)
    assert heading_drift(q[:1], Command(yaw_rate=1.0)) == 0.0
