"""What is wrong with a robot: all tests of a measurement that make the runtime give it up.

`FaultTests.broken` and `FaultTests.unsafe` look at one measurement per tick and name the first
fault. The loop itself detects faults that no measurement shows (silence, deadlines, the operator).
Read `loop` next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.interfaces import Sensors
from surefoot.types import JOINTS, TICK_NS, Array, IntArray, to_ticks

FaultKind = Literal[
    "stale state",
    "latched bridge",
    "not a number",
    "driver",
    "missed deadlines",
    "tilt",
    "fall",
    "lost base",
    "joint limit",
    "joint speed",
    "saturated torque",
    "absurd command",
    "clock",
    "operator lost",
    "posture",
    "gate",
    "expert",
    "late plan",
    "defect",
]
"""Names of the faults."""


@dataclass(frozen=True)
class Fault:
    """Why the runtime gave the robot up.

    Attributes:
        kind: The name of the fault.
        detail: What was measured, and what is allowed.
        tick: The number of the tick since the runtime was started.
    """

    kind: FaultKind
    detail: str
    tick: int


@dataclass(frozen=True)
class Limits:
    """What the joints may do.

    Attributes:
        low: ``(12,)`` smallest angles [rad].
        high: ``(12,)`` largest angles [rad].
        speed: ``(12,)`` largest rates [rad/s].
        torque: ``(12,)`` largest torques [N m].
    """

    low: Array
    high: Array
    speed: Array
    torque: Array


def roll_pitch(orientation: Array) -> tuple[float, float]:
    """Roll and pitch [rad] of a base, in plain floats, since one robot needs no arrays.

    Args:
        orientation: ``(4,)`` unit quaternion xyzw.
    """
    x, y, z, w = orientation.tolist()
    roll = math.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    sine = 2.0 * (w * y - x * z)
    return roll, math.asin(min(max(sine, -1.0), 1.0))


class FaultTests:
    """Tests every measurement; torques are tested over time.

    Args:
        limits: What the joints may do.
        config: The limits of the tests.
    """

    def __init__(self, limits: Limits, config: RuntimeConfig) -> None:
        self._limits = limits
        # Angles and rates are compared at once, the angles first.
        self._lowest = np.concatenate((limits.low, -limits.speed))
        self._highest = np.concatenate((limits.high, limits.speed))
        self._tilt = math.radians(config.tilt)
        self._saturated_from = config.saturation_share * limits.torque
        self._absurd_from = config.absurd_torque * limits.torque
        self._patience_ns = to_ticks(config.saturation) * TICK_NS
        self._saturated_since: IntArray | None = None  # [ns] when each last was not

    def broken(self, sensors: Sensors) -> tuple[FaultKind, str] | None:
        """What makes a measurement useless in any mode; None if nothing does.

        Args:
            sensors: The measurement.
        """
        if not is_finite(sensors):
            parts = zip(Sensors._fields[2:8], sensors[2:8], strict=True)
            wrong = [name for name, values in parts if not np.isfinite(values).all()]
            return "not a number", f"{', '.join(wrong) or 'base'} of the sensors"
        norm = float(sensors.orientation @ sensors.orientation)
        if not 0.9 < norm < 1.1:
            return "not a number", f"the orientation has the length {math.sqrt(norm):.3g}, not 1"
        if sensors.faults:
            return "driver", f"the driver reports the bits {sensors.faults:#x}"
        return None

    def unsafe(self, sensors: Sensors) -> tuple[FaultKind, str] | None:
        """What makes it unsafe to move the robot; None if nothing does. Call it once per tick.

        Args:
            sensors: The measurement.
        """
        roll, pitch = roll_pitch(sensors.orientation)
        if max(abs(roll), abs(pitch)) > self._tilt:
            roll_deg = math.degrees(roll)
            pitch_deg = math.degrees(pitch)
            return "tilt", (
                f"roll {roll_deg:.1f}, pitch {pitch_deg:.1f} of {math.degrees(self._tilt):.1f} deg"
            )
        motion = np.concatenate((sensors.joint_position, sensors.joint_velocity))
        beyond = (motion < self._lowest) | (motion > self._highest)
        first = int(beyond.argmax())
        if beyond[first]:
            return self._beyond(sensors, first)
        saturated = np.abs(sensors.joint_torque) >= self._saturated_from
        since = self._saturated_since
        if since is None:
            since = np.full(len(JOINTS), sensors.time_ns)
        self._saturated_since = np.where(saturated, since, sensors.time_ns)
        longest = int(self._saturated_since.argmin())
        if sensors.time_ns - self._saturated_since[longest] >= self._patience_ns:
            return "saturated torque", (
                f"{JOINTS[longest]} at its {self._limits.torque[longest]:.2f} N m for "
                f"{self._patience_ns // TICK_NS} ms"
            )
        return None

    def absurd(self, torque: Array) -> tuple[FaultKind, str] | None:
        """What makes a command one that must not reach the motors; None if nothing does.

        Args:
            torque: ``(12,)`` the torques that it asks for, before the motors clip them [N m].
        """
        beyond = np.abs(torque) > self._absurd_from
        joint = int(beyond.argmax())
        if not beyond[joint]:
            return None
        return "absurd command", (
            f"{JOINTS[joint]} is told to give {torque[joint]:.3g} N m, and has "
            f"{self._limits.torque[joint]:.2f} N m; check what the sensors report"
        )

    def _beyond(self, sensors: Sensors, number: int) -> tuple[FaultKind, str]:
        """The fault of one of the joint angles, or of one of the rates, which follow them."""
        limits = self._limits
        joint = number % len(JOINTS)
        if number < len(JOINTS):
            return "joint limit", (
                f"{JOINTS[joint]} at {sensors.joint_position[joint]:.3f} of "
                f"{limits.low[joint]:.3f} to {limits.high[joint]:.3f} rad"
            )
        rate = abs(sensors.joint_velocity[joint])
        return "joint speed", f"{JOINTS[joint]} at {rate:.1f} of {limits.speed[joint]:.1f} rad/s"


def is_finite(sensors: Sensors) -> bool:
    """Whether all numbers of a measurement are finite.

    Args:
        sensors: The measurement.
    """
    # One sum instead of many tests: a sum with a term that is not finite is not finite. Finite
    # numbers whose sum overflows are no measurement either. Floats add faster than small arrays.
    total = sum([number for values in sensors[2:8] for number in values.tolist()])
    if sensors.base is not None:
        total += sensors.base.height + sum(sensors.base.velocity.tolist())
    return math.isfinite(total)
