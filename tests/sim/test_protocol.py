"""Both backends keep the contract of simulators; the check of what `vary` is given."""

import numpy as np
import pytest

from surefoot.config import SimulationConfig
from surefoot.config.sim import parse_terrains
from surefoot.scenarios.ground import put_under
from surefoot.sim import make_simulator
from surefoot.sim.protocol import check_positive
from surefoot.sim.terrain import Ground
from surefoot.testing import SimulatorContract
from tests.fakes.robots import ROBOT, STANDING, needs_pybullet


class TestMujoco(SimulatorContract):
    def make_simulator(self, batch):
        return make_simulator(ROBOT, batch, SimulationConfig("mujoco"))


@needs_pybullet
class TestBullet(SimulatorContract):
    ticks = 80

    def make_simulator(self, batch):
        return make_simulator(ROBOT, batch, SimulationConfig("bullet"))


def test_positive_numbers_are_copied():
    values = np.array([0.5, 2.0])
    copy = check_positive("mass", values, 2)
    values[0] = -1.0
    np.testing.assert_array_equal(copy, [0.5, 2.0])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, 0.0], "mass of robot 1 is 0.0; it must be finite and positive"),
        ([-0.1, 0.5], "mass of robot 0 is -0.1; it must be finite and positive"),
        ([0.5, np.nan], "mass of robot 1 is nan"),
        ([np.inf, 1.0], "mass of robot 0 is inf"),
        ([0.5], r"mass has shape \(1,\); give one for each robot: \(2,\)"),
        (1.0, r"mass has shape \(\); give one for each robot: \(2,\)"),
    ],
)
def test_numbers_that_are_not_positive_are_named(values, message):
    with pytest.raises(ValueError, match=message):
        check_positive("mass", np.array(values), 2)


@pytest.mark.thorough
class TestMujocoOnBumps(SimulatorContract):
    """What is promised of robots holds on ground of their own too."""

    def make_simulator(self, batch):
        q = np.tile(STANDING, (batch, 1))
        ground = Ground(parse_terrains("bumps:0.02") * batch, np.zeros((batch, 3)), np.ones(batch))
        return make_simulator(ROBOT, batch, None, put_under(ground, ROBOT, q))
