"""What would fail hours later fails before any work."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar, get_args

import numpy as np

from surefoot.config import METHODS, Config, Gait, Guard, IterativeConfig
from surefoot.errors import unknown
from surefoot.learning.step import choose_device
from surefoot.rollouts.traces import HORIZON
from surefoot.runs.run import Run
from surefoot.runs.sampling import draw_starts
from surefoot.scenarios.disturbance import check_disturbance
from surefoot.scenarios.starts import load_starts
from surefoot.types import to_ticks

Parameters = TypeVar("Parameters")


def parameters(run: Run, kind: type[Parameters]) -> Parameters:
    """The method's parameters.

    Raises:
        TypeError: the run was configured for another method.
    """
    method = run.config.method
    if not isinstance(method, kind):
        name = next(name for name, each in METHODS.items() if each is kind)
        raise TypeError(f"this run is configured for {run.method}, not for {name}")
    return method


METHOD_BOUNDS = {
    "iterations": (0, 10_000),
    "epochs": (1, 1_000_000),
    "T": (0.001, 3600.0),
    "T_block": (0.0, 3600.0),
    "T_end": (0.0, 3600.0),
    "p": (0.0, 1.0),
    "alpha": (0.0, 1.0),
    "N_query": (1, 600),  # more could run into the ids of the next iteration
    "T_query": (0.001, 3600.0),
    "before_fall": (0.0, 3600.0),
    "unsafe_share": (0.0, 1.0),
    "alarm": (0.0, 1.0),
    "tightest": (0.0, 1.0),
}
"""Smallest and largest of the methods' parameters, of those that have them."""


def check(config: Config) -> None:
    """What would fail hours later fails before any work.

    Raises:
        ValueError: a number that cannot be worked with, and what it may be.
    """
    stored = load_starts()
    if config.gait != Gait():
        raise ValueError(
            f"the starts {stored.name!r} are of the default gait, the configuration asks for "
            f"{config.gait}: write a set of starts for it first (scripts/make_starts.py)"
        )
    checks = (
        ("chunk", config.chunk, 1, 10_000),
        ("training.batch", config.training.batch, 2, 1_000_000),
        ("training.threads", config.training.threads, 1, 1024),
        ("training.learning_rate", config.training.learning_rate, 1e-12, 1.0),
        ("training.memory", config.training.memory, 1, 1_000_000_000),
        ("training.validation", config.training.validation, 0.0, 0.9),
        ("evaluation.episodes", config.evaluation.episodes, 1, len(stored["select"])),
        ("evaluation.duration", config.evaluation.duration, 0.001, 3600.0),
        *(
            (f"method.{name}", getattr(config.method, name), *bounds)
            for name, bounds in METHOD_BOUNDS.items()
            if hasattr(config.method, name)
        ),
    )
    for name, value, least, most in checks:
        if not least <= value <= most:
            raise ValueError(f"{name} is {value}; use {least} to {most}")
    method = config.method
    guards = getattr(method, "guard", ("classifier",) if hasattr(method, "unsafe_share") else ())
    if wrong := [name for name in guards if name not in get_args(Guard)]:
        raise ValueError(unknown("guard", wrong[0], get_args(Guard)))
    if "classifier" in guards and config.training.validation == 0.0:
        raise ValueError(
            "training.validation is 0, but tau is chosen on frames held out; use 0.1, for example"
        )
    if isinstance(method, IterativeConfig):
        draw_starts(method, np.random.default_rng())
    check_disturbance(config.collection)
    check_disturbance(config.evaluation.disturbance)
    choose_device(config.training.device)


def check_guards(names: Sequence[Guard], duration: float) -> None:
    """Whether the gates can be had with rollouts of so many seconds.

    Raises:
        ValueError: a history network would have nothing to learn from.
    """
    if "history" in names and to_ticks(duration) <= HORIZON:
        raise ValueError(
            f"method.T is {duration} s; a history network predicts {HORIZON / 1000} s ahead and "
            "learns from longer rollouts only"
        )
