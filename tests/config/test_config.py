"""The whole configuration."""

import pytest

from surefoot.config import (
    METHODS,
    MOST_GAITS,
    BehaviorCloningConfig,
    Config,
    Gait,
    OtherGait,
    simulated,
)


@pytest.mark.parametrize(("name", "kind"), METHODS.items())
def test_a_method_knows_its_name(name, kind):
    assert Config(method=kind()).method.name == name


def test_a_configuration_moves_to_another_simulator_and_keeps_all_else():
    config = Config(seed=3)
    moved = simulated(config, "bullet")
    assert moved.simulation.backend == "bullet"
    assert simulated(moved, "mujoco") == config


@pytest.mark.parametrize("method", [None, "dagger", BehaviorCloningConfig])
def test_a_method_is_an_instance_of_its_class(method):
    with pytest.raises(ValueError, match=r"method is .*expected one of BehaviorCloningConfig"):
        Config(method=method)  # pyright: ignore[reportArgumentType]


def of_periods(*periods):
    return tuple(OtherGait(Gait(period=period)) for period in periods)


def test_a_configuration_has_as_many_gaits_as_a_policy():
    periods = [0.6 + 0.1 * number for number in range(MOST_GAITS)]
    assert len(Config(other_gaits=of_periods(*periods[1:])).gaits) == MOST_GAITS
    with pytest.raises(ValueError, match=r"other_gaits makes 17 gaits; use at most 16"):
        Config(other_gaits=of_periods(*periods))


def test_a_gait_is_there_once_at_whatever_height():
    with pytest.raises(ValueError, match=r"gaits number 1 and 2 have the same timing .*once"):
        Config(other_gaits=of_periods(0.6, 0.6))
    low = OtherGait(Gait(com_height=0.2))
    with pytest.raises(ValueError, match=r"gaits number 0 and 1 have the same timing"):
        Config(other_gaits=(low,))
