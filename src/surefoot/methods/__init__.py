"""Imitation methods, one file each, in the order and with the symbols of the paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from surefoot.methods import (
    behavior_cloning,
    dagger,
    dart,
    loco_dagger,
    loco_safe_dagger,
    safe_dagger,
)
from surefoot.rollouts.jobs import Job
from surefoot.runs.run import Run
from surefoot.types import PlanFunction
from surefoot.workers import Workers


@dataclass(frozen=True)
class Method:
    """An imitation method.

    Attributes:
        train: ``train(run, workers, plan)`` trains a policy and returns its file; if plan is None,
            the expert is the BiConMP-style planner.
        collection: ``collection(run, i, plan)`` returns the job that runs the rollouts of
            iteration i.
        title: Name of the method as it is written in the literature.
    """

    train: Callable[[Run, Workers, PlanFunction | None], Path]
    collection: Callable[[Run, int, PlanFunction | None], Job]
    title: str


METHODS = {
    "behavior_cloning": Method(
        behavior_cloning.behavior_cloning, behavior_cloning.collection, "BC"
    ),
    "dagger": Method(dagger.dagger, dagger.collection, "DAGGER"),
    "safe_dagger": Method(safe_dagger.safe_dagger, safe_dagger.collection, "SafeDAGGER"),
    "loco_dagger": Method(loco_dagger.loco_dagger, loco_dagger.collection, "LocoDAGGER"),
    "loco_safe_dagger": Method(
        loco_safe_dagger.loco_safe_dagger, loco_safe_dagger.collection, "LocoSafeDAGGER"
    ),
    "dart": Method(dart.dart, dart.collection, "DART"),
}
"""The methods by name, the paper's first and then DART; `config.methods` has their parameters."""
