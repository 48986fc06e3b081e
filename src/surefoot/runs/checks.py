"""Checks of a run as a whole: what would fail hours later fails before any work.

Each configuration checks its own numbers when it is made (`surefoot.config.checked`). What is left
needs two configurations, the stored initial states, or this machine.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from surefoot.config import (
    Config,
    ExpertData,
    Gait,
    IterativeConfig,
    LocoSafeDaggerConfig,
    MethodConfig,
    SafeDaggerConfig,
)
from surefoot.learning.samples import held_out
from surefoot.learning.step import choose_device
from surefoot.runs.run import Run
from surefoot.runs.sampling import draw_starts, expert_rollouts
from surefoot.scenarios.starts import StartSet, load_starts

Parameters = TypeVar("Parameters", bound=MethodConfig)


def parameters(run: Run, kind: type[Parameters]) -> Parameters:
    """The method's parameters.

    Raises:
        TypeError: The run was configured for another method.
    """
    method = run.config.method
    if not isinstance(method, kind):
        raise TypeError(f"this run is configured for {run.method}, not for {kind.name}")
    return method


def check_config(config: Config) -> None:
    """Check that a run with this configuration can be done here.

    Raises:
        ValueError: It cannot; the message names the number and what it may be.
    """
    stored = load_starts()
    _check_stored(config, stored)
    if isinstance(config.method, IterativeConfig) and _learns_deviations(config.method):
        _check_held_out(config, config.method.pretraining)
    choose_device(config.training.device)


def _check_stored(config: Config, stored: StartSet) -> None:
    """Check that the stored initial states serve this configuration.

    Raises:
        ValueError: They belong to another gait, or there are too few of them.
    """
    if config.gait != Gait():
        raise ValueError(
            f"the initial states {stored.name!r} belong to the default gait, but the configuration "
            f"asks for {config.gait}: make a set for it first (`surefoot make-starts`)"
        )
    available = len(stored["select"])
    if config.evaluation.episodes > available:
        raise ValueError(
            f"evaluation.episodes is {config.evaluation.episodes}; use 1 to {available}"
        )
    if isinstance(config.method, IterativeConfig):
        draw_starts(config.method, np.random.default_rng())


def _check_held_out(config: Config, pretraining: ExpertData) -> None:
    """Check that tau can be chosen on the frames of the pre-training that are held out.

    Raises:
        ValueError: None of its rollouts is held out.
    """
    share = config.training.validation
    if share == 0.0:
        raise ValueError(
            "training.validation is 0, but tau is chosen on frames held out; use 0.1, for example"
        )
    episode = expert_rollouts(config, pretraining).episode
    if not held_out(episode, share).any():
        raise ValueError(
            f"training.validation is {share}, which holds out none of the {len(episode)} rollouts "
            "of method.pretraining, but tau is chosen on frames held out; use a larger share, or "
            "more velocities or perturbations"
        )


def _learns_deviations(method: MethodConfig) -> bool:
    """Whether a classifier learns where the policy deviates from the expert by more than tau."""
    if isinstance(method, LocoSafeDaggerConfig):
        return "classifier" in method.gates
    return isinstance(method, SafeDaggerConfig)
