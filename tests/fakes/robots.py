"""What tests of simulators share: a robot, states and torques to try, and the backends."""

from importlib.util import find_spec

import numpy as np
import pytest

from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
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


def shaken(state: State, tick: int, seed: int = 7):
    """A PD law that makes every robot stamp in its own way: contacts open, close and slide."""
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0.0, 2 * np.pi, (64, 12))[: len(state.q)]
    return pd(state) + 1.2 * np.sin(2 * np.pi * 3.0 * tick / 1000 + phase)


def stand(simulator, ticks: int = 2000, kp: float = 10.0, kd: float = 0.2):
    """A robot in a PD law's hands until it is at rest."""
    for _ in range(ticks):
        simulator.step(pd(simulator.state, kp, kd))
    return simulator


def varied(simulator, friction, mass):
    """The simulator with such a friction and base mass of each robot, standing."""
    batch = simulator.batch
    simulator.vary(np.full(batch, friction), np.full(batch, mass))
    simulator.reset(np.tile(STANDING, (batch, 1)), np.zeros((batch, 18)))
    return simulator


def record(simulator, ticks: int, start: int = 0):
    """All bits a rollout could see."""
    rows = []
    for tick in range(start, start + ticks):
        state = simulator.state
        force = simulator.contact_force
        rows.append(np.hstack([state.q, state.v, state.com, state.feet.reshape(-1, 12), force]))
        simulator.step(shaken(state, tick))
    return np.array(rows)
