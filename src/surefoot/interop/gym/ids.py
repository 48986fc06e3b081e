"""The names of the Gymnasium environments, which `register_environments` makes known to Gymnasium.

Gymnasium has no plug-ins, so every program that uses the environments calls it once.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

from surefoot.config.robot_table import ROBOTS
from surefoot.config.robots import RobotSpec

NAMESPACE = "surefoot"
"""The prefix of the names of all environments."""
ENVIRONMENTS: Mapping[str, Mapping[str, str]] = {
    f"{NAMESPACE}/Solo12-v0": {"robot": "solo12"},
    f"{NAMESPACE}/Go2-v0": {"robot": "go2"},
    f"{NAMESPACE}/Quadruped-v0": {},
}
"""The environments with their arguments; the last one has Solo12 unless `robot` is given."""


def register_environments() -> None:
    """Register the environments with Gymnasium; a second call changes nothing.

    Afterwards ``gym.make("surefoot/Solo12-v0")`` makes one robot, and ``gym.make_vec`` makes many
    in lockstep.

    Raises:
        ImportError: Gymnasium is missing.
    """
    gymnasium = import_gymnasium()
    for name, arguments in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="surefoot.interop.gym.env:WalkingEnv",
                vector_entry_point="surefoot.interop.gym.env:WalkingVectorEnv",
                kwargs=dict(arguments),
            )


def import_gymnasium() -> ModuleType:
    """Import Gymnasium.

    Raises:
        ImportError: It is missing; the message says how to install it.
    """
    try:
        import gymnasium
    except ImportError as error:
        raise ImportError(
            f"the environments need Gymnasium ({error}): pip install 'surefoot[gym]'"
        ) from error
    return gymnasium


def environment_of(robot: RobotSpec) -> str:
    """The name of the environment of a robot.

    Args:
        robot: The robot, compared by its whole description: a user's robot may have the name of
            one of the package.
    """
    for name, arguments in ENVIRONMENTS.items():
        if "robot" in arguments and ROBOTS[arguments["robot"]] == robot:
            return name
    return f"{NAMESPACE}/Quadruped-v0"
