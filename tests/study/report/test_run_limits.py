"""The limits on a model card say what the configuration says."""

from dataclasses import replace

import pytest

from surefoot.config import DisturbanceConfig
from surefoot.config.presets import preset
from surefoot.config.scenarios import acting
from surefoot.methods import METHODS
from surefoot.study.report.run_limits import disturbance_texts, limitations


def text_of(config, is_field_run=False):
    return " ".join(limitations(config, is_field_run))


def test_the_ground_and_what_the_network_sees_are_those_of_the_run():
    config = preset("loco_safe_dagger")
    level = text_of(config)
    assert "on level ground" in level and "sees the full state." in level
    config = replace(config, simulation=replace(config.simulation, terrain="bumps:0.03"))
    config = replace(config, policy=replace(config.policy, layout="proprioceptive"))
    rough = text_of(config)
    assert "on the terrain bumps:0.03" in rough and "level ground" not in rough
    assert "what a robot measures" in rough and "full state" not in rough
    assert "commands outside vx 0 to 0.3 m/s, vy 0 to 0 m/s, the yaw rate 0 to 0 rad/s." in level


def test_pushes_of_pretraining_and_of_iterations_are_told_apart():
    calm = replace(preset("loco_safe_dagger"), collection=DisturbanceConfig())
    assert "No robot was pushed" in text_of(calm)
    pushed = replace(calm, pretraining=DisturbanceConfig(1, (0.5, 3.0)))
    first = text_of(pushed)
    assert "While the expert was recorded, robots were disturbed: pushes 1" in first
    assert "In the iterations" not in first and "No robot was pushed" not in first
    assert "In the iterations, robots were disturbed" in text_of(preset("loco_safe_dagger"))
    # Behavior cloning has no pre-training: its data is that of `collection`.
    cloning = replace(preset("behavior_cloning"), collection=DisturbanceConfig(2))
    assert "While the expert was recorded, robots were disturbed: pushes 2" in text_of(cloning)


def test_options_of_pushes_that_never_come_disturb_nobody():
    idle = DisturbanceConfig(0, (0.3, 1.5), gentle=0.7, fall_angle=60.0)
    assert disturbance_texts(acting(idle, rises=True, teaches=True)) == []
    assert disturbance_texts(replace(acting(idle), delay=3)) == ["delay 3"]
    taught = replace(idle, expert_impulse=(0.5, 3.0))
    # Only LocoDAGGER and LocoSafeDAGGER let the expert drive in order to teach.
    for method in METHODS:
        text = text_of(replace(preset(method), collection=taught))
        assert ("expert_impulse 0.5 to 3" in text) == method.startswith("loco_")


@pytest.mark.parametrize("method", ["behavior_cloning", "dagger"])
def test_only_a_best_policy_that_select_chose_is_flattered(method):
    chosen = method == "dagger"
    assert ("chose the best policy" in text_of(preset(method))) == chosen
    assert "chose the best policy" not in text_of(preset(method), is_field_run=True)


def test_a_run_on_a_robot_was_not_collected_in_simulation_alone():
    text = text_of(preset("loco_safe_dagger"), is_field_run=True)
    assert "on a robot behind a bridge" in text
    assert "nothing of it has been tried on a robot" not in text
