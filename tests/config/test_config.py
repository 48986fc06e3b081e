"""The whole configuration."""

from dataclasses import replace

import pytest

from surefoot.config import METHODS, BehaviorCloningConfig, Config, method_name, simulated


@pytest.mark.parametrize(("name", "kind"), METHODS.items())
def test_a_method_knows_its_name(name, kind):
    assert method_name(replace(Config(), method=kind())) == name


def test_a_configuration_moves_to_another_simulator_and_keeps_all_else():
    config = Config(seed=3)
    moved = simulated(config, "bullet")
    assert moved.simulation.backend == "bullet"
    assert simulated(moved, "mujoco") == config


@pytest.mark.parametrize("method", [None, "dagger", BehaviorCloningConfig])
def test_a_method_is_an_instance_of_its_class(method):
    with pytest.raises(ValueError, match=r"method is .*expected one of BehaviorCloningConfig"):
        Config(method=method)  # pyright: ignore[reportArgumentType]
