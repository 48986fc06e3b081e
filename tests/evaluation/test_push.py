"""Push recovery: the search finds known limits, branches are exact, differences are paired."""

import json
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

import surefoot.evaluation.push as push_module
from surefoot.config import Config, DisturbanceConfig, PushConfig, StateNoiseConfig
from surefoot.config.checked import known
from surefoot.config.gait_table import GAITS
from surefoot.config.json_io import from_json, to_json
from surefoot.evaluation.push import (
    branch_at_push,
    push_recovery,
    pushed_job,
    pushed_starts,
    seconds_after,
)
from surefoot.evaluation.push_limits import PushResult, push_difference
from surefoot.learning.policy import Policy
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, disturbance_of, play_out, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.starts import load_starts
from surefoot.study.expert_survey import PUSHES
from surefoot.types import MotionPlan, to_ticks
from surefoot.workers import Workers
from tests.fakes import toy
from tests.fakes.learning import SMALL, spec_of, trained_network
from tests.fakes.simulator import FakeSimulator

CONFIG = with_own_values(Config())
STORED = load_starts()
RESOLUTION = known(CONFIG.push.resolution, "push.resolution")
STRONGEST = CONFIG.push.levels * RESOLUTION


def pretend(monkeypatch, limit, unpushed=Outcome.SUCCESS, lost=()):
    """Robots that survive up to ``limit(angle, id)`` [N s]; the lost ids fall before the push."""
    rounds = []

    def map_chunks(function, chunks, workers, title):
        assert function is push_module.branch_at_the_end
        parts = []
        for chunk in chunks:
            up = ~np.isin(chunk.starts.id, lost)
            drawn = disturbance_of(chunk)
            after = chunk.config.push.after
            going_on = replace(chunk.episodes, duration=after, disturbance=drawn)
            parts.append((going_on[up], up))
        return parts

    def run_episodes(job, workers, title):
        assert job.episodes.duration == CONFIG.push.after
        assert not np.isin(job.starts.id, lost).any()
        impulse = job.episodes.disturbance.pushes.impulse.reshape(len(job.episode), 3)
        strength = np.hypot(impulse[:, 0], impulse[:, 1])
        angle = np.arctan2(impulse[:, 1], impulse[:, 0])
        outcome = np.where(strength > 0, Outcome.SUCCESS, unpushed)
        outcome[strength > limit(angle, job.starts.id) + 1e-9] = Outcome.FELL
        rounds.append(len(outcome))
        return SimpleNamespace(outcome=outcome)

    monkeypatch.setattr(push_module, "map_chunks", map_chunks)
    monkeypatch.setattr(push_module, "run_episodes", run_episodes)
    return rounds


def recovery(config=CONFIG) -> PushResult:
    """The pushes of the expert, which can be read back from their JSON."""
    result = push_recovery(config, None, Workers(1))
    assert from_json(PushResult, json.loads(json.dumps(to_json(result)))) == result
    return result


def spread_limit(angle, robot):
    """Limits of 1 to 5 N s, in no order, that differ from robot to robot; and by direction."""
    return 1.0 + 4.0 * (robot * 37 % 101) / 100 + 0.5 * np.cos(angle)


def test_search_finds_the_limit_of_every_direction(monkeypatch):
    rounds = pretend(monkeypatch, lambda angle, robot: 2.0 + np.cos(angle))
    result = recovery()
    assert result.direction_deg == (0, 45, 90, 135, 180, 225, 270, 315)
    limits = 2.0 + np.cos(np.radians(result.direction_deg))
    np.testing.assert_allclose(
        result.max_impulse, np.floor(limits / RESOLUTION + 1e-6) * RESOLUTION, atol=1e-9
    )
    assert np.all(np.abs(np.array(result.fitted_impulse) - limits) <= RESOLUTION)
    assert result.mean_max_impulse == pytest.approx(np.mean(result.max_impulse))
    assert result.mean_fitted_impulse == pytest.approx(np.mean(result.fitted_impulse))
    assert result.episodes == 100
    assert result.lost_before == 0
    # The control arm once, then five rounds for thirty levels, of a hundred robots a direction.
    assert rounds[0] == 100
    assert len(rounds) == 6
    assert sum(rounds) == 100 * sum(len(levels) - 1 for levels in result.levels) + 100
    assert result.measured == CONFIG.push


