"""Versions of Python and packages, and the processor: if these are equal, results are too.

They are written into a run's ``config.json`` and compared when the run is resumed (`runs.run`).
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from surefoot.config import Backend

PACKAGES = ("surefoot", "numpy", "scipy", "pin", "mujoco", "numba", "torch", "onnxruntime", "h5py")
"""Packages whose versions decide the bits of a result."""
PROCESSOR_FIELDS = ("model name", "cpu family", "model\t", "CPU implementer", "CPU part")
"""Beginnings of the lines of ``/proc/cpuinfo`` that name a model of processor."""


def versions(backend: Backend = "mujoco") -> dict[str, str]:
    """The version of Python, the processor, and the version of each package, by name.

    Args:
        backend: Name of the simulator; the version of PyBullet only counts for `bullet`.
    """
    names = (*PACKAGES, "pybullet") if backend == "bullet" else PACKAGES
    by_name = {"python": platform.python_version(), "processor": processor()}
    for name in names:
        by_name[name] = installed(name) or "missing"
    return by_name


def installed(package: str) -> str | None:
    """The version of a package; None if it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def changed_versions(before: Mapping[str, str], backend: Backend) -> list[str]:
    """The versions that have changed, as text.

    Args:
        before: The earlier versions, by name.
        backend: Name of the simulator.
    """
    now = versions(backend)
    return [
        f"{name} {before.get(name)}, now {now.get(name)}"
        for name in dict.fromkeys([*before, *now])
        if before.get(name) != now.get(name)
    ]


def processor() -> str:
    """Model of the processor; floating-point results are promised for one model only."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    parts = []
    for field in PROCESSOR_FIELDS:
        line = next((line for line in lines if line.startswith(field)), "")
        parts.append(line.partition(":")[2].strip())
    return ", ".join(filter(None, parts)) or platform.machine()
