"""The safety monitor: a gate with the blocking of Algorithm 4."""

from __future__ import annotations

from enum import Enum

import numpy as np

from surefoot.safety.gates import Gate
from surefoot.types import Array, BoolArray, IntArray, State, to_ticks


class HandBack(Enum):
    """When the policy drives again after a takeover; the paper's text and code disagree."""

    EVERY_VIOLATION_RESTARTS = "every_violation_restarts"
    """T_block without a violation (Algorithm 4)."""
    SAFE_OR_BLOCKED = "safe_or_blocked"
    """Safe again, or T_block over (the paper's prose)."""
    SAFE_AND_BLOCKED = "safe_and_blocked"
    """Safe again, and at least T_block since the takeover (the paper's research code; "at least
    2 s" in the text)."""


class SafetyMonitor:
    """Says who drives: the expert from a violation on, until the hand-back rule lets go.

    Args:
        gate: says which states are unsafe.
        block: T_block [s]; 0 hands back as soon as the state is safe (Algorithm 2).
        hand_back: the rule that ends a block.
    """

    def __init__(
        self, gate: Gate, block: float, hand_back: HandBack = HandBack.SAFE_AND_BLOCKED
    ) -> None:
        self._gate = gate
        self._block = to_ticks(block)
        self._hand_back = HandBack(hand_back)
        self.reset(0)

    def reset(self, batch: int) -> None:
        """No robot of ``batch`` is blocked."""
        self._gate.reset(batch)
        self._blocked_for, self._anyone = np.full(batch, -1), False

    def blocking(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the expert must drive during this tick; call once a tick.

        The arguments are those of `Gate.unsafe`.
        """
        violation = self._gate.unsafe(state, tick, command)
        if not self._anyone and not violation.any():
            return violation
        clock = np.where(self._blocked_for >= 0, self._blocked_for + 1, -1)
        if self._hand_back is HandBack.EVERY_VIOLATION_RESTARTS:
            clock[violation] = 0
        if self._hand_back is HandBack.SAFE_OR_BLOCKED:
            release = (clock >= 0) & (~violation | (clock >= self._block))
        else:
            release = ~violation & (clock >= self._block)
        clock[release] = -1
        clock[violation & (clock < 0) & ~release] = 0
        self._blocked_for, blocked = clock, clock >= 0
        self._anyone = bool(blocked.any())
        return blocked
