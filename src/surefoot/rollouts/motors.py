"""What motors make of commanded torques: late, noisy, and zero beyond a joint's speed limit.

`scenarios.sensors` is the counterpart for what robots measure. Read `engine` next.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from surefoot.robots.model import RobotModel, stop_speeding
from surefoot.rollouts.compiled import clip_torque
from surefoot.scenarios.disturbance import Disturbance
from surefoot.scenarios.torque_noise import HeldNoise
from surefoot.types import Array


class Motors:
    """The motors of B robots in one rollout.

    Args:
        robot: The robot, for the limits of its motors.
        disturbance: The delay and the noise of torques.
        late: ``(B, delay, 12)`` the torques that are still delayed at the beginning, as in
            `Episodes`; None if there are none.
    """

    def __init__(self, robot: RobotModel, disturbance: Disturbance, late: Array | None) -> None:
        self._robot = robot
        self._delay = disturbance.delay
        self._late = late
        # The torque that acts is the one commanded `delay` ticks ago.
        self._line = deque[Array](maxlen=disturbance.delay + 1)
        noise = disturbance.torque_noise
        self._noise = HeldNoise(noise) if noise else None

    def acting(self, torque: Array, elapsed: int, rate: Array) -> Array:
        """Return the torques ``(B, 12)`` that act in a tick [N m].

        Args:
            torque: ``(B, 12)`` the torques that are commanded in this tick, clipped [N m].
            elapsed: The number of the tick in the rollout; ticks come in order, from 0 on.
            rate: ``(B, 12)`` rates of the joints [rad/s].
        """
        if elapsed == 0:
            self._line.extend(self._before_the_first(torque))
        self._line.append(torque)
        acting = self._line[0]
        if self._noise is not None:
            acting = clip_torque(acting + self._noise.at(elapsed), self._robot.torque_limit)
        if self._robot.enforce_speed_limit:
            acting = stop_speeding(acting, rate, self._robot.speed_limit)
        return acting

    def _before_the_first(self, first: Array) -> list[Array]:
        """The torques ``(B, 12)`` that act before the first one commanded, in order."""
        if self._late is None:
            return [first] * self._delay
        torques = np.swapaxes(self._late, 0, 1)
        return [np.where(np.isnan(torque), first, torque) for torque in torques]
