"""Versions of Python and packages, and the processor: if these are equal, results are too.

They are written into a run's ``config.json`` and compared when the run is resumed (`runs.run`).
"""

from __future__ import annotations

import platform
import warnings
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

from surefoot.config import Backend

if TYPE_CHECKING:
    from surefoot.runs.run import Run

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


def warn_of_versions(run: Run) -> None:
    """Warn if a run was begun with other versions than those installed now."""
    differences = changed_versions(run.setup.versions, run.config.simulation.backend)
    if differences:
        warnings.warn(
            f"{run.folder} was begun with other versions ({'; '.join(differences)}); what follows "
            "will not be the same bits as with those",
            stacklevel=3,
        )


def warn_of_device(run: Run) -> None:
    """Warn if a run was last trained on another device than the one that trains it now."""
    # These load PyTorch and simulators, which a robot's computer does not have.
    from surefoot.learning.step import choose_device, device_name
    from surefoot.runs.metrics import Trained

    trained = [record for record in run.metrics if isinstance(record, Trained)]
    device = device_name(choose_device(run.config.training.device))
    if trained and trained[-1].device not in ("", device):
        warnings.warn(
            f"{run.folder} was trained on {trained[-1].device}, and goes on on {device}; what "
            "follows will not be the same bits as there",
            stacklevel=3,
        )


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
