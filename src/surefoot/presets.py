"""Presets: differences from the default configuration, all in one place."""

from __future__ import annotations

from dataclasses import replace

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    Config,
    ExpertData,
    LocoSafeDaggerConfig,
    TrainingConfig,
    unknown,
)

PRESETS = ("quick", "default", "paper")


def preset(method: str, name: str = "quick") -> Config:
    """The configuration of a method under a preset: differences from the defaults, all here.

    Args:
        method: a key of `METHODS`.
        name: `quick` takes minutes; `default` and `paper` are not yet available.

    Raises:
        ValueError: there is no such method or preset, or it is not yet available.
    """
    if method not in METHODS:
        raise ValueError(unknown("method", method, METHODS))
    if name not in PRESETS:
        raise ValueError(unknown("preset", name, PRESETS))
    if name != "quick":
        raise ValueError(f"preset {name!r} is not yet available; use --preset quick")
    # Twenty robots to a batch halve the cost of the network on a machine of few cores.
    config = Config(chunk=20, training=TrainingConfig(schedule="cosine"))
    # Many short recoveries teach more than few long ones: after 0.8 s the trot has settled.
    data = ExpertData(velocities=10, perturbations=2, nominal=True, duration=0.8)
    if method == "behavior_cloning":
        return replace(config, method=BehaviorCloningConfig(data, epochs=12))
    dagger = LocoSafeDaggerConfig(data, pretraining_epochs=12, iterations=2, T=5.0, epochs=4)
    return replace(config, method=dagger)


def published_rules(config: Config) -> Config:
    """The expert's rules as BiConMP publishes them: footholds and commands without feedback."""
    expert = replace(config.expert, foothold_rule="published", command_gain=(1.0, 1.0, 1.0))
    return replace(config, expert=expert)
