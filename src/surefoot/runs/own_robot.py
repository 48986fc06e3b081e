"""A run's own copy of the description of a robot that does not come with the package.

The run's ``config.json`` names the original description, next to which are the meshes for films.
The copy is used if that file no longer exists or has changed. `runs.run` calls this.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from surefoot.config import Config
from surefoot.config.json_text import read_file
from surefoot.files import write_atomic
from surefoot.robots.description import find_urdf
from surefoot.runs.layout import ROBOT_FILE


def keep_robot(folder: Path, config: Config) -> None:
    """Copy the description of a robot that does not come with the package into a run's folder.

    Args:
        folder: The run's folder.
        config: The run's configuration.

    Raises:
        WriteError: The copy cannot be written.
    """
    copy = folder / ROBOT_FILE
    spec = config.robot.spec
    if spec is not None:
        write_atomic(copy, read_file(find_urdf(spec)))
    else:
        copy.unlink(missing_ok=True)  # left by a run that never began


def with_own_robot(folder: Path, config: Config) -> Config:
    """The configuration with the robot as it was when the run began.

    Args:
        folder: The run's folder.
        config: The configuration as it is written in the folder.
    """
    spec = config.robot.spec
    copy = folder.resolve() / ROBOT_FILE
    if spec is None or not copy.exists():  # earlier versions made no copy
        return config
    try:
        is_same = read_file(find_urdf(spec)) == read_file(copy)
    except (OSError, ValueError):
        is_same = False
    if is_same:
        return config
    return replace(config, robot=replace(config.robot, spec=replace(spec, urdf=str(copy))))
