"""Simulators: B robots of one kind, advanced together by ticks of 1 ms.

A simulator knows nothing of gaits, planners or policies: it takes joint torques and returns a
``State``. What every backend must agree on is here, and `surefoot.testing.simulator` tests it. Each
physics engine is imported by its own module only. Read `sim.mujoco`, the default, next.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from surefoot.robots.model import RobotModel
from surefoot.types import Array, BoolArray, State

TIME_STEP = 1e-3
"""[s] The length of a tick."""
CONTACT_FORCE = 0.5
"""[N] A foot that carries more than this is in contact; so are all other parts together."""


class Simulator(Protocol):
    """B robots in lockstep, none of which ever touches another.

    A ``mask`` is ``(B,)``; without one, all robots are meant. A row of the batch moves exactly as
    the same robot alone would, bit for bit, whatever the other rows do. `SimulatorContract` in
    `surefoot.testing` tests all of this.
    """

    @property
    def batch(self) -> int:
        """The number of robots B."""
        ...

    @property
    def robot(self) -> RobotModel:
        """The robot that is simulated B times."""
        ...

    def reset(self, q: Array, v: Array, mask: BoolArray | None = None) -> None:
        """Begin an episode with a given state; everything else is forgotten.

        Args:
            q: ``(B, 19)`` configurations [m, unit quaternion, rad]; rows outside ``mask`` are
                ignored.
            v: ``(B, 18)`` velocities [m/s, rad/s], base part in the base frame.
            mask: ``(B,)`` True for the robots to reset.
        """
        ...

    def vary(self, friction: Array | None, mass: Array | None) -> None:
        """Vary the floor's friction and the base's mass for each robot, from its next ``reset`` on.

        The values last through every later reset, until the next call. The robot does not know
        them: ``state.com`` is that of the nominal masses. With None, or with the friction of the
        config and a mass factor of 1, a robot moves as if it had never been varied, bit for bit.

        Args:
            friction: ``(B,)`` coefficient of the pair of floor and robot; None for the config's.
            mass: ``(B,)`` factor on mass and rotational inertia of the base link; None for 1.

        Raises:
            ValueError: The arrays are not B numbers that are finite and positive.
        """
        ...

    def step(self, torque: Array, mask: BoolArray | None = None) -> None:
        """Advance by one tick under joint torques ``(B, 12)`` [N m], which are not clipped here.

        Robots outside ``mask``, and robots that have blown up, keep their state bit for bit.
        """
        ...

    def push(self, impulse: Array, mask: BoolArray | None = None) -> None:
        """Give each base an impulse during its next tick.

        The force impulse / 1 ms acts at the origin of the base frame for that one tick. A push
        that lasts n ticks is n calls, each with the n-th part of the impulse; pushes before the
        same tick add up. A robot that is not stepped keeps its push for its next tick; a reset
        forgets it.

        Args:
            impulse: ``(B, 3)`` impulse on each robot, world frame [N s], or ``(3,)`` for all.
            mask: ``(B,)`` True for the robots to push.
        """
        ...

    @property
    def state(self) -> State:
        """The state of the B robots; later steps do not change arrays handed out before."""
        ...

    @property
    def contact_force(self) -> Array:
        """``(B, 4)`` sum of the normal contact forces on each foot in the last tick [N]."""
        ...

    @property
    def body_contact(self) -> BoolArray:
        """``(B,)`` True where all parts except the feet together carried over 0.5 N in that tick.

        That means a base or a leg on the ground. As for the feet, a reset shows the contacts of the
        new state.
        """
        ...

    @property
    def blown_up(self) -> BoolArray:
        """``(B,)`` True where the numbers have run away; the robot stands still until its reset."""
        ...


def check_positive(name: str, values: Array, batch: int) -> Array:
    """Check that there is one positive number for each robot, and return a copy of them.

    Args:
        name: The name of the values, for the error.
        values: ``(batch,)`` numbers to check.
        batch: The number of robots.

    Raises:
        ValueError: The values are not ``batch`` numbers that are finite and positive.
    """
    copy = np.array(values, dtype=float)
    if copy.shape != (batch,):
        raise ValueError(f"{name} has shape {copy.shape}; give one for each robot: ({batch},)")
    wrong = ~(np.isfinite(copy) & (copy > 0.0))
    if wrong.any():
        row = int(wrong.argmax())
        raise ValueError(f"{name} of robot {row} is {copy[row]}; it must be finite and positive")
    return copy


def checked_variation(
    friction: Array | None, mass: Array | None, batch: int, nominal_friction: float
) -> tuple[Array, Array]:
    """Return copies ``(batch,)`` of what `Simulator.vary` is given, with the nominal for None.

    Args:
        friction: ``(batch,)`` coefficients of friction, or None.
        mass: ``(batch,)`` factors on the mass of the base, or None.
        batch: The number of robots.
        nominal_friction: The coefficient of friction that None stands for.

    Raises:
        ValueError: The arrays are not ``batch`` numbers that are finite and positive.
    """
    if friction is None:
        friction = np.full(batch, nominal_friction)
    if mass is None:
        mass = np.ones(batch)
    return check_positive("friction", friction, batch), check_positive("mass", mass, batch)
