"""Simulators: B robots of one kind, advanced together by ticks of 1 ms.

A simulator knows nothing of gaits, planners or policies: it takes joint torques and returns a
``State``. What every backend must agree on is here. Each physics engine is imported by its own
module only; `sim.mujoco` is the default and the one to read next.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from surefoot.robots.model import RobotModel
from surefoot.types import Array, BoolArray, State

TIME_STEP = 1e-3
"""[s] one tick."""


CONTACT_FORCE = 0.5
"""[N] a foot carrying more than this is in contact."""


class Simulator(Protocol):
    """B robots in lockstep, none of which ever touches another.

    A ``mask`` is ``(B,)``; without one, all robots are meant. A row of the batch moves exactly as
    the same robot alone would, bit for bit, whatever the other rows do.
    """

    @property
    def batch(self) -> int:
        """Number of robots B."""
        ...

    @property
    def robot(self) -> RobotModel:
        """The robot that is simulated, B times."""
        ...

    def reset(self, q: Array, v: Array, mask: BoolArray | None = None) -> None:
        """Begin an episode: state as given, everything else forgotten.

        Args:
            q: ``(B, 19)`` configurations [m, unit quaternion, rad]; rows outside ``mask`` ignored.
            v: ``(B, 18)`` velocities [m/s, rad/s], base part in the base frame.
            mask: the robots to reset.
        """
        ...

    def vary(self, friction: Array, mass: Array) -> None:
        """Give each robot a floor and a base of its own, from its next ``reset`` on.

        They hold, through every later reset, until others are given in the same way. The robot
        knows nothing of it: ``state.com`` is that of the nominal masses. With the friction of the
        config and a mass factor of 1 a robot moves as if never varied, bit for bit.

        Args:
            friction: ``(B,)`` coefficient of the pair of floor and robot, for the config's.
            mass: ``(B,)`` factor on mass and rotational inertia of the base link.

        Raises:
            ValueError: other than B numbers that are finite and positive.
        """
        ...

    def step(self, torque: Array, mask: BoolArray | None = None) -> None:
        """Advance by one tick under joint torques ``(B, 12)`` [Nm], which are not clipped here.

        Robots outside ``mask``, and robots that have blown up, keep their state bit for bit.
        """
        ...

    def push(self, impulse: Array, mask: BoolArray | None = None) -> None:
        """Give each base an impulse ``(B, 3)`` [Ns], world frame, during its next tick.

        The force impulse / 1 ms acts at the origin of the base frame for that one tick. A push
        that lasts n ticks is n calls, each with the n-th part of the impulse; pushes before the
        same tick add up.
        """
        ...

    @property
    def state(self) -> State:
        """State of the B robots; later steps do not change arrays handed out before."""
        ...

    @property
    def contact_force(self) -> Array:
        """``(B, 4)`` sum of the normal contact forces of each foot in the last tick [N]."""
        ...

    @property
    def blown_up(self) -> BoolArray:
        """``(B,)`` True where the numbers have run away; the robot stands still until its reset."""
        ...


def positive(name: str, values: Array, batch: int) -> Array:
    """A copy of ``values``, one for each robot.

    Raises:
        ValueError: other than ``batch`` numbers that are finite and positive.
    """
    copy = np.array(values, dtype=float)
    if copy.shape != (batch,):
        raise ValueError(f"{name} has shape {copy.shape}; give one for each robot: ({batch},)")
    if (wrong := ~(np.isfinite(copy) & (copy > 0.0))).any():
        row = int(wrong.argmax())
        raise ValueError(f"{name} of robot {row} is {copy[row]}; it must be finite and positive")
    return copy
