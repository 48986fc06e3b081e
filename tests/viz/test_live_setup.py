"""What can be driven: by which policy, in which range, and by whom after another choice."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.bench.engine import standing_policy
from surefoot.config import CommandBox, Config, RobotConfig
from surefoot.config.checked import known
from surefoot.config.expert_rules import ALL_ROUND_RULES
from surefoot.config.json_io import to_json
from surefoot.config.robot_table import GO2, SOLO12
from surefoot.config.single_gaits import each_gait
from surefoot.files import write_json
from surefoot.learning.policy import load, save
from surefoot.mpc.gaits import with_gaits
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.types import Command
from surefoot.viz import live_setup
from surefoot.viz.live_setup import expert_setup, find_setup, start, with_choice
from surefoot.viz.replay import standing_start


def test_a_run_is_driven_by_its_policy_within_the_range_of_its_training(queried_run):
    setup = find_setup(queried_run.folder)
    low, high = setup.commands
    assert setup.policy is not None
    np.testing.assert_array_equal([low, high], setup.policy.command_range)
    assert start(setup).drivers == ("policy", "expert", "guarded policy")
    assert (setup.gait, setup.notes) == ("trot", ())


def test_a_policy_file_is_driven_as_its_run_is(queried_run):
    setup = find_setup(queried_run.best_policy_path)
    assert setup.policy is not None
    assert setup.config == find_setup(queried_run.folder).config


def test_without_a_target_the_packaged_policy_drives_where_it_fits():
    setup = find_setup(None)
    assert setup.policy is not None
    assert (setup.policy.robot, setup.gait) == ("solo12", "trot")
    assert find_setup(None, gait="stand").policy is None


def test_an_expert_drives_both_ways():
    setup = expert_setup(Config(), "solo12", "trot")
    assert setup.policy is None
    assert start(setup).drivers == ("expert",)
    low, high = setup.commands
    assert all(value < 0.0 for value in low)
    assert all(value > 0.0 for value in high)


def test_a_trot_that_turns_has_the_rules_of_a_whole_box():
    """Solo12's first rules, for straight ahead, let it drift outward in a turn."""
    expert = expert_setup(Config(), "solo12", "trot").config.expert
    assert expert.turn_compensation == ALL_ROUND_RULES["turn_compensation"]
    assert expert.capture_share == ALL_ROUND_RULES["capture_share"]


@pytest.fixture
def unmeasured(monkeypatch):
    """Command gains are not measured, which would take seconds."""
    live_setup._measured_with.cache_clear()
    monkeypatch.setattr(live_setup, "with_measured_gain", with_own_values)


def test_another_gait_is_driven_by_the_expert_and_the_policy_comes_back(queried_run, unmeasured):
    first = find_setup(queried_run.folder)
    walk = with_choice(first, first, "solo12", "walk")
    assert (walk.policy, walk.gait) == (None, "walk")
    again = with_choice(first, walk, "solo12", "trot")
    assert again is first
    assert with_choice(first, walk, "solo12", "walk") is walk


def test_an_expert_without_a_policy_walks_a_further_gait_besides(unmeasured):
    first = expert_setup(Config(), "solo12", "trot")
    walk = with_choice(first, first, "solo12", "walk")
    bound = with_choice(first, walk, "solo12", "bound")
    assert (bound.gaits, bound.gait) == (("trot", "walk", "bound"), "bound")
    assert bound.extends(walk) and bound.extends(first)
    assert not bound.extends(expert_setup(Config(), "go2", "trot"))
    for one, alone in zip(each_gait(bound.config), bound.gaits, strict=True):
        assert one.expert == expert_setup(Config(), "solo12", alone).config.expert
    again = with_choice(first, bound, "solo12", "walk")
    assert again.config is bound.config
    assert again.gait == "walk"
    # The safety bounds hold those of each gait.
    tables = [expert_setup(Config(), "solo12", name).config.safety for name in bound.gaits]
    heights = [known(table.com_height, "safety.com_height") for table in tables]
    low, high = zip(*heights, strict=True)
    assert bound.config.safety.com_height == (min(low), max(high))


def test_a_robot_of_a_users_own_walks_another_gait(unmeasured):
    own = RobotConfig(spec=replace(GO2, name="mine"))
    first = expert_setup(Config(robot=own), "mine", "trot")
    walk = with_choice(first, first, "mine", "walk")
    assert (walk.robot, walk.gait, walk.config.robot.spec) == ("mine", "walk", own.spec)


def test_a_file_with_the_robot_of_a_policy_leaves_the_policy_driving(
    tmp_path, monkeypatch, queried_run
):
    mine = replace(SOLO12, name="mine")
    file = tmp_path / "robot.json"
    write_json(file, to_json(mine))
    policy = load(queried_run.best_policy_path, "solo12")
    policy.robot = "mine"
    path = tmp_path / "policy.safetensors"
    save(policy, path)
    config = replace(queried_run.config, robot=RobotConfig(spec=mine))
    monkeypatch.setattr(live_setup, "find_policy", lambda _: (path, config))
    monkeypatch.setattr(live_setup, "_measured", lambda one: (with_own_values(one), ""))
    assert find_setup(path, str(file)).policy is not None
    assert find_setup(path, "go2").policy is None


