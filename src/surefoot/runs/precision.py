"""The precision of a run's trainings: chosen once, when the run is begun, and kept.

Runs of versions that wrote down no choice multiplied in bfloat16 where the processor has
instructions for it, if their configuration says `bfloat16`; they go on like that. Read
`learning.precision` for how the choice is made.
"""

from __future__ import annotations

from dataclasses import replace

from surefoot.config import Config, TrainingConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import observation_spec
from surefoot.learning.precision import PrecisionChoice, choose_precision
from surefoot.learning.step import choose_device, has_bfloat16


def choose_for_run(config: Config) -> PrecisionChoice:
    """The precision of a new run; where it is `auto`, measuring it takes about half a second.

    Raises:
        ValueError: The configured device is not there, or lacks the configured precision.
    """
    network = PolicyNetwork(config.policy, inputs=observation_spec(config).input_size)
    return choose_precision(network, config.training)


def kept_precision(training: TrainingConfig, choice: PrecisionChoice | None) -> TrainingConfig:
    """How a run trains its policies: as configured, in the precision chosen when it was begun.

    Args:
        training: The run's configuration of training.
        choice: The choice that the run has written down; None if it was begun by a version that
            wrote down none.

    Raises:
        ValueError: The configured device is not there.
    """
    if choice is not None:
        return replace(training, precision=choice.chosen)
    if training.precision != "float32" and has_bfloat16(choose_device(training.device)):
        return replace(training, precision="bfloat16")
    return replace(training, precision="float32")


def with_precision_of(config: Config, before: Config) -> Config:
    """A configuration whose `auto` is the precision that a run of earlier versions has in its own.

    Args:
        config: The configuration with which the run is resumed.
        before: The configuration with which the run was begun.
    """
    if config.training.precision != "auto":
        return config
    training = replace(config.training, precision=before.training.precision)
    return replace(config, training=training)
