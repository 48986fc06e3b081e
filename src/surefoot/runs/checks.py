"""Checks of a run as a whole, so that what would fail hours later fails before any work.

Each configuration checks its own numbers when it is made (`surefoot.config.checked`). The checks
here need two configurations, the stored initial states, or this machine.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import (
    BehaviorCloningConfig,
    CommandBox,
    Config,
    DartConfig,
    ExpertData,
    IterativeConfig,
    LocoSafeDaggerConfig,
    MethodConfig,
    SafeDaggerConfig,
)
from surefoot.config.single_gaits import each_gait
from surefoot.evaluation.mirrors import training_mirror
from surefoot.learning.samples import held_out
from surefoot.learning.step import choose_device
from surefoot.mpc.gaits import names_of
from surefoot.robots.load import load_robot
from surefoot.runs.budget import SECONDS_PER_SOLVE, first_allowance
from surefoot.runs.sampling import draw_starts, expert_rollouts, order_of_series
from surefoot.scenarios.disturbance import warn_of_pushes
from surefoot.scenarios.starts import ANOTHER, SPLITS, StartSet, starts_of
from surefoot.types import to_ticks


def check_config(config: Config) -> None:
    """Check that a run with this configuration is possible on this machine.

    Raises:
        ValueError: It is not; the message names the option and the values that it may have.
    """
    _check_mirror(config)
    _check_gaits(config)
    _check_sizes(config)
    for one in each_gait(config):
        _check_stored(one, starts_of(one))
    _check_first_frames(config)
    _check_budget(config)
    robot = load_robot(config.robot)
    warn_of_pushes("collection", config.collection, robot)
    warn_of_pushes("pretraining", config.pretraining, robot)
    purpose = _use_of_held_out(config.method)
    if isinstance(config.method, IterativeConfig) and purpose:
        _check_held_out(config, config.method.pretraining, purpose)
    choose_device(config.training.device)


def _check_mirror(config: Config) -> None:
    """Check that mirrored frames show motions that the policy should learn.

    Raises:
        ValueError: The robot or a gait is not its own mirror image, or the mirror image walks
            backward but no command does.
    """
    name = config.training.mirror
    training_mirror(config)
    slowest, fastest = config.commands.vx
    if name == "front_hind" and slowest >= 0.0 and fastest > 0.0:
        raise ValueError(
            f"training.mirror front_hind makes commands backward of those forward, and vx is "
            f"{slowest:g} to {fastest:g} m/s: train backward commands too, such as "
            f"--vx {-fastest:g} {fastest:g}, or use left_right"
        )


def _check_gaits(config: Config) -> None:
    """Check that the method can learn several gaits, if there are several.

    Raises:
        ValueError: The method has a learned gate, whose network supports only one gait.
    """
    if not config.other_gaits:
        return
    method = config.method
    learned = method.name == "safe_dagger"
    if isinstance(method, LocoSafeDaggerConfig):
        learned = bool({"classifier", "history"} & set(method.gates))
    if learned:
        raise ValueError(
            f"{method.name} has a learned gate, which sees one gait alone, but the gaits are "
            f"{names_of(config)}: use loco_safe_dagger with --config.method.gates relaxing, or "
            "train one policy for each gait"
        )


def _check_sizes(config: Config) -> None:
    """Check that each dataset size of behavior cloning has room for at least one rollout.

    Raises:
        ValueError: A size has fewer frames than a rollout.
    """
    method = config.method
    if not isinstance(method, BehaviorCloningConfig) or not method.frames:
        return
    rollout = to_ticks(method.data.duration)
    if min(method.frames) < rollout:
        raise ValueError(
            f"method.frames is {method.frames}; use {rollout} or more, as a rollout of "
            f"method.data.duration, {method.data.duration:g} s, has so many frames"
        )


def _check_first_frames(config: Config) -> None:
    """Check that of each dataset size of behavior cloning something is left to train on.

    Raises:
        ValueError: All episodes of a size are held out.
    """
    method = config.method
    if not isinstance(method, BehaviorCloningConfig) or not method.frames:
        return
    if config.budget.expert_seconds is not None:  # then the number of rollouts is not known yet
        return
    job = expert_rollouts(config, method.data)
    order = order_of_series(config, job.starts.id)
    for frames in method.frames:
        first = job.episode[order[: frames // to_ticks(method.data.duration)]]
        if held_out(first, config.training.validation).all():
            raise ValueError(
                f"method.frames: all episodes of the first {frames} frames are held out "
                "(training.validation), so there would be nothing to train on: use more frames, "
                "or another --config.seed"
            )


def _check_stored(config: Config, stored: StartSet) -> None:
    """Check that the stored initial states fit this configuration.

    Raises:
        ValueError: They are at other commands, or there are too few of them.
    """
    if not _at_the_commands(config.commands, stored):
        raise ValueError(
            f"the initial states {stored.name!r} are not at the commands of the configuration, "
            f"{_box(config.commands)}: {ANOTHER}"
        )
    available = len(stored["select"])
    if config.evaluation.episodes > available:
        raise ValueError(
            f"evaluation.episodes is {config.evaluation.episodes}; use 1 to {available}"
        )
    method = config.method
    if config.starts == "train":
        _check_counts(method, stored)
    if isinstance(method, IterativeConfig):
        expert_rollouts(config, method.pretraining)
        draw_starts(config, method, 1)
    else:
        expert_rollouts(config, method.data)


def _at_the_commands(box: CommandBox, stored: StartSet) -> bool:
    """Whether initial states are at the commands of a box, except those at which robots fell."""
    if stored.preparation is not None:
        return stored.preparation.commands == box
    return all(
        np.allclose(stored.commands(split), box.spread(stored.shape[split][2]), atol=1e-9)
        for split in SPLITS
    )


def _box(commands: CommandBox) -> str:
    """A box of commands as text for messages."""
    intervals = (("vx", commands.vx), ("vy", commands.vy), ("yaw rate", commands.yaw_rate))
    return ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in intervals)


def _check_counts(method: MethodConfig, stored: StartSet) -> None:
    """Check that there are enough perturbed initial states for all that a method draws.

    Raises:
        ValueError: There are too few; the message names the option.
    """
    perturbations, _, velocities = stored.shape["train"]
    if not isinstance(method, IterativeConfig):
        _check_expert_data("method.data", method.data, stored)
        return
    _check_expert_data("method.pretraining", method.pretraining, stored)
    _check_count("method.velocities", method.velocities, velocities, stored)
    # The first perturbations belong to the pre-training.
    left = perturbations - method.pretraining.perturbations
    _check_count("method.perturbations", method.perturbations, left, stored)


def _check_expert_data(option: str, data: ExpertData, stored: StartSet) -> None:
    """Check that there are initial states for all expert rollouts.

    Args:
        option: Dotted path of the data in the configuration.
        data: Number of the rollouts.
        stored: The stored initial states.

    Raises:
        ValueError: There are too few of them.
    """
    perturbations, _, velocities = stored.shape["train"]
    _check_count(f"{option}.velocities", data.velocities, velocities, stored)
    _check_count(f"{option}.perturbations", data.perturbations, perturbations, stored)


def _check_count(option: str, count: int, available: int, stored: StartSet) -> None:
    """Check that a count is no larger than what the `train` split of the stored states has left.

    Raises:
        ValueError: It is larger; the message names the option and how many there are.
    """
    if count > available:
        raise ValueError(
            f"{option} is {count}; use at most {available}, which is what the initial states "
            f"{stored.name!r} have left for it in 'train'"
        )


def _check_budget(config: Config) -> None:
    """Check that the budget pays for one expert rollout, without which there is no policy.

    Raises:
        ValueError: The budget is too small.
    """
    allowed = first_allowance(config)
    method = config.method
    iterative = isinstance(method, IterativeConfig)
    data = method.pretraining if iterative else method.data
    if allowed is None or allowed * SECONDS_PER_SOLVE >= data.duration - 1e-9:
        return
    field = "method.pretraining" if iterative else "method.data"
    share = "times budget.pretraining " if iterative else ""
    raise ValueError(
        f"budget.expert_seconds {share}is {allowed * SECONDS_PER_SOLVE:g} s, which does not pay "
        f"for one rollout of {data.duration} s ({field}.duration): use more, or shorter rollouts"
    )


def _check_held_out(config: Config, pretraining: ExpertData, purpose: str) -> None:
    """Check that frames of the pre-training are held out.

    Args:
        config: Configuration of the run.
        pretraining: The expert rollouts of the pre-training.
        purpose: What held-out frames are needed for, to complete a sentence.

    Raises:
        ValueError: None of its rollouts is held out.
    """
    share = config.training.validation
    if share == 0.0:
        raise ValueError(
            f"training.validation is 0, but {purpose} frames held out; use 0.1, for example"
        )
    episode = expert_rollouts(config, pretraining).episode
    allowed = first_allowance(config)
    if allowed is not None:
        episode = episode[: int(allowed * SECONDS_PER_SOLVE / pretraining.duration)]
    if not held_out(episode, share).any():
        raise ValueError(
            f"training.validation is {share}, which holds out none of the {len(episode)} rollouts "
            f"of method.pretraining, but {purpose} frames held out; use a larger share, or "
            "more velocities or perturbations"
        )


def _use_of_held_out(method: MethodConfig) -> str:
    """What a method needs held-out frames for, in addition to validation; empty if nothing."""
    if isinstance(method, DartConfig):
        return "the noise is fitted to"
    classifies = isinstance(method, LocoSafeDaggerConfig) and "classifier" in method.gates
    if classifies or isinstance(method, SafeDaggerConfig):
        return "tau is chosen on"
    return ""
