"""The flight recorder: every tick of the last ten seconds, written when the robot is given up.

A `Flight` has what was measured and commanded, who drove, how long each tick took, and why the
flight ended. It consists of arrays only, so reading a file runs no code. `surefoot play FLIGHT.npz`
films it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.config.array_io import Shape, load_arrays
from surefoot.deploy.interfaces import JointCommand, Sensors
from surefoot.files import save_arrays
from surefoot.types import JOINTS, TICKS_PER_SECOND, Array, Command, IntArray

SECONDS = 10
"""[s] How much is kept."""
_JOINTS = len(JOINTS)
_WIDTHS = {
    "command": 3,
    "joint_position": _JOINTS,
    "joint_velocity": _JOINTS,
    "joint_torque": _JOINTS,
    "orientation": 4,
    "angular_velocity": 3,
    "acceleration": 3,
    "base": 4,
    "position": _JOINTS,
    "velocity": _JOINTS,
    "kp": _JOINTS,
    "kd": _JOINTS,
    "torque": _JOINTS,
    "work_us": 1,
    "round_trip_us": 1,
}
"""How many numbers of each kind are kept of a tick, in the order of a row."""


@dataclass(frozen=True)
class Flight:
    """The last ticks before a robot was given up, the oldest first.

    Attributes:
        robot: ``()`` the name of the robot.
        fault: ``()`` the name of the fault; empty if there was none.
        detail: ``()`` what was measured, and what is allowed.
        tick: ``(n,)`` the number of each tick since the runtime was started.
        time_ns: ``(n,)`` the runtime's clock when the tick began [ns].
        robot_time_ns: ``(n,)`` the robot's clock in the measurement [ns].
        mode: ``(n,)`` 0 damped, 1 standing up, 2 driven.
        expert_drove: ``(n,)`` True where the expert drove.
        command: ``(n, 3)`` commanded vx, vy [m/s], yaw rate [rad/s].
        joint_position: ``(n, 12)`` measured angles [rad].
        joint_velocity: ``(n, 12)`` measured rates [rad/s].
        joint_torque: ``(n, 12)`` measured torques [N m].
        orientation: ``(n, 4)`` unit quaternion xyzw.
        angular_velocity: ``(n, 3)`` of the base, base frame [rad/s].
        acceleration: ``(n, 3)`` specific force at the base, base frame [m/s^2].
        base: ``(n, 4)`` height [m] and linear velocity [m/s] of the base; NaN where not measured.
        position: ``(n, 12)`` joint targets commanded [rad]; NaN where nothing was commanded.
        velocity: ``(n, 12)`` rates commanded [rad/s].
        kp: ``(n, 12)`` stiffness commanded [N m/rad].
        kd: ``(n, 12)`` damping commanded [N m s/rad].
        torque: ``(n, 12)`` feed-forward torques commanded [N m].
        work_us: ``(n,)`` from the measurement to the written command [us].
        round_trip_us: ``(n,)`` from a command to the state that answers it [us].
        gait_tick: ``(n,)`` the gait clock [ms]; -1 where the robot was not driven.
        gait: ``(n,)`` the number of the gait that was walked; 0 where the robot was not driven.
    """

    shapes: ClassVar[Mapping[str, Shape]] = {"robot": (), "fault": (), "detail": ()} | {
        name: ("n", width) for name, width in _WIDTHS.items() if width > 1
    }

    robot: NDArray[np.str_]
    fault: NDArray[np.str_]
    detail: NDArray[np.str_]
    tick: IntArray
    time_ns: IntArray
    robot_time_ns: IntArray
    mode: NDArray[np.int8]
    expert_drove: NDArray[np.bool_]
    command: Array
    joint_position: Array
    joint_velocity: Array
    joint_torque: Array
    orientation: Array
    angular_velocity: Array
    acceleration: Array
    base: Array
    position: Array
    velocity: Array
    kp: Array
    kd: Array
    torque: Array
    work_us: Array
    round_trip_us: Array
    gait_tick: IntArray
    gait: IntArray


class TickRecord(NamedTuple):
    """What the recorder keeps of a tick in addition to the measurement and the joint command.

    Attributes:
        tick: The number of the tick since the runtime was started.
        time_ns: The runtime's clock when the tick began [ns].
        mode: 0 damped, 1 standing up, 2 driven.
        expert_drove: Whether the expert drove.
        command: The commanded velocity.
        gait_tick: The gait clock [ms]; -1 where the robot is not driven.
        work_us: From the measurement to the written command [us].
        round_trip_us: From a command to the state that answers it [us].
        gait: The number of the gait that is walked; 0 where the robot is not driven.
    """

    tick: int
    time_ns: int
    mode: int
    expert_drove: bool
    command: Command
    gait_tick: int
    work_us: float
    round_trip_us: float
    gait: int


# A row has all numbers of a tick side by side. Rows are allocated one by one: when a part of one
# large array is first touched, the system takes several ms, in the middle of a tick.
_INTEGERS = ("tick", "time_ns", "robot_time_ns", "mode", "expert_drove", "gait_tick", "gait")
_NO_BASE = np.full(_WIDTHS["base"], np.nan)
_NO_COMMAND = np.full(5 * _JOINTS, np.nan)


class FlightRecorder:
    """Keeps the last ten seconds.

    Args:
        robot: The name of the robot.
        rate_hz: The number of ticks in a second [Hz].
        ticks: How many ticks it keeps; those of ten seconds if it is None.

    Attributes:
        rate_hz: The number of ticks in a second [Hz].
    """

    def __init__(
        self, robot: str, rate_hz: int = TICKS_PER_SECOND, ticks: int | None = None
    ) -> None:
        self.rate_hz = rate_hz
        self._robot = robot
        size = SECONDS * rate_hz if ticks is None else ticks
        self._rows: deque[tuple[tuple[int, ...], Array]] = deque(maxlen=size)

    def add(self, record: TickRecord, sensors: Sensors, command: JointCommand | None) -> None:
        """Keep a tick, in place of the oldest one.

        Args:
            record: The time of the tick, who drove, and how long it took.
            sensors: What was measured.
            command: The command to the joints; None if there was none.
        """
        integers = (
            record.tick,
            record.time_ns,
            sensors.time_ns,
            record.mode,
            record.expert_drove,
            record.gait_tick,
            record.gait,
        )
        parts: list[ArrayLike] = [tuple(record.command), *sensors[2:8]]
        if sensors.base is None:
            parts.append(_NO_BASE)
        else:
            parts += ((sensors.base.height,), sensors.base.velocity)
        if command is None:
            parts.append(_NO_COMMAND)
        else:
            parts += (command.position, command.velocity, command.kp, command.kd, command.torque)
        parts.append((record.work_us, record.round_trip_us))
        self._rows.append((integers, np.concatenate(parts, dtype=float)))

    def flight(self, fault: str = "", detail: str = "") -> Flight:
        """What has been kept, the oldest tick first.

        Args:
            fault: The name of the fault that ended the flight; empty if there was none.
            detail: What was measured, and what is allowed.
        """
        integers = np.empty((len(self._rows), len(_INTEGERS)), dtype=np.int64)
        numbers = np.empty((len(self._rows), sum(_WIDTHS.values())))
        # Row by row, so that a thread that drives meanwhile never has to wait for all rows.
        for number, row in enumerate(self._rows):
            integers[number], numbers[number] = row
        arrays: dict[str, NDArray] = dict(zip(_INTEGERS, integers.T, strict=True))
        ends = np.cumsum(list(_WIDTHS.values()))
        columns = np.split(numbers, ends[:-1], axis=1)
        for (name, width), part in zip(_WIDTHS.items(), columns, strict=True):
            arrays[name] = part if width > 1 else part[:, 0]
        arrays["mode"] = arrays["mode"].astype(np.int8)
        arrays["expert_drove"] = arrays["expert_drove"].astype(np.bool_)
        arrays |= {
            "robot": np.array(self._robot),
            "fault": np.array(fault),
            "detail": np.array(detail),
        }
        return Flight(**{entry.name: arrays[entry.name] for entry in fields(Flight)})


def save_flight(path: Path, flight: Flight) -> None:
    """Write a flight to an npz file, whole or not at all.

    Args:
        path: The file.
        flight: The flight.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    save_arrays(path, flight)


def load_flight(path: Path) -> Flight:
    """Read a flight; no code in the file is run.

    Args:
        path: The file.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged, or is not a flight.
    """
    if not path.exists():
        raise FileNotFoundError(
            f"there is no flight {path}; `surefoot run` writes one after a fault, or with --keep"
        )
    try:
        return load_arrays(path, Flight)
    except ValueError as error:
        raise ValueError(
            f"{path} is no flight that `surefoot run` has recorded: {error.__cause__ or error}"
        ) from error
