"""How far a policy is from treating left and right alike.

The mirror error is the mean of |M pi(s) - pi(M s)| over states and joints, where M exchanges left
and right. It is zero for an expert on a symmetric robot. It is computed without simulation. Next:
`imitation`, how far a policy is from the expert.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.config import Config
from surefoot.evaluation.mirrors import left_right_mirror
from surefoot.learning.policy import Policy, load
from surefoot.learning.symmetry import mirror_error
from surefoot.robots.geometry import state_of
from surefoot.robots.load import load_robot
from surefoot.scenarios.starts import Starts
from surefoot.types import Array, IntArray, State

MRAD = 1000.0
"""Milliradians in a radian."""


def mirror_error_mrad(
    config: Config,
    policy: Policy,
    state: State,
    tick: IntArray,
    command: Array,
    gait: IntArray | int = 0,
) -> float | None:
    """The left-right mirror error of a policy over n states [mrad].

    Args:
        config: Robot and gaits.
        policy: The policy.
        state: The n states.
        tick: ``(n,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        gait: ``(n,)`` the numbers of the gaits.

    Returns:
        The error; None if the robot or a gait has no such mirror.
    """
    mirror = left_right_mirror(config)
    if mirror is None:
        return None
    return MRAD * mirror_error(policy, mirror, state, tick, command, gait)


def mirror_error_in_starts(config: Config, path: Path, starts: Starts) -> float | None:
    """The left-right mirror error of a policy over n initial states [mrad].

    Args:
        config: Robot and gaits.
        path: File of the policy.
        starts: The n initial states.

    Returns:
        The error; None if the robot or a gait has no such mirror.

    Raises:
        FileNotFoundError: There is no such policy.
    """
    robot = load_robot(config.robot)
    state = state_of(robot, starts.q, starts.v)
    policy = load(path, robot.name)
    return mirror_error_mrad(config, policy, state, starts.tick, starts.command, starts.gait)
