"""Learned gates: networks that call a state unsafe, for a `SafetyMonitor` (``monitor.py``).

`Deviation` is SafeDAGGER's: it predicts from the state whether the policy deviates from the expert.
`History` is the paper's future work: it predicts from the last 100 ms whether the bounds will be
left within 0.3 s, so that the expert can take over earlier. It is trained on the traces of rollouts
(``rollouts/traces.py``): their states without noise, whoever drove.

Both need the full state, with the height and the linear velocity of the base, just as the bounds
need the height of the center of mass: they watch a robot in training, whose state is known. The
policy's layout makes no difference to them. On a robot without a state estimator they have no
input.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from surefoot.learning.classifier import Classifier
from surefoot.learning.observation import (
    INPUT_SIZE,
    Float32Array,
    ObservationSpec,
    network_input,
)
from surefoot.types import Array, BoolArray, IntArray, State

EVERY = 10
"""Time between two samples of the history [ms]."""
SAMPLES = 10
"""Number of samples in the history: the last 100 ms."""


class _LearnedGate:
    """What both learned gates share.

    Args:
        classifier: A classifier of the rows that the gate makes of what it sees.
        spec: How states, ticks and commands become those rows.
        alarm: Probability beyond which a state is unsafe.
    """

    row_size: ClassVar[int] = INPUT_SIZE
    """The size of a row, which is the number of inputs of the classifier."""

    def __init__(self, classifier: Classifier, spec: ObservationSpec, alarm: float) -> None:
        self._classifier = classifier
        self._spec = spec
        self._alarm = alarm
        self.reset(0)

    def reset(self, batch: int) -> None:
        """Do nothing: this gate has no memory."""

    def _inputs(self, state: State, tick: IntArray, command: Array) -> Float32Array:
        """``(B, 47)`` observation and goal."""
        with np.errstate(over="ignore", invalid="ignore"):  # for a robot that has blown up
            return network_input(state, tick, command, self._spec)

    def _alarming(self, rows: Float32Array) -> BoolArray:
        """``(B,)`` True where the probability is beyond the alarm."""
        return self._classifier.probability(rows) > self._alarm


class Deviation(_LearnedGate):
    """Unsafe where the policy is predicted to deviate from the expert (SafeDAGGER).

    Its classifier takes observation and goal ``(47,)``.
    """

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the probability is beyond the alarm."""
        return self._alarming(self._inputs(state, tick, command))


class History(_LearnedGate):
    """Unsafe where the bounds are predicted to be left soon; computed every 10 ms, and held.

    Its classifier takes the last ten observations and goals, the oldest first ``(470,)``.
    """

    row_size: ClassVar[int] = SAMPLES * INPUT_SIZE

    def reset(self, batch: int) -> None:
        """Forget everything; the next observation stands for all before it."""
        self._ticks = 0
        self._past = np.zeros((batch, SAMPLES, INPUT_SIZE), np.float32)
        self._answer = np.zeros(batch, dtype=bool)

    def unsafe(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the probability was beyond the alarm at the last sample."""
        if self._ticks % EVERY == 0:
            rows = self._inputs(state, tick, command)
            if self._ticks == 0:
                self._past[:] = rows[:, None]
            self._past[:, :-1] = self._past[:, 1:]
            self._past[:, -1] = rows
            self._answer = self._alarming(self._past.reshape(len(rows), -1))
        self._ticks += 1
        return self._answer
