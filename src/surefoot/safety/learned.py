"""Learned gates: networks that call a state unsafe, for a `SafetyMonitor` (``safety.py``).

`Deviation` is SafeDAGGER's: it predicts from the state that the policy deviates from the expert.
`History` is the paper's future work: it predicts from the last 100 ms that the bounds will be left
within 0.3 s, so that the expert takes over earlier. It learns from `Trace`s, what robots saw while
a policy drove.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config
from surefoot.learning.classifier import Classifier
from surefoot.learning.observation import INPUT_SIZE, Phase, network_input
from surefoot.types import Array, BoolArray, IntArray, State, to_ticks

EVERY, SAMPLES = 10, 10
"""[ms] between samples of the history, and how many: the last 100 ms."""


class _Learned:
    """What both gates share.

    Args:
        classifier: of the rows that the gate makes of what it sees.
        config: gait period, and how the phase is given.
        alarm: probability beyond which a state is unsafe.
    """

    def __init__(self, classifier: Classifier, config: Config, alarm: float) -> None:
        self._classifier, self._alarm = classifier, alarm
        self._period = to_ticks(config.gait.period)
        self._phase: Phase = config.policy.phase
        self.reset(0)

    def reset(self, batch: int) -> None:
        """It has no memory."""

    def _inputs(self, state: State, tick: IntArray, command: Array) -> NDArray[np.float32]:
        """``(B, 47)`` observation and goal."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a robot that has blown up
            return network_input(state, tick, command, self._period, self._phase)

    def _alarming(self, rows: NDArray[np.float32]) -> BoolArray:
        """``(B,)`` True where the probability is beyond the alarm's."""
        return self._classifier.probability(rows) > self._alarm


class Deviation(_Learned):
    """Unsafe where the policy is predicted to deviate from the expert (SafeDAGGER).

    Its classifier is of observation and goal ``(47,)``.
    """

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """True where the probability is beyond the alarm's."""
        return self._alarming(self._inputs(state, tick, command))


class History(_Learned):
    """Unsafe where the bounds are predicted to be left soon; asked every 10 ms, holds its answer.

    Its classifier is of the last ten observations and goals, the oldest first ``(470,)``.
    """

    def reset(self, batch: int) -> None:
        """The first observation stands for all before it."""
        self._asked = 0
        self._past = np.zeros((batch, SAMPLES, INPUT_SIZE), np.float32)
        self._answer = np.zeros(batch, dtype=bool)

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """True where the probability was beyond the alarm's when it was last asked."""
        if self._asked % EVERY == 0:
            rows = self._inputs(state, tick, command)
            if self._asked == 0:
                self._past[:] = rows[:, None]
            self._past[:, :-1] = self._past[:, 1:]
            self._past[:, -1] = rows
            self._answer = self._alarming(self._past.reshape(len(rows), -1))
        self._asked += 1
        return self._answer
