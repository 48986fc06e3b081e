"""A toy robot that can be computed by hand: a linear plant under an LQR expert.

Each of the 12 joints is a double integrator under its torque. Roll is an inverted pendulum that the
four HAA torques push; a push sideways is a kick to its rate. The rest of the base stays where the
episode began. A script may put the base of a robot to any height from tick to tick.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

from surefoot.types import MotionPlan, State

DT, INERTIA, GRAVITY, HELD, KICK = 1e-3, 0.02, 9.0, 5.0, 2.0
"""[s], [kgm^2] of a joint, [1/s^2] of roll per rad, [1/(kgm^2)] per HAA torque, [rad/s] per Ns."""
ARM = HELD * np.tile([1.0, 0.0, 0.0], 4)
NOMINAL = np.array([0.0, 0.8, -1.6, 0.0, 0.8, -1.6, 0.0, -0.8, 1.6, 0.0, -0.8, 1.6])


def matrices():
    """x' = A x + B tau, for x = [roll, 12 joints, roll rate, 12 joint rates]."""
    force, push = np.zeros((13, 13)), np.zeros((13, 12))
    force[0, 0] = GRAVITY
    push[0], push[1:] = ARM, np.eye(12) / INERTIA
    one = np.eye(13)
    A = np.block([[one + DT * DT * force, DT * one], [DT * force, one]])
    return A, np.vstack([DT * DT * push, DT * push])


A, B = matrices()
_Q = np.diag([200.0, *[2.0] * 12, 20.0, *[0.05] * 12])
_P = solve_discrete_are(A, B, _Q, np.eye(12))
K = np.linalg.solve(np.eye(12) + B.T @ _P @ B, B.T @ _P @ A)


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
    goal = goal_of(tick, command)
    error = x_of(state.q, state.v) - goal
    rows, torque = [], []
    for _ in range(100):
        rows.append(error + goal)
        torque.append(-K @ error)
        error = A @ error + B @ torque[-1]
    x = np.array(rows)
    return MotionPlan(x[:, 1:13].copy(), x[:, 14:].copy(), np.array(torque))


class Toy:
    """B toy robots: a `Simulator`.

    Args:
        batch: B.
        heights: robot -> (first tick, height [m]) pairs, rising; without them the start's.
        lost: robot -> tick at which its numbers run away.
        robot: the robot that it stands for; the engine asks for its torque limit.
    """

    def __init__(self, batch, heights=None, lost=None, robot=None):
        self.robot = robot
        self.batch, self.heights, self.lost = batch, heights or {}, lost or {}

    def reset(self, q, v, mask=None):
        assert mask is None
        self.q, self.v = q.copy(), v.copy()
        angles = Rotation.from_quat(q[:, 3:7]).as_euler("ZYX")
        self.roll = angles[:, 2].copy()
        self.level = Rotation.from_euler("ZY", angles[:, :2]).as_quat()
        self.v[:, [0, 1, 2, 4, 5]] = 0.0
        self.ticks, self.kick = np.zeros(self.batch, int), np.zeros(self.batch)
        self._stand()

    def step(self, torque, mask=None):
        assert mask is not None
        m, q, v = mask, self.q, self.v
        v[m, 3] += DT * (GRAVITY * self.roll[m] + (torque[m] * ARM).sum(axis=1)) + self.kick[m]
        v[m, 6:] += DT * (torque[m] / INERTIA)
        self.roll[m] += DT * v[m, 3]
        q[m, 7:] += DT * v[m, 6:]
        x, y, z, w = self.level[m].T
        sin, cos = np.sin(self.roll[m] / 2), np.cos(self.roll[m] / 2)
        q[m, 3:7] = np.stack(
            [w * sin + x * cos, y * cos + z * sin, z * cos - y * sin, w * cos - x * sin], axis=1
        )
        self.kick[m] = 0.0
        self.ticks[m] += 1
        self._stand()

    def _stand(self):
        for robot, steps in self.heights.items():
            if robot < self.batch:
                past = [height for tick, height in steps if tick <= self.ticks[robot]]
                self.q[robot, 2] = past[-1] if past else self.q[robot, 2]

    def push(self, impulse, mask=None):
        self.kick[mask] += KICK * impulse[mask, 1]

    def vary(self, friction, mass):
        raise NotImplementedError

    @property
    def state(self):
        contacts = (self.ticks[:, None] + np.array([0, 100, 100, 0])) % 200 < 100
        feet = np.zeros((self.batch, 4, 3))
        feet[..., 2] = np.where(contacts, 0.018, 0.05)
        feet[..., 0] = self.q[:, [9, 12, 15, 18]]
        com = self.q[:, :3] + [0.0, 0.0, -0.01]
        return State(self.q.copy(), self.v.copy(), com, feet, contacts)

    @property
    def blown_up(self):
        return np.array([self.ticks[b] >= self.lost.get(b, 10**9) for b in range(self.batch)])

    @property
    def contact_force(self):
        raise NotImplementedError


class Worlds:
    """Stands for `make_simulator`: the n-th simulator made gets the n-th script, the rest none."""

    def __init__(self, *scripts):
        self.scripts, self.made = list(scripts), 0

    def __call__(self, robot, batch, config):
        script = self.scripts[self.made] if self.made < len(self.scripts) else {}
        self.made += 1
        return Toy(batch, **script, robot=robot)


FLAT = SimpleNamespace(height=0.22, low=0.13, fallen=0.05)
"""[m] base heights: safe, outside the paper's table but up, and fallen."""
