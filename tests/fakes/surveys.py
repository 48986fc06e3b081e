"""Cells of a survey of robots and gaits, made by hand."""

from dataclasses import replace

from surefoot.bench.plan import StageTimes, Times
from surefoot.config import Backend, CommandBox
from surefoot.study.robot_cells import GaitCell, Tracking, Use, Walked
from tests.fakes.results import robustness

TIMES = Times(3.26, 4.04, StageTimes(1.0, 0.5, 1.5, 0.25))
BOX = CommandBox((-0.3, 0.6), (-0.2, 0.2), (-0.5, 0.5))
WALKED = Walked(
    box=BOX,
    command_gain=(1.1, 1.0, 1.2),
    from_rest=(0.01, 0.02, 0.03),
    plan_ms=TIMES,
    robustness=robustness(19, 20),
    tracking=Tracking((0.001, 0.002, 0.003), (0.01, 0.02, 0.04)),
    torque=Use(0.5, 0.75, 0.0),
    speed=Use(0.8, 1.1, 0.0),
)


def gait_cell(
    robot: str = "go2", gait: str = "trot", simulator: Backend = "mujoco", **changes
) -> GaitCell:
    """A cell of 20 episodes, 19 of which succeeded."""
    cell = GaitCell(
        robot, gait, simulator, "key", 20, 5.0, BOX, {"processor": "one core"}, WALKED, ""
    )
    return replace(cell, **changes)
