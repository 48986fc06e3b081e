"""A flight of a robot as a film: what the flight recorder kept of its last ten seconds.

Where nothing measured the base, the robot is shown in place, with its lowest foot on the ground.
Read `deploy.recorder` for what was kept.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surefoot.config import SimulationConfig
from surefoot.config.robot_table import ROBOTS
from surefoot.deploy.recorder import Flight
from surefoot.robots.geometry import state_of
from surefoot.robots.load import load_robot
from surefoot.rotations import rotation
from surefoot.types import TICK_NS, TICKS_PER_SECOND, Array, IntArray
from surefoot.viz.film import WAITING, Recording


def recording_of(flight: Flight, own: Path | str | None = None) -> Recording:
    """A flight as a recording to film.

    Args:
        flight: The flight.
        own: The file of its robot, if that is not one of the package.

    Raises:
        ValueError: The flight holds no tick with finite numbers, or it is of another robot than the
            one given, or of one that the package does not have.
    """
    name = str(flight.robot)
    if own is None and name not in ROBOTS:
        raise ValueError(
            f"the flight is of the robot {name!r}, which is none of the package; name its file "
            "with --robot FILE"
        )
    robot = load_robot(name if own is None else str(own))
    if robot.name != name:
        raise ValueError(f"the flight is of the robot {name!r}, and {own} of {robot.name!r}")
    measured = np.column_stack([flight.joint_position, flight.orientation])
    rows = np.isfinite(measured).all(axis=1)
    if not rows.any():
        raise ValueError(
            "the flight holds no tick with finite numbers, so there is nothing to film"
        )
    q = np.zeros((int(rows.sum()), 19))
    q[:, 3:7] = flight.orientation[rows]
    q[:, 7:] = flight.joint_position[rows]
    feet = state_of(robot, q, np.zeros((len(q), 18))).feet
    standing = robot.foot_radius - feet[:, :, 2].min(axis=1)
    base = flight.base[rows]
    q[:, 2] = np.where(np.isfinite(base[:, 0]), base[:, 0], standing)
    time_ns = _steady(flight.robot_time_ns[rows])
    q[:, :2] = _path(base[:, 1:], q[:, 3:7], time_ns)
    shown = _shown(time_ns)
    mode = flight.mode[rows][shown]
    return Recording(
        robot,
        SimulationConfig(),
        q[shown],
        flight.expert_drove[rows][shown],
        waiting=np.where(mode < len(WAITING), mode, -1),
    )


def _steady(time_ns: IntArray) -> IntArray:
    """The times of a clock without jumps like those after a restart of the robot.

    A step back, or one of more than a second, becomes a step of one millisecond.

    Args:
        time_ns: ``(n,)`` the robot's clock [ns].
    """
    steps = np.diff(time_ns, prepend=time_ns[:1])
    is_jump = (steps < 0) | (steps > TICKS_PER_SECOND * TICK_NS)
    return time_ns[0] + np.cumsum(np.where(is_jump, TICK_NS, steps))


def _shown(time_ns: IntArray) -> IntArray:
    """The row of a flight that a film shows at each millisecond of the robot's clock: the latest.

    Args:
        time_ns: ``(n,)`` the times of the rows, which never decrease [ns].
    """
    times = np.arange(time_ns[0], time_ns[-1] + TICK_NS, TICK_NS)
    return np.searchsorted(time_ns, times, side="right") - 1


def _path(velocity: Array, orientation: Array, time_ns: IntArray) -> Array:
    """The horizontal positions ``(n, 2)`` [m] from integrating measured velocities.

    Args:
        velocity: ``(n, 3)`` of the base, base frame [m/s]; NaN where not measured.
        orientation: ``(n, 4)`` unit quaternions xyzw.
        time_ns: ``(n,)`` the times, which never decrease [ns].
    """
    world = (rotation(orientation) @ np.nan_to_num(velocity)[:, :, None])[:, :2, 0]
    seconds = np.diff(time_ns, prepend=time_ns[0]) * 1e-9
    return np.cumsum(world * seconds[:, None], axis=0)
