"""What tests of simulators share: a robot, states and torques to try, and the backends.

`surefoot.testing.driving` has what they share with the contract, such as recordings.
"""

from importlib.util import find_spec

import numpy as np
import pytest

from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.testing.driving import vary_and_reset
from surefoot.types import State

ROBOT = solo12()
STANDING = standing(ROBOT)
GRAVITY = 9.81
REST = np.zeros((1, 18))

needs_pybullet = pytest.mark.skipif(
    find_spec("pybullet") is None, reason="PyBullet has wheels up to Python 3.11 only"
)
BACKENDS = ["mujoco", pytest.param("bullet", marks=needs_pybullet)]


def random_states(count: int, height: float = 2.0, seed: int = 0):
    rng = np.random.default_rng(seed)
    q = np.empty((count, 19))
    q[:, :3] = rng.normal(0.0, 0.3, (count, 3))
    q[:, 2] += height
    quaternion = rng.normal(size=(count, 4))
    q[:, 3:7] = quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)
    q[:, 7:] = STANDING[7:] + rng.uniform(-1.0, 1.0, (count, 12))
    return q, rng.normal(0.0, 1.0, (count, 18))


def pd(state: State, kp: float = 3.0, kd: float = 0.05):
    return kp * (STANDING[7:] - state.q[:, 7:]) - kd * state.v[:, 6:]


def stand(simulator, ticks: int = 2000, kp: float = 10.0, kd: float = 0.2):
    """The simulator, after a PD law has held its robots in the standing pose for so long."""
    for _ in range(ticks):
        simulator.step(pd(simulator.state, kp, kd))
    return simulator


def varied(simulator, friction, mass):
    """The simulator, its robots standing with this friction and this factor on the base mass."""
    batch = simulator.batch
    vary_and_reset(simulator, np.full(batch, friction), np.full(batch, mass))
    return simulator
