"""The mirror of a configuration, which mirrors the robot together with its gaits.

`robots.symmetry` has the mirror of a robot's body, and `learning.symmetry` applies a mirror to
states, clocks and frames.
"""

from __future__ import annotations

from surefoot.config import Config, MirrorName
from surefoot.learning.symmetry import Mirror, clock_shift
from surefoot.robots.load import load_robot
from surefoot.robots.symmetry import body_mirror


def make_mirror(config: Config, name: MirrorName) -> Mirror:
    """The mirror of a configuration's robot and gaits.

    Args:
        config: Robot and gaits.
        name: Which sides change places.

    Raises:
        ValueError: The robot or a gait is not its own mirror image.
    """
    body = body_mirror(load_robot(config.robot), name)
    shift, *others = (clock_shift(gait, body.legs) for gait in config.gaits)
    return Mirror(*body, shift=shift, other_shifts=tuple(others))


def training_mirror(config: Config) -> Mirror | None:
    """The mirror that a training uses, if any.

    Args:
        config: Robot, gaits, and the training's mirror.

    Raises:
        ValueError: A mirror is configured, but the robot or a gait is not its own mirror image.
    """
    name = config.training.mirror
    if name == "none":
        return None
    if name != "auto":
        return make_mirror(config, name)
    boxes = (config.commands.vy, config.commands.yaw_rate)
    # A command to the left is mirrored to the right, which a policy may not have to learn.
    is_even = all(lowest == -highest for lowest, highest in boxes)
    return left_right_mirror(config) if is_even else None


def left_right_mirror(config: Config) -> Mirror | None:
    """The mirror of left and right; None if the robot or a gait is not its own mirror image."""
    load_robot(config.robot)  # outside the try: an error in loading does not mean "no mirror"
    try:
        return make_mirror(config, "left_right")
    except ValueError:
        return None
