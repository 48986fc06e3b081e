"""When the expert takes over, and what counts as a fall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

HandBack = Literal["safe_and_blocked", "every_violation_restarts", "safe_or_blocked"]
"""Rules that say when the policy drives again after a takeover; the paper's text and code disagree.

- `every_violation_restarts`: T_block without a violation has passed (Algorithm 4).
- `safe_or_blocked`: the state is safe again, or T_block is over (the paper's prose).
- `safe_and_blocked`: the state is safe again, and at least T_block has passed since the takeover
  (the paper's research code; "at least 2 s" in the text).
"""


@dataclass(frozen=True)
class SafetyConfig:
    """When the expert takes over (paper, Table I), and what counts as a fall."""

    com_height: tuple[float, float] = (0.15, 1.0)
    """[m]"""
    roll_pitch: float = 25.0
    """[deg] either way."""
    hip_abduction: tuple[float, float] = (-30.0, 60.0)
    """[deg] left legs; mirrored for right legs."""
    hip_flexion: tuple[float, float] = (0.0, 90.0)
    """[deg] front legs; mirrored for hind legs."""
    knee: tuple[float, float] = (-160.0, 0.0)
    """[deg] front legs; mirrored for hind legs."""
    fall_height: tuple[float, float] = (0.10, 2.0)
    """[m] base height outside this is a fall (the paper's research code)."""
    fall_angle: float = 30.0
    """[deg] roll or pitch beyond this is a fall (the paper's research code)."""
    grace: float = 0.5
    """[s] falls are not tested earlier than this (the paper's research code)."""
    stepping_from: float = 1.56
    """[s] shorter episodes are not judged for stepping: in their last third, even a perfect trot
    (period 0.5 s, touchdown 20 ms) has not touched down with every foot."""