def test_robots_that_agree_leave_the_levels_around_their_limit_open(monkeypatch):
    pretend(monkeypatch, lambda angle, robot: 2.0 + 0.5 * np.cos(angle))
    result = recovery()
    limits = 2.0 + 0.5 * np.cos(np.radians(result.direction_deg))
    for limit, fitted, (low, high) in zip(
        limits, result.fitted_impulse, result.interval, strict=True
    ):
        assert low <= limit + 1e-9 and fitted <= high
        assert high - low == pytest.approx(RESOLUTION)
    low, high = result.mean_interval
    assert high - low == pytest.approx(RESOLUTION)
    assert low <= np.mean(limits) <= high
    # Ten robots that agree do not even show that 80 % of all survive the weakest push.
    few = recovery(replace(CONFIG, push=replace(CONFIG.push, speeds=1)))
    assert few.fitted_impulse == pytest.approx(result.fitted_impulse)
    assert [low for low, _ in few.interval] == [0.0] * 8
    assert [high for _, high in few.interval] == [high for _, high in result.interval]


def test_a_search_goes_on_until_a_level_clearly_fails(monkeypatch):
    """Of 100 robots 79 survive the first level tried, and any stronger one."""
    ids = pushed_starts(CONFIG.push, STORED).id
    pretend(monkeypatch, lambda angle, robot: np.where(np.isin(robot, ids[:21]), 2.9, 99.0))
    result = recovery()
    assert [levels[-1] for levels in result.levels] == [STRONGEST] * 8
    assert [high for _, high in result.interval] == [STRONGEST] * 8
    assert all(impulse < 3.0 for impulse in result.fitted_impulse)


def test_the_outcome_of_every_robot_is_recorded(monkeypatch):
    pretend(monkeypatch, spread_limit)
    result = recovery()
    ids = pushed_starts(CONFIG.push, STORED).id
    for degrees, levels, counts, texts in zip(
        result.direction_deg,
        result.levels,
        result.successes,
        result.survived,
        strict=True,
    ):
        limits = spread_limit(np.radians(degrees), ids)
        assert levels[0] == 0.0
        assert list(levels) == sorted(levels)
        for level, count, text in zip(levels, counts, texts, strict=True):
            assert text == "".join("01"[int(level <= limit + 1e-9)] for limit in limits)
            assert count == text.count("1")


def test_intervals_hold_the_known_limit(monkeypatch):
    pretend(monkeypatch, spread_limit)
    result = recovery()
    ids = pushed_starts(CONFIG.push, STORED).id
    for degrees, fitted, (low, high) in zip(
        result.direction_deg, result.fitted_impulse, result.interval, strict=True
    ):
        limit = np.quantile(spread_limit(np.radians(degrees), ids), 0.2)
        assert low < limit < high
        assert abs(fitted - limit) <= RESOLUTION
        # 80 +- 8 of 100 robots, whose limits rise by 4 N s from the first to the last.
        assert 0.4 < high - low < 0.9
    low, high = result.mean_interval
    assert low < result.mean_fitted_impulse < high
    assert recovery() == result


def test_impulses_are_zero_or_the_strongest_where_all_robots_fail_or_survive(monkeypatch):
    pretend(monkeypatch, lambda angle, robot: 0.0 * angle)
    assert recovery().max_impulse == (0.0,) * 8
    rounds = pretend(monkeypatch, lambda angle, robot: 2.0, unpushed=Outcome.STALLED)
    result = recovery()
    assert result.max_impulse == result.fitted_impulse == (0.0,) * 8
    assert result.mean_interval == (0.0, 0.0)
    assert len(rounds) == 1  # robots that fail unpushed are not pushed
    pretend(monkeypatch, lambda angle, robot: 1e9)
    result = recovery()
    assert result.max_impulse == pytest.approx((STRONGEST,) * 8)
    assert result.fitted_impulse == pytest.approx((STRONGEST,) * 8)


