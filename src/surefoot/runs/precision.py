"""The precision of a run's trainings: chosen once, when the run is begun, and kept.

Early versions recorded no choice: unless `float32` was configured, they used bfloat16 wherever the
processor has instructions for it. Their runs continue like that. Read `learning.precision` for how
the choice is made.
"""

from __future__ import annotations

from dataclasses import replace

from surefoot.config import Config, TrainingConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import observation_spec
from surefoot.learning.precision import PrecisionChoice, choose_precision
from surefoot.learning.step import choose_device, has_bfloat16


def choose_for_run(config: Config) -> PrecisionChoice:
    """The precision of a new run; if `auto` is configured, measuring takes about half a second.

    Raises:
        ValueError: The configured device does not exist, or lacks the configured precision.
    """
    network = PolicyNetwork(config.policy, inputs=observation_spec(config).input_size)
    return choose_precision(network, config.training)


def kept_precision(training: TrainingConfig, choice: PrecisionChoice | None) -> TrainingConfig:
    """The training configuration of a run, with the precision chosen when the run began.

    Args:
        training: The run's training configuration.
        choice: The choice that the run recorded; None if it was begun by a version that recorded
            none.

    Raises:
        ValueError: The configured device does not exist.
    """
    if choice is not None:
        return replace(training, precision=choice.chosen)
    if training.precision != "float32" and has_bfloat16(choose_device(training.device)):
        return replace(training, precision="bfloat16")
    return replace(training, precision="float32")


def with_precision_of(config: Config, before: Config) -> Config:
    """The configuration, with `auto` replaced by the precision of a run of an earlier version.

    Args:
        config: The configuration with which the run is resumed.
        before: The configuration with which the run was begun.
    """
    if config.training.precision != "auto":
        return config
    training = replace(config.training, precision=before.training.precision)
    return replace(config, training=training)
