"""Presets: differences from the default configuration, all in one place.

The defaults of `Config` are the paper's numbers with this package's expert. `paper` adds the rest
of what the paper does, `default` is the same protocol made cheap, `quick` is a small run of
`default`, and `pushed` is `default` with an expert that is pushed from the first data on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    DisturbanceConfig,
    ExpertData,
    IterativeConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    SimulationConfig,
    TrainingConfig,
    method_config,
)
from surefoot.config.expert_rules import published_rules
from surefoot.errors import unknown

# Many short recoveries teach more than a few long ones: after 0.8 s the trot has settled.
_SHORT = ExpertData(velocities=10, perturbations=2, nominal=True, duration=0.8)
# A learning rate that falls to zero may begin at four times the paper's, and needs fewer epochs.
_FAST = TrainingConfig(learning_rate=8e-3, schedule="cosine")


def preset(method: str, name: str = "default") -> Config:
    """The configuration of a method under a preset.

    Args:
        method: A key of `METHODS`.
        name: `default`, `quick` (minutes), `pushed` or `paper`.

    Raises:
        ValueError: There is no such method or preset.
    """
    if name not in PRESETS:
        raise ValueError(unknown("preset", name, PRESETS))
    return PRESETS[name](method)


def paper(method: str) -> Config:
    """The paper's numbers, its simulator, and its expert's rules."""
    # The paper does not mention the precision; float32 is PyTorch's default, and does not depend on
    # the processor as `auto` does.
    config = Config(
        method=method_config(method),
        simulation=SimulationConfig(backend="bullet"),
        policy=PolicyConfig(phase="fraction"),
        training=TrainingConfig(precision="float32"),
    )
    return published_rules(config)


def default(method: str) -> Config:
    """The paper's protocol; the iterative methods train for a sixth of its steps.

    `benchmarks/notebook/training.md` explains how the numbers were chosen.
    """
    parameters = method_config(method)
    training = replace(_FAST, mirror="auto")
    if isinstance(parameters, IterativeConfig):
        # Policies that only collect data need little training; the last one is trained for long.
        parameters = replace(
            parameters,
            pretraining=_SHORT,
            pretraining_epochs=8,
            steps_before_last=2000,
            epochs=12,
        )
        # One push in five seconds: twice in the long rollouts.
        collection = _pushes(round(parameters.T / 5.0))
    else:
        # As many frames as the iterative methods have in the end.
        data = replace(_SHORT, velocities=20, perturbations=5)
        parameters = replace(parameters, data=data, epochs=32, frames=(168_000, 400_000))
        collection = DisturbanceConfig()
    if isinstance(parameters, LocoSafeDaggerConfig):
        # Bounds that are tight at first call the expert after a push while it can still help.
        # The trot has settled after 0.8 s, so a second of the expert is enough.
        parameters = replace(parameters, gates=("relaxing",), T_block=1.0)
    # Twenty robots per batch halve the cost of the network on a machine with few cores.
    return Config(method=parameters, chunk=20, training=training, collection=collection)


def _pushes(count: int) -> DisturbanceConfig:
    """Pushes that teach, up to those that tilt the expert beyond 30 degrees until it recovers."""
    return DisturbanceConfig(count, impulse=None, gentle=0.7, expert_impulse=None, fall_angle=60.0)


def quick(method: str) -> Config:
    """A small run of `default`, trained without mirror images."""
    config = replace(default(method), training=_FAST)
    if isinstance(config.method, IterativeConfig):
        short = replace(
            config.method,
            pretraining_epochs=12,
            iterations=2,
            T=5.0,
            steps_before_last=None,
            epochs=4,
        )
        return replace(config, method=short, collection=replace(config.collection, pushes=1))
    return replace(config, method=BehaviorCloningConfig(_SHORT, epochs=12))


def pushed(method: str) -> Config:
    """`default` with an expert that is pushed from the first data on, once in each rollout.

    With little data, this helps at equal MPC solves and equal steps (studies `regimes`, `options`).
    """
    config = default(method)
    taught = DisturbanceConfig(pushes=1, impulse=None, fall_angle=60.0)
    if isinstance(config.method, IterativeConfig):
        return replace(config, pretraining=taught)
    return replace(config, collection=taught)


PRESETS: dict[str, Callable[[str], Config]] = {
    "default": default,
    "quick": quick,
    "pushed": pushed,
    "paper": paper,
}
"""The presets by name; each makes the configuration of a method."""
