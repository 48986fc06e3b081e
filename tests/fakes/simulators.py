"""A simulator of a few lines, whose every number a test can compute by hand."""

import numpy as np

from surefoot.types import State
from tests.fakes.robots import ROBOT


class FakeSimulator:
    """Joints move with the torque, the base creeps forward at a fixed height, the feet trot.

    Args:
        batch: B.
        height: height of the base [m]; 0.25 m stands, 0.05 m has fallen.
        z: robot -> (tick, height [m] of the base from that tick on).
        blown_up_at: robot -> tick at which its numbers run away.

    Attributes:
        calls: names of ``vary`` and ``reset`` in the order in which they were called.
        varied: (friction, mass) of each ``vary``.
        applied: ``(B, 12)`` torque of each step.
        masks: ``(B,)`` mask of each step.
        pushes: (tick, impulse, mask) of each push.
    """

    def __init__(self, batch, height=None, z=None, blown_up_at=None):
        self.batch = batch
        self.robot = ROBOT
        self.height = height
        self.z = z or {}
        self.blown_up_at = blown_up_at or {}
        self.calls = []
        self.varied = []
        self.applied = []
        self.masks = []
        self.pushes = []

    def reset(self, q, v, mask=None):
        assert mask is None
        self.calls.append("reset")
        self.q = q.copy()
        self.v = v.copy()
        if self.height is not None:
            self.q[:, 2] = self.height
        self.ticks = np.zeros(self.batch, int)

    def vary(self, friction, mass):
        self.calls.append("vary")
        self.varied.append((friction.tolist(), mass.tolist()))

    def step(self, torque, mask=None):
        assert mask is not None
        self.applied.append(torque.copy())
        self.masks.append(mask.copy())
        self.q[mask, 7:] += 1e-3 * torque[mask]
        self.q[mask, 0] += 1e-3
        self.v[mask, 0] = self.ticks[mask]
        self.ticks[mask] += 1

    def push(self, impulse, mask=None):
        assert mask is not None
        self.pushes.append((self.ticks.max(), impulse.copy(), mask.copy()))

    @property
    def state(self):
        q = self.q.copy()
        for robot, (tick, height) in self.z.items():
            if self.ticks[robot] >= tick:
                q[robot, 2] = height
        phase = (self.ticks[:, None] + np.array([0, 100, 100, 0])) % 200
        contacts = phase < 100
        feet = np.zeros((self.batch, 4, 3))
        feet[..., 0] = self.ticks[:, None]
        feet[..., 2] = np.where(contacts, self.robot.foot_radius, 0.05)
        com = q[:, :3] + [0.0, 0.0, -0.01]
        return State(q, self.v.copy(), com, feet, contacts)

    @property
    def blown_up(self):
        return np.array(
            [self.ticks[b] >= self.blown_up_at.get(b, 10**9) for b in range(self.batch)]
        )

    @property
    def contact_force(self):
        raise NotImplementedError  # the engine never asks for forces
