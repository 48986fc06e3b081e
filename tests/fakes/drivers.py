"""What tests of the engine run: standing robots, a controller and an arbiter of a few lines."""

import numpy as np

from surefoot.rollouts.episodes import Episodes
from surefoot.scenarios.starts import Starts
from tests.fakes.robots import STANDING


def starts_of(ticks, commands=None):
    n = len(ticks)
    command = np.zeros((n, 3)) if commands is None else np.array(commands, float)
    q = np.tile(STANDING, (n, 1))
    return Starts(q, np.zeros((n, 18)), np.array(ticks), command, np.arange(n) + 70)


def standing_for(duration, tail=0.0, batch=1):
    """Episodes of standing robots, at the beginning of the gait cycle."""
    return Episodes(starts_of([0] * batch), duration, tail)


class FakeController:
    """The torque is ``base`` plus a little of the state and the tick; calls are remembered.

    Args:
        base: The torque [N m].
        gives_up: For each robot, the tick from which on the controller gives up on it, if asked.
    """

    def __init__(self, base=0.0, gives_up=None):
        self.base = base
        self.gives_up = gives_up or {}

    def reset(self, batch):
        self.calls = []
        self._diverged = np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        self.calls.append((tick.copy(), command.copy(), mask.copy()))
        for robot, at in self.gives_up.items():
            self._diverged[robot] |= bool(mask[robot] and tick[robot] >= at)
        torque = self.base + 0.01 * state.q[:, 7:] + 1e-3 * (tick % 7)[:, None] + command[:, :1]
        return np.where(mask[:, None], torque, np.nan)  # rows outside the mask are arbitrary

    @property
    def diverged(self):
        return self._diverged


class Script:
    """An arbiter that reads who drives from a string for each robot: X expert, dot policy."""

    def __init__(self, *rows):
        self.rows = np.array([[mark == "X" for mark in row] for row in rows])

    def reset(self, episode):
        self.episode = episode
        self.ticks = []

    def choose(self, state, tick, command):
        self.ticks.append(tick.copy())
        return self.rows[:, len(self.ticks) - 1]
