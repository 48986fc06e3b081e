"""Versions of Python, the processor and packages: the same bits are promised for the same ones."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from surefoot.config import Backend

PACKAGES = ("surefoot", "numpy", "scipy", "pin", "mujoco", "numba", "torch", "onnxruntime", "h5py")


def versions(backend: Backend = "mujoco") -> dict[str, str]:
    """Python, processor and package versions: the same bits are promised for the same ones.

    Args:
        backend: PyBullet's version counts where it is the simulator.
    """
    found = {"python": platform.python_version(), "processor": processor()}
    for name in (*PACKAGES, *(["pybullet"] if backend == "bullet" else [])):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    return found


def processor() -> str:
    """Model of the processor; floating-point results are promised for one model only."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    names = ("model name", "cpu family", "model\t")
    parts = [next((line for line in lines if line.startswith(name)), "") for name in names]
    return ", ".join(part.partition(":")[2].strip() for part in parts) or platform.machine()
