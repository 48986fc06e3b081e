"""The gate of the paper's Table I at run time: bounds on height, tilt and joints of one robot.

`safety.gates` has the same table for a batch of simulated robots; a test checks that both agree.
From a violation on, the expert drives for at least T_block and until the state is safe (the rule
`safe_and_blocked`). Read `handover` next.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surefoot.deploy.faults import roll_pitch
from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.rotations import rotation
from surefoot.types import JOINTS, Array, Command

logger = logging.getLogger(__name__)


class Switch(Protocol):
    """Decides in every tick who drives: the policy, or the expert."""

    def reset(self) -> None:
        """Begin an episode, in which the policy drives at first."""
        ...

    def expert_drives(self, sensors: Sensors, tick: int, command: Command) -> bool:
        """Whether the expert has to drive in this tick; called once per tick.

        Before an episode, while the robot stands, it is also called repeatedly with tick 0, and
        reset afterwards. Those answers are ignored; the calls only keep later ones fast.

        Args:
            sensors: What the robot measures.
            tick: The gait clock [ms].
            command: The commanded velocity.

        Raises:
            Fallen: Neither the policy nor the expert can drive this robot any more.
            MissingBase: The switch cannot decide, since nothing measures the base.
        """
        ...

    def reason(self, sensors: Sensors) -> str:
        """Why the expert has to drive, in words.

        Args:
            sensors: What the robot measures.
        """
        ...


@dataclass(frozen=True)
class BoundsGate:
    """Calls a state unsafe if it is outside a table of bounds.

    Attributes:
        low: ``(15,)`` lower bounds of the height of the center of mass [m], and of roll, pitch and
            the joints [rad].
        high: ``(15,)`` upper bounds.
        com_in_base: Gives the center of mass ``(n, 3)``, base frame [m], for joint angles
            ``(n, 12)`` [rad].
    """

    low: Array
    high: Array
    com_in_base: Callable[[Array], Array]

    def unsafe(self, sensors: Sensors) -> bool:
        """Whether a state is unsafe; the height only counts if it is measured.

        Args:
            sensors: What the robot measures.
        """
        angles = np.concatenate((roll_pitch(sensors.orientation), sensors.joint_position))
        inside = bool(((angles >= self.low[1:]) & (angles <= self.high[1:])).all())
        if sensors.base is not None:
            height = self._height(sensors, sensors.base)
            inside = inside and bool(self.low[0] <= height <= self.high[0])
        return not inside

    def violated(self, sensors: Sensors) -> str:
        """Which bounds a state violates, in words; empty if none.

        Args:
            sensors: What the robot measures.
        """
        values = [*roll_pitch(sensors.orientation), *sensors.joint_position.tolist()]
        names = [f"{name} [rad]" for name in ("roll", "pitch", *JOINTS)]
        bounds = [*zip(names, values, self.low[1:], self.high[1:], strict=True)]
        if sensors.base is not None:
            height = self._height(sensors, sensors.base)
            bounds.insert(0, ("center of mass [m]", height, self.low[0], self.high[0]))
        return ", ".join(
            f"{name} at {value:.3f} of {low:.3f} to {high:.3f}"
            for name, value, low, high in bounds
            if not low <= value <= high
        )

    def _height(self, sensors: Sensors, base: BaseEstimate) -> float:
        """The height of the center of mass above the ground [m]."""
        up = rotation(sensors.orientation)[2]
        com = self.com_in_base(sensors.joint_position[None])[0]
        return base.height + float(up @ com)


class Blocking:
    """Lets the expert drive from a violation on, until its block is over and the state is safe.

    Args:
        block: T_block [ms].
    """

    def __init__(self, block: int) -> None:
        self._block = block
        self._since: int | None = None  # the tick of the takeover; None: the policy drives

    def is_blocked(self, unsafe: bool, tick: int) -> bool:
        """Whether the expert has to drive in this tick; to be called once per tick.

        Args:
            unsafe: Whether the gate calls the state unsafe.
            tick: The gait clock [ms]; it includes unseen ticks.
        """
        if self._since is None:
            self._since = tick if unsafe else None
        elif not unsafe and tick - self._since >= self._block:
            self._since = None
        return self._since is not None


class GateSwitch:
    """Lets the expert drive where a gate calls the state unsafe, for at least a block of time.

    Without an expert the robot is given up there, and the block has no effect.

    Args:
        gate: Decides which states are unsafe.
        block: T_block [ms].
    """

    def __init__(self, gate: BoundsGate, block: int) -> None:
        self._gate = gate
        self._block = block
        self._has_warned = False
        self.reset()

    def reset(self) -> None:
        """See `Switch`."""
        self._blocking = Blocking(self._block)

    def expert_drives(self, sensors: Sensors, tick: int, command: Command) -> bool:
        """See `Switch`."""
        if sensors.base is None and not self._has_warned:
            self._has_warned = True  # only once: a line takes time, and a base may come and go
            logger.warning(
                "the height of the base is not measured: while it is not, the gate judges roll, "
                "pitch and joints only"
            )
        return self._blocking.is_blocked(self._gate.unsafe(sensors), tick)

    def reason(self, sensors: Sensors) -> str:
        """See `Switch`."""
        return f"the gate calls the state unsafe: {self._gate.violated(sensors)}"