def test_robots_lost_before_the_push_fail_at_every_level(monkeypatch):
    ids = pushed_starts(CONFIG.push, STORED).id
    lost = ids[[3, 50, 99]]
    rounds = pretend(monkeypatch, lambda angle, robot: 2.0, lost=lost)
    result = recovery()
    assert result.lost_before == 3
    assert rounds[0] == 97
    for texts in result.survived:
        for text in texts:
            assert len(text) == 100
            assert text[3] == text[50] == text[99] == "0"
        assert texts[0].count("1") == 97
    # With 21 of 100 lost no level reaches 80, but only a push shows which of them clearly fails;
    # with 30 lost none has to; with all lost there is nothing to run.
    for count, runs in ((21, 2), (30, 1), (100, 0)):
        rounds = pretend(monkeypatch, lambda angle, robot: 2.0, lost=ids[:count])
        result = recovery()
        assert result.max_impulse == (0.0,) * 8
        assert result.lost_before == count
        assert len(rounds) == runs


def test_differences_are_paired(monkeypatch):
    pretend(monkeypatch, spread_limit)
    a = recovery()
    pretend(monkeypatch, lambda angle, robot: spread_limit(angle, robot) + 2 * RESOLUTION)
    b = recovery()
    same = push_difference(a, a)
    assert same.difference == 0.0
    assert -0.1 < same.interval[0] <= 0.0 <= same.interval[1] < 0.1
    paired = push_difference(b, a)
    assert paired.difference == pytest.approx(0.4, abs=0.1)
    low, high = paired.interval
    assert 0.2 < low < 0.4 < high < 0.6
    # Of two arms drawn independently, each 0.5 N s wide, it would be 0.7.
    assert high - low < (a.mean_interval[1] - a.mean_interval[0]) / 2
    assert push_difference(a, b).difference == -paired.difference


def test_pairs_that_agree_are_not_certain(monkeypatch):
    """Two controllers whose robots all have the same limit, the resolution apart."""
    pretend(monkeypatch, lambda angle, robot: 2.1)
    a = recovery()
    pretend(monkeypatch, lambda angle, robot: 2.1 + RESOLUTION)
    paired = push_difference(recovery(), a)
    assert paired.difference == pytest.approx(RESOLUTION)
    assert paired.interval == pytest.approx((0.0, 2 * RESOLUTION))


def test_pushes_of_an_earlier_version_have_honest_differences(monkeypatch):
    pretend(monkeypatch, lambda angle, robot: 2.1)
    old = replace(recovery(), measured=None)
    low, high = push_difference(old, old).interval
    assert (low, high) == pytest.approx((-RESOLUTION, RESOLUTION))


def test_only_the_same_starts_and_pushes_are_compared(monkeypatch):
    pretend(monkeypatch, lambda angle, robot: 2.0)
    result = recovery()
    for name, other in (
        ("starts_hash", "0"),
        ("split", "select"),
        ("share", 0.9),
        ("direction_deg", (0.0,)),
    ):
        with pytest.raises(ValueError, match=f"different {name}"):
            push_difference(result, replace(result, **{name: other}))
    assert result.measured is not None
    for name, other in (("before", 0.5), ("duration", 0.02), ("after", 2.0), ("fall_angle", 30.0)):
        measured = replace(result.measured, **{name: other})
        with pytest.raises(ValueError, match=f"different {name}"):
            push_difference(result, replace(result, measured=measured))


