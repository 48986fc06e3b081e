"""Tells one robot from another by a hash of its spec and of the content of its description.

Two robots may have the same name, so what was made for one of them, such as initial states, keeps
the hash. `content_hash` covers all files that a configured robot is loaded from: it tells a robot
that is kept in memory from one whose files have changed.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

from surefoot.config.json_io import to_json
from surefoot.config.robots import RobotConfig, RobotSpec
from surefoot.robots.description import find_urdf
from surefoot.robots.load import find_profile, find_spec


def description_hash(spec: RobotSpec) -> str:
    """SHA-256 of a robot's spec and of the bytes of its URDF, wherever the file lies.

    Args:
        spec: The robot.

    Raises:
        ValueError: There is no such description.
        ImportError: The package ``example-robot-data`` is missing.
    """
    sha = hashlib.sha256(json.dumps(to_json(replace(spec, urdf="-"))).encode())
    sha.update(find_urdf(spec).read_bytes())
    return sha.hexdigest()


def content_hash(config: RobotConfig) -> str:
    """SHA-256 of everything that a configured robot is loaded from, wherever its files lie.

    Args:
        config: Which robot.

    Raises:
        ValueError: There is no such robot, description or profile.
        ImportError: The package ``example-robot-data`` is missing.
    """
    files = [description_hash(find_spec(config)), to_json(find_profile(config))]
    return hashlib.sha256(json.dumps(files).encode()).hexdigest()
