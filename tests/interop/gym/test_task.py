"""The task of the environments: reward, ends of episodes, and who begins where."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import CommandBox, SafetyConfig
from surefoot.interop.gym import task as walking_task
from surefoot.interop.gym.task import (
    Walkers,
    WalkingTask,
    reward_rate,
    walking_config,
)

CONFIG = walking_config("solo12")
STILL = np.zeros((2, 12))
BOTH = np.ones(2, bool)


def generators(seed=0, count=2):
    return [np.random.default_rng(seed + n) for n in range(count)]


def walkers(batch=2, config=CONFIG, **options):
    made = Walkers(config, WalkingTask(**options), batch)
    made.begin(np.ones(batch, bool), generators(count=batch))
    return made


def test_a_robot_that_does_as_told_without_effort_gets_all_of_the_reward():
    task = WalkingTask(tracking=1.0, turning=0.5, alive=0.25, effort=2.0)
    asked = np.array([[0.2, 0.1, 0.3]])
    assert reward_rate(task, asked, asked, np.zeros(1)) == pytest.approx(1.75)
    assert reward_rate(task, asked, asked, np.array([0.5])) == pytest.approx(0.75)


def test_an_error_of_one_scale_leaves_a_share_of_1_over_e():
    task = WalkingTask(tracking=1.0, turning=0.0, alive=0.0, velocity_scale=0.2)
    wrong = np.array([[0.12, 0.16, 9.0]])
    assert reward_rate(task, wrong, np.zeros((1, 3)), np.zeros(1)) == pytest.approx(np.exp(-1.0))


def test_the_nominal_pose_stands_until_the_time_is_over():
    robots = walkers(duration=0.06)
    ends = [robots.decide(STILL, BOTH) for _ in range(3)]
    assert [end.truncated.tolist() for end in ends] == [[False] * 2, [False] * 2, [True] * 2]
    assert not any(end.terminated.any() for end in ends)


def test_a_decision_takes_as_many_ticks_as_the_rate_says():
    robots = walkers(rate=250)
    before = robots.tick.copy()
    robots.decide(STILL, BOTH)
    assert (robots.tick - before).tolist() == [4, 4]


def test_the_reward_of_a_second_is_about_the_same_at_every_rate():
    returns = []
    for rate in (50, 500):
        robots = walkers(rate=rate)
        returns.append(sum(robots.decide(STILL, BOTH).reward for _ in range(rate // 5)))
    np.testing.assert_allclose(returns[0], returns[1], rtol=0.02)


def test_robots_outside_the_mask_stay_where_they_are():
    robots = walkers()
    before = robots.observation
    decided = robots.decide(STILL, np.array([True, False]))
    assert (robots.observation[1] == before[1]).all()
    assert (robots.observation[0] != before[0]).any()
    assert decided.reward[1] == 0.0


def test_a_fall_by_the_packages_own_rule_terminates_and_stops_the_robot():
    bounds = replace(CONFIG.safety, grace=0.005, fall_height=(1.0, 2.0))
    robots = walkers(config=replace(CONFIG, safety=bounds))
    before = robots.tick.copy()
    decided = robots.decide(STILL, BOTH)
    assert decided.terminated.all()
    assert not decided.truncated.any()
    assert (robots.tick - before).tolist() == [5, 5]


@pytest.mark.parametrize("body_contact", [0.01, 0.0004])
def test_a_body_on_the_ground_is_a_fall_where_the_bounds_say_so(body_contact):
    bounds = SafetyConfig(
        grace=0.0, body_contact=body_contact, fall_height=(-9.0, 9.0), fall_angle=180.0
    )
    robots = walkers(config=replace(CONFIG, safety=bounds), rate=10)
    limp = np.tile([0.0, 1.0, 0.0], (2, 4))
    fell = [robots.decide(limp, BOTH).terminated for _ in range(10)]
    assert np.any(fell, axis=0).all()


def test_commands_are_drawn_from_the_box_of_the_configuration():
    box = CommandBox(vx=(0.1, 0.2), vy=(-0.1, 0.1), yaw_rate=(0.3, 0.3))
    robots = walkers(batch=20, config=replace(CONFIG, commands=box))
    low, high = np.array([box.vx, box.vy, box.yaw_rate]).T
    assert ((robots.command >= low) & (robots.command <= high)).all()
    assert np.ptp(robots.command[:, 0]) > 0.05


def test_stored_initial_states_bring_their_commands():
    from surefoot.scenarios.starts import load_starts

    robots = walkers(batch=3, begin="test")
    stored = load_starts()["test"]
    joints = robots.observation[:, 10:22]
    for row in range(3):
        match = np.abs(stored.q[:, 7:] - joints[row]).max(axis=1) < 1e-5
        assert match.sum() == 1
        assert robots.command[row].tolist() == stored.command[match][0].tolist()


def test_the_experts_action_gives_the_experts_torque():
    robots = walkers(rate=1000, expert=True, begin="nominal")
    for _ in range(60):
        decided = robots.decide(robots.expert_action, BOTH)
    error = np.abs(decided.velocity[:, 0] - robots.command[:, 0])
    assert (error < 0.15).all()  # it goes on walking
    assert np.abs(robots.expert_action).max() < 1.0


def test_a_new_episode_asks_the_expert_anew():
    robots = walkers(expert=True, begin="nominal")
    first = robots.expert_action
    robots.decide(STILL, BOTH)
    robots.begin(np.array([True, False]), generators())
    assert (robots.expert_action[0] == first[0]).all()
    assert (robots.expert_action[1] != first[1]).any()


def test_a_terrain_is_refused_and_not_ignored():
    simulation = replace(CONFIG.simulation, terrain="bumps:0.03")
    with pytest.raises(ValueError, match=r"simulation\.terrain is 'bumps:0\.03'"):
        Walkers(replace(CONFIG, simulation=simulation), WalkingTask(), 1)


def test_an_expert_that_is_asked_has_measured_command_gains(monkeypatch):
    measured = []

    def measure(config):
        measured.append(config)
        return replace(config, expert=replace(config.expert, command_gain=(1.5, 1.4, 1.3)))

    made = []
    monkeypatch.setattr(walking_task, "with_measured_gain", measure)
    monkeypatch.setattr(walking_task, "make_expert", lambda robot, config: made.append(config))
    config = walking_config("go2")
    assert config.expert.command_gain is None
    Walkers(config, WalkingTask(), 1)
    assert measured == []
    Walkers(config, WalkingTask(expert=True), 1)
    assert measured == [config]
    [used] = made
    assert used.expert.command_gain == (1.5, 1.4, 1.3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rate": 300}, "divisor of 1000"),
        ({"rate": 0}, "use 1 to 1000"),
        ({"begin": "nowhere"}, "there is no task.begin"),
        ({"effort": -1.0}, "use 0.0 to"),
    ],
)
def test_a_task_that_cannot_be_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        WalkingTask(**options)