def test_a_policy_of_several_gaits_drives_in_each_of_them(tmp_path, unmeasured):
    path = tmp_path / "policy.safetensors"
    save(standing_policy(with_gaits(Config(), ["trot", "bound"])), path)
    setup = find_setup(path, gait="bound")
    assert setup.policy is not None
    assert (setup.gaits, setup.gait) == (("trot", "bound"), "bound")
    assert setup.notes == ()
    simulation = start(setup)
    assert simulation.snapshot().gait == 1
    simulation.step(20)
    simulation.set_gait(0)
    simulation.step(580)
    assert simulation.snapshot().gait == 0
    assert with_choice(setup, setup, "solo12", "walk").policy is None


def test_a_larger_robot_may_walk_faster(unmeasured):
    small = expert_setup(Config(), "solo12", "trot")
    large = expert_setup(Config(), "go2", "trot")
    assert large.commands[1].vx > small.commands[1].vx
    assert large.commands[1].yaw_rate == small.commands[1].yaw_rate
    assert large.config.safety.com_height != small.config.safety.com_height


BUMPS = replace(Config().simulation, terrain="bumps:0.03")
LEVEL = "The ground is level here: simulation.terrain, bumps:0.03, is that of episodes only."


def test_each_note_is_a_sentence_that_is_said_once(monkeypatch):
    def refuse(config):
        raise ValueError(f"it fell in {config.gait.period:g} s")

    live_setup._measured_with.cache_clear()
    monkeypatch.setattr(live_setup, "with_measured_gain", refuse)
    walk = expert_setup(Config(simulation=BUMPS), "solo12", "walk")
    unmeasured = "The command gains could not be measured and are 1: it fell in"
    assert walk.notes == (f"{unmeasured} 1 s.", LEVEL)
    bound = with_choice(walk, walk, "solo12", "bound")
    assert bound.notes == (f"{unmeasured} 1 s.", LEVEL, f"{unmeasured} 0.3 s.")


def test_a_terrain_of_the_configuration_is_said_not_to_be_there(unmeasured):
    assert expert_setup(Config(simulation=BUMPS), "solo12", "walk").notes == (LEVEL,)
    assert expert_setup(Config(), "solo12", "walk").notes == ()


def test_the_expert_walks_live_as_it_does_in_a_rollout_to_the_same_bits():
    setup = expert_setup(Config(), "solo12", "trot")
    command = Command(0.2, 0.1, -0.3)
    box = CommandBox((0.0, 0.2), (0.0, 0.1), (-0.3, 0.0))
    config = replace(setup.config, commands=box)
    episodes = Episodes(standing_start(command), 0.3)
    rollouts, _ = play_out(Job(config, episodes, ExpertOnly()))
    simulation = start(setup)
    simulation.set_command(command)
    simulation.step(299)
    np.testing.assert_array_equal(simulation.snapshot().state.q, rollouts.q[0, 299])


def test_the_plan_that_is_drawn_begins_at_the_robot_and_stands_on_the_floor():
    simulation = start(expert_setup(Config(), "solo12", "trot"))
    simulation.set_command(Command(0.3))
    simulation.step(1)
    simulation.step(450)
    snapshot = simulation.snapshot()
    plan = snapshot.plan
    assert plan is not None
    assert plan.tick == 450
    np.testing.assert_allclose(plan.com[0], snapshot.state.com, atol=2e-3)
    assert plan.com[-1, 0] > plan.com[0, 0] + 0.05
    np.testing.assert_allclose(plan.footholds[:, 2], simulation.robot.foot_radius, atol=5e-3)
    assert set(plan.legs.tolist()) == {0, 1, 2, 3}
    left = plan.footholds[np.isin(plan.legs, (0, 2)), 1].min()
    right = plan.footholds[np.isin(plan.legs, (1, 3)), 1].max()
    assert left > snapshot.state.com[1] > right


def test_no_plan_is_drawn_while_the_policy_drives(queried_run):
    simulation = start(find_setup(queried_run.folder))
    simulation.set_driver("expert")
    simulation.step(60)
    assert simulation.snapshot().plan is not None
    simulation.set_driver("policy")
    simulation.step(1)
    assert simulation.snapshot().plan is None
    simulation.set_driver("expert")
    simulation.reset()
    assert simulation.snapshot().plan is None


def test_a_pushed_robot_recovers():
    simulation = start(expert_setup(Config(), "solo12", "trot"))
    simulation.set_command(Command(0.2))
    simulation.step(1500)
    simulation.push(0.8, 90.0)
    simulation.step(2000)
    snapshot = simulation.snapshot()
    assert snapshot.ended == ""
    roll = np.degrees(simulation.trace[:, 1])
    assert np.abs(roll).max() > 8.0
    assert np.abs(roll[-25:]).max() < 6.0


def test_command_gains_are_measured_again_once_the_files_of_the_robot_have_changed(monkeypatch):
    contents = iter(["before", "before", "after"])
    measured = []

    def measure(config):
        measured.append(config)
        return config

    live_setup._measured_with.cache_clear()
    monkeypatch.setattr(live_setup, "content_hash", lambda config: next(contents))
    monkeypatch.setattr(live_setup, "with_measured_gain", measure)
    for times in (1, 1, 2):
        expert_setup(Config(), "solo12", "walk")
        assert len(measured) == times
    live_setup._measured_with.cache_clear()
