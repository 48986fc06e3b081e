"""How a push acts on simulated robots, in an episode and on a twin. Read `disturbance` for more."""

from __future__ import annotations

from surefoot.rotations import from_heading
from surefoot.scenarios.disturbance import Pushes
from surefoot.sim.protocol import Simulator
from surefoot.types import BoolArray


def push(simulator: Simulator, pushes: Pushes, elapsed: int, active: BoolArray) -> None:
    """Push the robots on which a push acts in this tick, each in its own heading frame.

    Args:
        simulator: The simulator of the B robots; the impulses act in its next step.
        pushes: The pushes on the B robots.
        elapsed: The tick of the episode [ms].
        active: ``(B,)`` True for robots whose episode has not ended.
    """
    if (impulse := pushes.during(elapsed)) is not None:
        impulse[:, :2] = from_heading(impulse[:, :2], simulator.state.heading)
        simulator.push(impulse, impulse.any(axis=1) & active)
