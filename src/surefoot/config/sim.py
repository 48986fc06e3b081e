"""Contact physics of the simulators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Backend = Literal["mujoco", "bullet"]
"""Names of the physics engines."""


@dataclass(frozen=True)
class SimulationConfig:
    """Contact physics, one for each simulator; friction is common to all. Time step 1 ms.

    MuJoCo only: `impratio`, `solref`. PyBullet only: `solver_iterations`, `contact_erp`.
    """

    backend: Backend = "mujoco"
    """The physics engine: `mujoco`, or `bullet` (the paper's; needs the extra pybullet)."""
    friction: float = 0.5
    """Coefficient of the foot-ground pair, after the simulator's combination rule (BiConMP's demo);
    the planner's friction cone uses the same number."""
    impratio: float = 10.0
    """MuJoCo: ratio of frictional to normal impedance; above 1 keeps stance feet from creeping.
    The feet of a standing robot creep 4 mm/s at 1, 0.4 at 10, 0.04 at 100; but where feet slide,
    100 makes a tick a third dearer than 10."""
    solref: tuple[float, float] = (0.004, 1.0)
    """MuJoCo: contact time constant [s] and damping ratio."""
    solver_iterations: int = 50
    """PyBullet: sweeps of the contact solver in a tick (PyBullet's default, BiConMP's demo)."""
    contact_erp: float = 0.08
    """PyBullet: share of a penetration that is mended in a tick (PyBullet's default)."""
