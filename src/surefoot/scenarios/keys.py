"""Keys of what is prepared once and kept: a SHA-256 over all that it depends on.

Two configurations that differ in anything that decides the bits of a set of initial states have two
keys; what has no part in it, such as the method or the seed of a run, has none in the key either.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import surefoot
from surefoot.config import Config
from surefoot.config.json_io import to_json
from surefoot.robots.identity import description_hash
from surefoot.robots.load import find_spec

VERSION = 1
"""Of what is kept, and of how it is made; another one makes everything anew."""
PACKAGES = ("surefoot", "numpy", "pin", "numba")
"""Packages that decide what the expert does."""
SIMULATORS = {"mujoco": "mujoco", "bullet": "pybullet"}
"""The package of each simulator."""
ROOMS = ("mpc", "robots", "scenarios", "sim")
"""Folders of the package whose code decides it too, while somebody changes that code."""


def expert_values(config: Config) -> dict[str, object]:
    """What decides how the expert walks, as JSON values.

    Args:
        config: The configuration, with the robot's own values in place of None.
    """
    spec = find_spec(config.robot)
    backend = config.simulation.backend
    names = (*PACKAGES, SIMULATORS[backend])
    safety = config.safety
    return {
        "version": VERSION,
        "versions": {name: _version(name) for name in names},
        "code": code_hash(),
        "robot": description_hash(spec),
        "limits": [config.robot.torque_limit, config.robot.enforce_speed_limit],
        "simulation": to_json(config.simulation),
        "gait": to_json(config.gait),
        "expert": to_json(config.expert),
        "falls": to_json([safety.fall_height, safety.fall_angle, safety.grace]),
    }


def key_of(values: Mapping[str, object]) -> str:
    """SHA-256 of JSON values, whatever their order."""
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def code_hash() -> str:
    """SHA-256 of the package's code that decides how the expert walks."""
    sha = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((Path(surefoot.__file__).parent / room).glob("*.py")):
            sha.update(path.name.encode())
            sha.update(path.read_bytes())
    return sha.hexdigest()


def _version(name: str) -> str:
    """The version of a package; empty if it is not there."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
