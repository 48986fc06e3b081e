"""Simulators: `make_simulator` makes the one that a configuration names.

`protocol` says what all of them agree on; each physics engine is imported by its own module, when
it is first needed. Read `sim.protocol` next.
"""

from __future__ import annotations

from surefoot.config import SimulationConfig
from surefoot.robots.model import RobotModel
from surefoot.sim.protocol import Simulator
from surefoot.sim.terrain import Ground

__all__ = ["Simulator", "make_simulator"]


def make_simulator(
    robot: RobotModel,
    batch: int,
    config: SimulationConfig | None = None,
    ground: Ground | None = None,
) -> Simulator:
    """Make a simulator of ``batch`` robots, which stand in the nominal pose.

    Args:
        robot: The robot.
        batch: The number of robots B.
        config: The physics engine and its settings; the defaults if it is None. Its terrain is only
            what episodes draw their ground from (`scenarios.ground`); it lays no ground here.
        ground: The ground of each robot; None is the plane z = 0.

    Raises:
        ValueError: ``batch`` is not positive, or the ground is for another number of robots.
        ImportError: The physics engine is missing.
    """
    config = config or SimulationConfig()
    if batch < 1:
        raise ValueError(f"batch is {batch}; a simulator holds at least one robot")
    if ground is not None and len(ground) != batch:
        raise ValueError(f"the ground of {len(ground)} robots for a simulator of {batch}")
    if config.backend == "bullet":
        try:
            from surefoot.sim.bullet import BulletSimulator
        except ImportError as error:
            raise ImportError(
                f"the simulator 'bullet' needs PyBullet ({error}), which has wheels up to Python "
                "3.11 only: there, pip install 'surefoot[pybullet]'; elsewhere, take MuJoCo"
            ) from error
        return BulletSimulator(robot, batch, config, ground)
    from surefoot.sim.mujoco import MujocoSimulator

    return MujocoSimulator(robot, batch, config, ground=ground)
