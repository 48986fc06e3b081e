"""The safety monitor: a gate with the blocking of Algorithm 4.

After a violation the expert drives, usually for at least T_block; a hand-back rule decides when the
policy drives again. Read ``gates.py`` first; ``rollouts/arbiters.py`` uses the monitor.
"""

from __future__ import annotations

import math
from typing import get_args

import numpy as np

from surefoot.config import HandBack
from surefoot.errors import unknown
from surefoot.safety.gates import Gate
from surefoot.types import Array, BoolArray, IntArray, State, one_flag_each, to_ticks


class SafetyMonitor:
    """Says when the expert must drive: from a violation on, until the hand-back rule is met.

    Args:
        gate: The gate that says which states are unsafe.
        block: T_block [s]; with 0 the policy drives again as soon as the state is safe
            (Algorithm 2).
        hand_back: The rule that ends a block.

    Raises:
        ValueError: There is no such rule, or the time is negative or not finite.
    """

    def __init__(self, gate: Gate, block: float, hand_back: HandBack = "safe_and_blocked") -> None:
        if hand_back not in get_args(HandBack):
            raise ValueError(unknown("hand-back rule", hand_back, get_args(HandBack)))
        if not 0.0 <= block < math.inf:
            raise ValueError(f"block is {block} s; use 0 or more (0 hands back at once)")
        self._gate = gate
        self._block = to_ticks(block)
        self._hand_back = hand_back
        self.reset(0)

    def reset(self, batch: int) -> None:
        """Reset the gate and be ready for ``batch`` robots, none of which is blocked."""
        self._gate.reset(batch)
        self._since = np.full(batch, -1)  # the tick of the takeover; -1: the policy drives
        self._any_blocked = False

    def blocking(self, state: State, tick: IntArray, command: Array) -> BoolArray:
        """``(B,)`` True where the expert must drive during this tick; call once a tick.

        The arguments are those of `Gate.unsafe`; the gait clock advances from call to call.

        Raises:
            ValueError: The answer of the gate is not a boolean array ``(B,)``.
        """
        answer = self._gate.unsafe(state, tick, command)
        violation = one_flag_each(answer, len(self._since), self._gate)
        if not self._any_blocked and not np.count_nonzero(violation):
            return violation
        # Ticks that the monitor missed, on a real robot, count as well.
        clock = np.where(self._since >= 0, tick - self._since, -1)
        if self._hand_back == "every_violation_restarts":
            clock[violation] = 0
        if self._hand_back == "safe_or_blocked":
            over = (self._block > 0) & (clock >= self._block)
            release = (clock >= 0) & (~violation | over)
        else:
            release = ~violation & (clock >= self._block)
        clock[release] = -1
        clock[violation & (clock < 0) & ~release] = 0
        blocked = clock >= 0
        self._since = np.where(blocked, tick - clock, -1)
        self._any_blocked = bool(blocked.any())
        return blocked