def test_a_result_without_the_outcome_of_every_robot_is_an_error(monkeypatch):
    pretend(monkeypatch, lambda angle, robot: 2.0)
    result = recovery()
    for name, value, message in (
        ("episodes", 40, "survived must have 40 digits"),
        ("levels", (), "at least one level"),
        ("successes", result.successes[:3], "successes must have one entry"),
        ("survived", result.survived[:3], "survived must have one entry"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(result, **{name: value})


def test_starts_are_the_first_perturbation_of_the_split():
    starts = pushed_starts(CONFIG.push, STORED)
    np.testing.assert_array_equal(starts.id, STORED["test"].id[:100])
    settled = pushed_starts(PUSHES, STORED)
    np.testing.assert_array_equal(settled.id[:5], [0, 6, 13, 19, 20])
    np.testing.assert_array_equal(
        settled.id, (settled.id[:4] + 20 * np.arange(10)[:, None]).ravel()
    )
    assert len(np.unique(settled.tick)) == 10
    np.testing.assert_allclose(np.unique(settled.command[:, 0]), [0, 0.1, 0.2, 0.3], atol=0.01)
    with pytest.raises(ValueError, match=r"11 velocities asked.*hold 10 in 'test'; use 1 to 10"):
        pushed_starts(replace(CONFIG.push, speeds=11), STORED)


def worlds(robot, batch, config, ground=None):
    """Robots that go on to the bit from a state."""
    return FakeSimulator(batch, robot=robot)


def job_of(n, before, config=CONFIG, plan=None):
    return Job(config, Episodes(STORED["test"][:n], before), ExpertOnly(), plan=plan)


def lasting(job, duration):
    return replace(job, episodes=replace(job.episodes, duration=duration))


def test_every_direction_pushes_every_start_at_once():
    base = job_of(3, 2.0)
    job = pushed_job(base, np.array([0.0, np.pi / 2]), np.array([1.0, 2.0]))
    pushes = disturbance_of(job).pushes
    assert pushes is not None
    expected = np.array([[1, 0, 0]] * 3 + [[0, 2, 0]] * 3)
    np.testing.assert_allclose(pushes.impulse.reshape(6, 3), expected, atol=1e-15)
    assert not pushes.tick.any()
    np.testing.assert_array_equal(job.starts.id, np.tile(base.starts.id, 2))
    np.testing.assert_array_equal(job.episode, np.tile(base.episode, 2))
    part = disturbance_of(job[np.array([4])]).pushes
    assert part is not None
    np.testing.assert_array_equal(part.impulse, pushes.impulse[[4]])


def test_branches_begin_in_the_state_at_the_push():
    config = replace(CONFIG, chunk=2)
    begin = job_of(4, 0.13, config)
    branch = branch_at_push(begin, Workers(1), "test")
    assert branch.up.all()
    for part in (slice(0, 2), slice(2, 4)):
        whole, _ = play_out(lasting(begin[part], 0.3))
        np.testing.assert_array_equal(branch.job.starts.q[part], whole.q[:, 130])
        np.testing.assert_array_equal(branch.job.starts.v[part], whole.v[:, 130])
    np.testing.assert_array_equal(branch.job.starts.tick, begin.starts.tick + 130)
    np.testing.assert_array_equal(branch.job.starts.command, begin.starts.command)
    np.testing.assert_array_equal(branch.job.starts.id, begin.starts.id)
    assert branch.job.episodes.duration == config.push.after
    assert branch.job.config.safety == replace(config.safety, grace=0.0)


@pytest.mark.parametrize("before", [0.05, 0.3])
def test_a_policy_remembers_at_the_push_what_came_before(before):
    """Were the memory new, its first answer would be that to a robot that has always stood so."""
    anywhere = replace(CONFIG.safety, fall_angle=1e4, fall_height=(-10.0, 10.0))
    config = replace(CONFIG, safety=anywhere)  # the policy is a random one
    blind = replace(SMALL, layout="proprioceptive")
    policy = Policy(trained_network(blind), spec_of(blind), np.zeros((2, 3)), "solo12")
    begin = replace(job_of(2, before, config), arbiter=PolicyOnly(), policy=policy)
    branch = branch_at_push(begin, Workers(1), "test")
    assert branch.up.all()
    after, _ = play_out(lasting(pushed_job(branch.job, np.zeros(2), np.zeros(2)), 0.003))
    whole, _ = play_out(lasting(begin, before + 0.003))
    first = to_ticks(before)
    np.testing.assert_array_equal(after.torque[:, 0], np.tile(whole.torque[:, first], (2, 1)))
    unaware = replace(branch.job, episodes=replace(branch.job.episodes, past=None))
    anew, _ = play_out(lasting(unaware, 0.003))
    assert (np.abs(anew.torque[:, 0] - whole.torque[:, first]).max(axis=1) > 1e-3).all()


def test_the_branch_of_a_controller_without_memory_carries_no_past():
    branch = branch_at_push(job_of(1, 0.1), Workers(1), "test")
    assert branch.job.episodes.past is None


def test_a_push_of_nothing_is_no_push():
    job = lasting(branch_at_push(job_of(2, 0.1), Workers(1), "test").job, 0.2)
    unpushed = run_episodes(job, Workers(1), "test")
    zero = run_episodes(pushed_job(job, np.zeros(1), np.array([0.0])), Workers(1), "test")
    weak = run_episodes(pushed_job(job, np.zeros(1), np.array([0.1])), Workers(1), "test")
    for field in fields(unpushed):
        np.testing.assert_array_equal(getattr(unpushed, field.name), getattr(zero, field.name))
    assert not np.array_equal(unpushed.mean_velocity, weak.mean_velocity)


def test_a_robot_keeps_its_friction_and_load_over_all_pushes():
    disturbance = DisturbanceConfig(friction=(0.5, 1.5), mass=(0.8, 1.2))
    begin = replace(job_of(4, 0.1), disturbance=disturbance)
    branch = branch_at_push(begin, Workers(1), "test")
    assert branch.up.all()
    job = pushed_job(branch.job, np.array([0.0, 1.0]), np.array([1.0, 2.0]))
    before = disturbance_of(begin)
    after = disturbance_of(job)
    for first, second in ((before.friction, after.friction), (before.mass, after.mass)):
        assert first is not None and second is not None
        assert len(set(first)) == 4
        np.testing.assert_array_equal(second, np.tile(first, 2))


def test_a_push_without_impulse_changes_nothing_under_noise_and_delay(monkeypatch):
    """Torques under way, noise, friction and mass of the whole rollout go on in its branch."""
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", worlds)
    noise = StateNoiseConfig(base_orientation=0.01, joint_position=0.01, joint_velocity=0.1)
    disturbance = DisturbanceConfig(friction=(0.5, 1.5), mass=(0.8, 1.2), noise=noise, delay=8)
    config = replace(CONFIG, chunk=2)
    begin = replace(job_of(4, 0.2, config, plan=toy.plan), disturbance=disturbance)
    branch = branch_at_push(begin, Workers(1), "test")
    assert branch.up.all()
    pushed = pushed_job(branch.job, np.zeros(1), np.zeros(1))
    after, _ = play_out(lasting(pushed, 0.3))
    whole, _ = play_out(lasting(begin, 0.5))
    for name in ("q", "v", "torque"):
        np.testing.assert_array_equal(getattr(after, name), getattr(whole, name)[:, 200:])
    np.testing.assert_array_equal(after.seen.q, whole.seen.q[:, 200:])
    assert not np.array_equal(whole.seen.q, whole.q)


def test_a_branch_on_mujoco_goes_on_as_the_whole_rollout_does():
    noise = StateNoiseConfig(joint_position=0.01, joint_velocity=0.05)
    disturbance = DisturbanceConfig(friction=(0.5, 1.5), mass=(0.8, 1.2), noise=noise, delay=8)
    begin = replace(job_of(2, 0.1), disturbance=disturbance)
    branch = branch_at_push(begin, Workers(1), "test")
    after, _ = play_out(lasting(branch.job, 0.1))
    whole, _ = play_out(lasting(begin, 0.2))
    np.testing.assert_allclose(after.q, whole.q[:, 100:], rtol=0, atol=1e-9)


def test_pushes_take_place_under_the_disturbance_of_the_evaluation(monkeypatch):
    seen = []
    pretend(monkeypatch, lambda angle, robot: 1.0)
    run_pretended = push_module.run_episodes

    def run_and_note(job, workers, title):
        seen.append(job.disturbance)
        assert not job.privileged  # the expert is judged
        return run_pretended(job, workers, title)

    monkeypatch.setattr(push_module, "run_episodes", run_and_note)
    disturbance = DisturbanceConfig(pushes=3, delay=3, friction=(0.6, 0.6))
    evaluation = replace(CONFIG.evaluation, disturbance=disturbance)
    recovery(replace(CONFIG, evaluation=evaluation))
    assert set(seen) == {replace(disturbance, pushes=0)}


def test_pushes_have_their_own_duration_fall_angle_and_seed(monkeypatch):
    pretend(monkeypatch, lambda angle, robot: 1.0)
    run_pretended = push_module.run_episodes
    seen = set()

    def run_and_note(job, workers, title):
        duration = job.episodes.disturbance.pushes.duration
        seen.add((duration, job.config.safety.fall_angle, job.config.seed))
        return run_pretended(job, workers, title)

    monkeypatch.setattr(push_module, "run_episodes", run_and_note)
    push = replace(CONFIG.push, duration=0.05, fall_angle=45.0)
    result = recovery(replace(CONFIG, push=push, seed=STORED.seed + 1))
    assert result.measured == push
    assert seen == {(50, 45.0, STORED.seed)}


def still(posture):
    """A plan that holds a posture."""
    reference = np.tile(posture, (100, 1))
    return lambda state, tick, command: MotionPlan(reference, 0 * reference, 0 * reference)


def test_robots_that_fall_before_the_push_are_not_in_the_branch():
    begin = job_of(2, 0.6, plan=still(np.zeros(12)))  # straight legs: they topple
    v = begin.starts.v.copy()
    v[0, 3] = 20.0  # the first one at once
    starts = replace(begin.starts, v=v)
    begin = replace(begin, episodes=replace(begin.episodes, starts=starts))
    branch = branch_at_push(begin, Workers(1), "test")
    assert not branch.up[0]
    assert len(branch.job.starts) == branch.up.sum()
    np.testing.assert_array_equal(branch.job.starts.id, begin.starts.id[branch.up])


def test_robots_that_are_all_lost_before_the_push_withstand_nothing_under_noise_either():
    few = replace(CONFIG.push, speeds=1, directions=1, levels=2, before=0.3, after=0.3)
    noise = DisturbanceConfig(noise=StateNoiseConfig(joint_position=0.01))
    config = replace(CONFIG, push=few, evaluation=replace(CONFIG.evaluation, disturbance=noise))
    zeros = np.zeros((100, 12))

    def gives_up(state, tick, command):
        return MotionPlan(zeros, zeros, zeros, valid=False)

    result = push_recovery(config, None, Workers(1), plan=gives_up)
    assert result.lost_before == result.episodes
    assert result.fitted_impulse == (0.0,)


@pytest.mark.parametrize(
    ("gait", "after", "watched"),
    [("trot", 1.6, 1.6), ("walk", 1.6, 3.06), ("walk", 4.0, 4.0), ("walk", 1.0, 1.0)],
)
def test_a_slow_gait_is_watched_until_its_steps_can_be_judged(gait, after, watched):
    config = replace(Config(), gait=GAITS[gait], push=replace(Config().push, after=after))
    assert seconds_after(config) == pytest.approx(watched)


def test_a_robot_that_only_stands_fails_even_unpushed():
    few = replace(CONFIG.push, split="nominal", speeds=1, before=0.2)
    plan = still(standing(solo12())[7:])
    config = replace(CONFIG, push=few)
    assert config.safety.stepping_from is not None
    assert to_ticks(few.after) >= to_ticks(config.safety.stepping_from)
    result = push_recovery(config, None, Workers(1), plan=plan)
    assert result.lost_before == 0
    assert result.levels == ((0.0,),) * 8
    assert result.successes == ((0,),) * 8


def test_expert_withstands_small_pushes_and_falls_from_large_ones():
    few = replace(
        CONFIG.push, before=0.2, after=0.6, speeds=1, directions=1, resolution=3.0, levels=3
    )
    result = push_recovery(replace(CONFIG, push=few, chunk=20), None, Workers(1))
    assert result.max_impulse == (3.0,)
    assert result.survived[0][0] == "1" * 10


def test_the_default_pushes_are_those_of_the_paper():
    assert CONFIG.push == PushConfig(resolution=0.2)
    assert (CONFIG.push.split, CONFIG.push.before, CONFIG.push.duration) == ("test", 2.0, 0.01)
