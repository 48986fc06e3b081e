"""The contact physics of the simulators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from surefoot.config.checked import Checked, Share, Within

Backend = Literal["mujoco", "bullet"]
"""Names of the physics engines."""


@dataclass(frozen=True)
class SimulationConfig(Checked):
    """Contact physics of both simulators, which share the friction. The time step is 1 ms.

    Only MuJoCo uses `impratio` and `solref`; only PyBullet uses `solver_iterations` and
    `contact_erp`.
    """

    section: ClassVar[str] = "simulation"

    backend: Backend = "mujoco"
    """The physics engine: `mujoco`, or `bullet` (the paper's; needs the extra pybullet)."""
    friction: Annotated[float, Within(0.001, 10.0)] = 0.5
    """Coefficient of the foot-ground pair, after the simulator's combination rule (BiConMP's demo);
    the planner's friction cone uses the same number."""
    impratio: Annotated[float, Within(0.1, 10_000.0)] = 10.0
    """MuJoCo: the ratio of frictional to normal impedance; above 1 it keeps stance feet from
    creeping. The feet of a standing robot creep 4 mm/s at 1, 0.4 at 10 and 0.04 at 100; but where
    feet slide, a tick at 100 costs a third more than at 10."""
    solref: tuple[Annotated[float, Within(0.002, 1.0)], Annotated[float, Within(0.01, 100.0)]] = (
        0.004,
        1.0,
    )
    """MuJoCo: the time constant [s] and the damping ratio of a contact."""
    solver_iterations: Annotated[int, Within(1, 10_000)] = 50
    """PyBullet: sweeps of the contact solver in a tick (PyBullet's default, BiConMP's demo)."""
    contact_erp: Share = 0.08
    """PyBullet: the share of a penetration that is corrected in a tick (PyBullet's default)."""
