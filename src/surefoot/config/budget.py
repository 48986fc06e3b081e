"""What a method may spend: seconds of the expert, counted in MPC solves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from surefoot.config.checked import Checked, Share, Within


@dataclass(frozen=True)
class BudgetConfig(Checked):
    """How many seconds of the expert a method may use in all; no limit by default.

    An expert that drives, or is asked, solves its MPC every 50 ms: a solve counts as 0.05 s of it,
    be it for a label, a query, a takeover, a tail or the pre-training. With a budget, the rollouts
    of a collection come in random order, so that the first ones mix phases and speeds, and it ends
    before the one that would exceed what is left to it. Behavior cloning uses all of it for its
    data. An iterative method uses a share for its pre-training; each iteration gets an equal share
    of what is left, and what it does not use goes to the next. An iteration that has too little
    left for a rollout still trains.
    """

    section: ClassVar[str] = "budget"

    expert_seconds: Annotated[float, Within(0.05, 1_000_000_000.0)] | None = None
    """[s] all that the method may use; None sets no limit."""
    pretraining: Share = 0.5
    """Share of it for the pre-training of iterative methods."""
