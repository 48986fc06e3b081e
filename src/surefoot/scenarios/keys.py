"""Keys of what is prepared once and kept: a SHA-256 over everything that it depends on.

Configurations that differ in anything that affects the bits of a set of initial states have
different keys; what does not affect them, such as the method or the seed of a run, is left out.
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import tokenize
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import surefoot
from surefoot.config import Config, ExpertConfig, Gait, SimulationConfig
from surefoot.config.json_io import to_json
from surefoot.config.profiles import HardwareProfile
from surefoot.robots.identity import description_hash
from surefoot.robots.load import find_profile, find_spec

VERSION = 1
"""Changes with what is kept and how it is made; with a new version, everything is made anew."""
PACKAGES = ("surefoot", "numpy", "pin", "numba")
"""Packages that affect what the expert does."""
SIMULATORS = {"mujoco": "mujoco", "bullet": "pybullet"}
"""The package of each simulator."""
FOLDERS = ("mpc", "robots", "scenarios", "sim")
"""Folders of the package whose code affects it too, which matters when somebody changes the code.
"""
MODULES = ("rotations.py", "types.py", "config/commands.py", "config/gait_clock.py")
"""Modules outside these folders whose code does so."""
MEASURING = (*FOLDERS, "evaluation", "rollouts")
"""Folders whose code affects the results of an evaluation of the expert."""


@dataclass(frozen=True)
class Ingredients:
    """Everything that affects how the expert walks.

    Attributes:
        version: `VERSION`.
        versions: Name and version of each package.
        code: SHA-256 of the package's own code.
        robot: SHA-256 of the robot's spec and description.
        torque_limit: The torque limit of all joints; None for the robot's own [N m].
        enforce_speed_limit: Whether motors stop at the joints' speed limits.
        profile: The content of the hardware profile, to which torques are clipped; None without.
        simulation: The simulator, without its terrain, since robots are prepared on the plane.
        gait: The gait.
        expert: The expert.
        fall_height: The range of base heights that are not a fall [m].
        fall_angle: Roll or pitch beyond this is a fall [deg].
        grace: Time from which on falls count [s].
    """

    version: int
    versions: tuple[tuple[str, str], ...]
    code: str
    robot: str
    torque_limit: float | None
    enforce_speed_limit: bool
    profile: HardwareProfile | None
    simulation: SimulationConfig
    gait: Gait
    expert: ExpertConfig
    fall_height: tuple[float, float] | None
    fall_angle: float
    grace: float


def ingredients_of(config: Config) -> Ingredients:
    """Everything that affects how the expert of a configuration walks.

    Args:
        config: The configuration, with the robot's own values in place of None.
    """
    names = (*PACKAGES, SIMULATORS[config.simulation.backend])
    return Ingredients(
        version=VERSION,
        versions=tuple((name, _version(name)) for name in names),
        code=code_hash(),
        robot=description_hash(find_spec(config.robot)),
        torque_limit=config.robot.torque_limit,
        enforce_speed_limit=config.robot.enforce_speed_limit,
        profile=find_profile(config.robot),
        simulation=replace(config.simulation, terrain=None),
        gait=config.gait,
        expert=config.expert,
        fall_height=config.safety.fall_height,
        fall_angle=config.safety.fall_angle,
        grace=config.safety.grace,
    )


def key_of(*records: object) -> str:
    """SHA-256 of records, or of JSON values."""
    return hashlib.sha256(json.dumps([to_json(each) for each in records]).encode()).hexdigest()


def code_hash(folders: Sequence[str] = FOLDERS) -> str:
    """SHA-256 of the package's code that affects how the expert walks.

    Comments and docstrings do not count: what was prepared or measured outlives them.

    Args:
        folders: The folders of the package to include; `MODULES` are always included.
    """
    sha = hashlib.sha256()
    package = Path(surefoot.__file__).parent
    paths = [path for folder in folders for path in sorted((package / folder).glob("*.py"))]
    for path in (*paths, *(package / name for name in MODULES)):
        sha.update(path.name.encode())
        status = path.stat()
        sha.update(_code_of(path, status.st_mtime_ns, status.st_size))
    return sha.hexdigest()


@cache
def _code_of(path: Path, changed: int, size: int) -> bytes:
    """The lines of a module without docstrings, comments and empty lines.

    Args:
        path: The module.
        changed: When it was changed [ns], so that an edit is seen.
        size: Its size [bytes], for the same reason.
    """
    del changed, size
    text = path.read_text()
    lines = text.split("\n")
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            row, column = token.start
            lines[row - 1] = lines[row - 1][:column].rstrip()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            for row in range(node.lineno, (node.end_lineno or node.lineno) + 1):
                lines[row - 1] = ""
    return "\n".join(line for line in lines if line.strip()).encode()


@cache
def _version(name: str) -> str:
    """The version of a package; empty if it is not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
