"""A toy robot that can be computed by hand: a linear plant under an LQR expert.

Each of the 12 joints is a double integrator under its torque. Roll is an inverted pendulum that the
four HAA torques push; a push sideways is a kick to its rate. The rest of the base stays where the
episode began.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

from surefoot.types import MotionPlan
from tests.fakes.robots import ROBOT
from tests.fakes.simulator import FakeSimulator

DT = 1e-3
"""[s]"""
INERTIA = 0.02
"""[kg m^2] The inertia of a joint."""
GRAVITY = 9.0
"""[1/s^2] The acceleration of roll per rad."""
HELD = 5.0
"""[1/(kg m^2)] The acceleration of roll per HAA torque."""
KICK = 2.0
"""[rad/s] The change of the roll rate per N s of a push sideways."""
ARM = HELD * np.tile([1.0, 0.0, 0.0], 4)
NOMINAL = np.array([0.0, 0.8, -1.6, 0.0, 0.8, -1.6, 0.0, -0.8, 1.6, 0.0, -0.8, 1.6])


def matrices():
    """x' = A x + B tau, for x = [roll, 12 joints, roll rate, 12 joint rates]."""
    force = np.zeros((13, 13))
    push = np.zeros((13, 12))
    force[0, 0] = GRAVITY
    push[0] = ARM
    push[1:] = np.eye(12) / INERTIA
    one = np.eye(13)
    A = np.block([[one + DT * DT * force, DT * one], [DT * force, one]])
    return A, np.vstack([DT * DT * push, DT * push])


A, B = matrices()
_Q = np.diag([200.0, *[2.0] * 12, 20.0, *[0.05] * 12])
_P = solve_discrete_are(A, B, _Q, np.eye(12))
K = np.linalg.solve(np.eye(12) + B.T @ _P @ B, B.T @ _P @ A)
POWERS = np.array([np.linalg.matrix_power(A - B @ K, n) for n in range(100)])
"""``(100, 26, 26)`` the matrices that take an error to the one after n ticks of expert control."""


def goal_of(tick, command):
    """Where the expert wants x: the joints swing with the gait and lean with the command."""
    swing = 0.1 * np.sin(2 * np.pi * tick / 500) + 0.5 * command[0]
    return np.concatenate([[0.0], NOMINAL + swing, np.zeros(13)])


def x_of(q, v):
    """x of a configuration and velocity."""
    roll = Rotation.from_quat(q[3:7]).as_euler("ZYX")[2]
    return np.concatenate([[roll], q[7:], v[3:4], v[6:]])


def plan(state, tick, command):
    """The toy's MPC: LQR towards the goal of the tick at which it is asked, for 100 ticks."""
    if not np.isfinite(state.q).all():
        nothing = np.zeros((100, 12))
        return MotionPlan(nothing, nothing, nothing, valid=False)
    goal = goal_of(tick, command)
    error = POWERS @ (x_of(state.q, state.v) - goal)
    x = error + goal
    return MotionPlan(x[:, 1:13].copy(), x[:, 14:].copy(), -error @ K.T)


class LinearPlant:
    """B linear plants, whose rolls are those of x."""

    def __init__(self, batch):
        self.roll = np.zeros(batch)
        self.level = np.zeros((batch, 4))
        self.turned = np.zeros((batch, 4))

    def reset(self, q, v, rows):
        angles = Rotation.from_quat(q[rows, 3:7]).as_euler("ZYX")
        self.roll[rows] = angles[:, 2]
        self.level[rows] = Rotation.from_euler("ZY", angles[:, :2]).as_quat()
        # Rolled by half a turn more, its quaternion (x, y, z, w) is (w, z, -y, -x).
        self.turned[rows] = self.level[rows, ::-1] * [1.0, 1.0, -1.0, -1.0]
        v[np.ix_(rows, [0, 1, 2, 4, 5])] = 0.0

    def step(self, q, v, torque, impulse, rows):
        kick = KICK * impulse[rows, 1]
        v[rows, 3] += DT * (GRAVITY * self.roll[rows] + (torque[rows] * ARM).sum(axis=1)) + kick
        v[rows, 6:] += DT * (torque[rows] / INERTIA)
        self.roll[rows] += DT * v[rows, 3]
        q[rows, 7:] += DT * v[rows, 6:]
        half = self.roll[rows, None] / 2
        q[rows, 3:7] = np.cos(half) * self.level[rows] + np.sin(half) * self.turned[rows]

    def vary(self, friction, mass, rows):
        raise NotImplementedError  # a linear plant has no floor: no test may ask for one

    def feet_x(self, q, ticks):
        return q[:, [9, 12, 15, 18]]


class Toy(FakeSimulator):
    """B toy robots; the arguments are those of `FakeSimulator`."""

    def __init__(self, batch, heights=None, lost=None, robot=ROBOT):
        super().__init__(batch, heights, lost, robot, LinearPlant(batch))

    @property
    def contact_force(self):
        raise NotImplementedError  # the engine must never ask for it


class Worlds:
    """Stands for `make_simulator`: the n-th simulator made gets the n-th script, the rest none."""

    def __init__(self, *scripts):
        self.scripts = list(scripts)
        self.made = 0

    def __call__(self, robot, batch, config, ground=None):
        script = self.scripts[self.made] if self.made < len(self.scripts) else {}
        self.made += 1
        return Toy(batch, **script, robot=robot)


FLAT = SimpleNamespace(height=0.22, low=0.13, fallen=0.05)
"""[m] base heights: safe, outside the paper's table but up, and fallen."""
