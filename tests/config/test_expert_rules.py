"""The expert's rules for robot, gait, commands and ground."""

from dataclasses import replace

import pytest

from surefoot.config import (
    CommandBox,
    Config,
    ExpertConfig,
    Gait,
    RobotConfig,
    SimulationConfig,
)
from surefoot.config.expert_rules import ground_for, with_ground
from surefoot.config.presets import PRESETS, preset
from surefoot.robots.scaling import with_own_values


def rules(config: Config) -> tuple[float | None, float | None]:
    expert = with_own_values(config).expert
    return expert.turn_compensation, expert.capture_share


@pytest.mark.parametrize("name", PRESETS)
def test_the_presets_keep_the_experts_rules_of_the_first_initial_states(name):
    assert rules(preset("dagger", name)) == (0.0, 0.0)


@pytest.mark.parametrize(
    "config",
    [
        Config(gait=Gait(period=0.4)),
        Config(commands=CommandBox(vy=(-0.1, 0.1))),
        Config(robot=RobotConfig("go2")),
    ],
)
def test_other_gaits_commands_and_robots_get_the_all_round_rules(config):
    assert rules(config) == (0.3, 0.25)


def test_rules_that_were_chosen_stay_even_where_they_are_no_others_default():
    box = CommandBox(vy=(-0.1, 0.1))
    assert rules(Config(commands=box, expert=ExpertConfig(turn_compensation=0.2))) == (0.2, 0.25)
    none = ExpertConfig(turn_compensation=0.0, capture_share=0.0)
    assert rules(Config(commands=box, expert=none)) == (0.0, 0.0)


def test_published_rules_have_neither():
    config = replace(preset("dagger", "paper"), commands=CommandBox(vy=(-0.1, 0.1)))
    assert rules(config) == (0.0, 0.0)


def test_the_ground_under_the_feet_is_planned_on_where_robots_may_meet_uneven_ground():
    hills = SimulationConfig(terrain="flat,slope:0..10")
    assert ground_for(Config()) == "level"
    assert ground_for(Config(simulation=hills)) == "feet"
    assert ground_for(Config(simulation=hills, robot=RobotConfig("go2"))) == "feet"
    published = ExpertConfig(foothold_rule="published")
    assert ground_for(Config(simulation=hills, expert=published)) == "level"


def test_the_ground_is_written_down_where_there_is_a_terrain():
    hills = Config(simulation=SimulationConfig(terrain="slope:5"))
    published = replace(hills, expert=ExpertConfig(foothold_rule="published"))
    chosen = replace(hills, expert=ExpertConfig(ground="level"))
    assert with_ground(Config()) == Config()
    assert with_ground(hills).expert.ground == "feet"
    assert with_ground(published).expert.ground == "level"
    assert with_ground(chosen) == chosen
