"""A gate for tests that follows a script."""

import numpy as np


class ScriptedGate:
    """A gate whose answers are the columns of ``(B, ticks)`` booleans, one column a tick."""

    def __init__(self, unsafe: np.ndarray):
        self.script = unsafe

    def reset(self, batch):
        self.tick = -1

    def unsafe(self, state, tick, command):
        self.tick += 1
        return self.script[:, self.tick]
