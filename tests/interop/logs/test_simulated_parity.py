"""In the simulator, the runtime of an exported file drives a robot as its policy does."""

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.deploy.policy import load
from surefoot.learning.policy import pd
from surefoot.robots.model import standing
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.summary import velocities
from surefoot.scenarios.starts import at_rest
from surefoot.sim import make_simulator
from surefoot.types import Command
from tests.fakes.exports import exported, robot_of

ZEROS = np.zeros(12)


class Runtime:
    """One robot, driven as the loop on a robot does: from sensors to torques."""

    def __init__(self, policy, spec):
        self.policy = policy
        self.spec = spec

    def reset(self, batch):
        self.begins = True

    def torque(self, state, tick, command, mask):
        q = state.q[0]
        v = state.v[0]
        base = BaseEstimate(float(q[2]), v[:3])
        sensors = Sensors(0, 0, q[7:], v[6:], ZEROS, q[3:7], v[3:6], ZEROS[:3], base)
        if self.begins:
            self.policy.reset(sensors)
            self.begins = False
        target = self.policy.target(sensors, int(tick[0]), Command(*command[0]))
        return pd(target[None], state.q, state.v, self.spec)

    @property
    def diverged(self):
        return np.zeros(1, bool)


class Nobody(Runtime):
    def torque(self, state, tick, command, mask):
        raise NotImplementedError  # the policy drives alone


@pytest.mark.parametrize("layout", ["full", "proprioceptive"])
@pytest.mark.parametrize("seconds", [0.25, pytest.param(5.0, marks=pytest.mark.slow)])
def test_outcome_and_speed_are_the_same(tmp_path, layout, seconds):
    path, policy = exported(tmp_path, layout)
    robot = robot_of()
    start = at_rest(standing(robot), np.array([[0.2, 0.0, 0.0]]))
    runs = [
        rollout(
            make_simulator(robot, 1, Config().simulation),
            Episodes(start, seconds),
            PolicyOnly(),
            Nobody(None, None),
            driver,
        )
        for driver in (policy, Runtime(load(path), policy.spec))
    ]
    expected, found = runs
    assert found.outcome.tolist() == expected.outcome.tolist()
    assert abs(int(found.length[0]) - int(expected.length[0])) <= 5
    shared = slice(0, int(min(found.length[0], expected.length[0])))
    speeds = [velocities(run)[0, shared, 0].mean() for run in runs]
    assert speeds[1] == pytest.approx(speeds[0], rel=0.01, abs=1e-3)
