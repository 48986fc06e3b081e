"""The function that makes the simulator of a configuration."""

import pytest

from surefoot.config import SimulationConfig
from surefoot.sim import make_simulator
from tests.fakes.robots import BACKENDS, ROBOT


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_simulator_is_that_of_the_config_and_knows_its_robot(backend):
    simulator = make_simulator(ROBOT, 3, SimulationConfig(backend))
    assert type(simulator).__name__ == f"{backend.title()}Simulator"
    assert simulator.robot is ROBOT
    assert simulator.batch == 3


@pytest.mark.parametrize("batch", [0, -1])
def test_a_simulator_without_robots_is_refused(batch):
    with pytest.raises(ValueError, match=f"batch is {batch}; a simulator holds at least one robot"):
        make_simulator(ROBOT, batch)
