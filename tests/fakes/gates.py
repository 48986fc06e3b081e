"""Gates for tests: one that follows a script, and answers that are no flags."""

import numpy as np

NOT_FLAGS = {
    "int": lambda flags: flags.astype(int),
    "float": lambda flags: flags.astype(float),
    "list": lambda flags: flags.tolist(),
    "scalar": lambda flags: bool(flags[0]),
    "(1,)": lambda flags: flags[:1],
    "(B, 1)": lambda flags: flags[:, None],
}
"""What a gate or an arbiter may make of flags by mistake."""


class ScriptedGate:
    """A gate whose answers are the columns of ``(B, ticks)`` booleans, one column a tick."""

    def __init__(self, unsafe: np.ndarray):
        self.script = unsafe

    def reset(self, batch):
        self.tick = -1

    def unsafe(self, state, tick, command):
        self.tick += 1
        return self.script[:, self.tick]


class Careless(ScriptedGate):
    """A gate whose answers are no flags.

    Args:
        unsafe: The script.
        mistake: One of `NOT_FLAGS`.
    """

    def __init__(self, unsafe: np.ndarray, mistake: str):
        super().__init__(unsafe)
        self.mistake = NOT_FLAGS[mistake]

    def unsafe(self, state, tick, command):
        return self.mistake(super().unsafe(state, tick, command))


class CarelessArbiter:
    """An arbiter that lets the expert drive the second robot, but whose answers are no flags.

    Args:
        mistake: One of `NOT_FLAGS`.
    """

    def __init__(self, mistake: str):
        self.mistake = NOT_FLAGS[mistake]

    def reset(self, episode):
        self.batch = len(episode)

    def choose(self, state, tick, command):
        return self.mistake(np.arange(self.batch) == 1)
