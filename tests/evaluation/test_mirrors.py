"""Which mirror a training uses."""

from dataclasses import replace

import pytest

from surefoot.config import CommandBox, Config, Gait, RobotConfig
from surefoot.evaluation.mirrors import make_mirror, training_mirror

CONFIG = Config()
UNEVEN = replace(CONFIG, gait=Gait(offsets=(0.0, 0.5, 0.5, 0.25)))


def with_mirror(config, name):
    return replace(config, training=replace(config.training, mirror=name))


def test_a_training_mirrors_left_and_right_where_robot_and_gait_allow_it():
    left_right = make_mirror(CONFIG, "left_right")
    assert training_mirror(with_mirror(CONFIG, "auto")) == left_right
    assert training_mirror(with_mirror(CONFIG, "left_right")) == left_right
    assert training_mirror(with_mirror(CONFIG, "none")) is None
    assert training_mirror(with_mirror(UNEVEN, "auto")) is None
    sideways = replace(CONFIG, commands=CommandBox(vy=(0.0, 0.2)))
    assert training_mirror(with_mirror(sideways, "auto")) is None
    assert training_mirror(with_mirror(sideways, "left_right")) == left_right
    go1 = replace(CONFIG, robot=RobotConfig("go1"))
    assert training_mirror(with_mirror(go1, "auto")) is None
    with pytest.raises(ValueError, match="go1 is not its own mirror image"):
        training_mirror(with_mirror(go1, "left_right"))
